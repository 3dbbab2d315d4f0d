"""``apply`` of an array's model: a folder of units with clocks of their own becomes one log."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from formats_page import strangers
from simulated_array import DEG, RATE_HZ, measured, model_of, motion, units

import calibrate
from session.annexes.arrays.recording import read_array
from session.detect.stills import Noise
from session.io.config import Accelerometer
from session.io.folder import sha256_of
from session.io.logfile import read_log
from session.io.units import NS, G
from tinygc.annexes.arrays.apply import fused_force
from tinygc.annexes.arrays.clocks import UnitClock
from tinygc.annexes.arrays.fusion import Resampler, array_model_of, save_array_model
from tinygc.annexes.arrays.model import ArrayModel
from tinygc.closure.floor import BiasInstability

TOML = """schema = "tinygc-session/1"

[sensor]
model = "MPU-9150"
serial = "array"
odr_hz = 100.0
gyro_fs_dps = 2000
accel_fs_g = 4

[array]
"""


def write_array(folder, model: ArrayModel, t_s, raw, force, which="log0001"):
    """Logs of all units: t_s (N, T) s on their own clocks, raw and force (T, N, 3)."""
    folder.mkdir(exist_ok=True)
    (folder / "session.toml").write_text(TOML)
    for i, number in enumerate(model.numbers):
        lines = ["t_ns,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"]
        for t, m, f in zip(t_s[i], raw[:, i] / DEG, force[:, i] / G, strict=True):
            lines.append(f"{round(t / NS)},{','.join(f'{v:.7f}' for v in (*m, *f))}")
        (folder / f"{which}.unit{number}.csv").write_text("\n".join(lines) + "\n")


def with_places(found, clocks=None, positions=None):
    """Units with an accelerometer, on clocks, at positions."""
    return [
        replace(
            unit,
            accelerometer=Accelerometer(),
            place=replace(
                unit.place,
                clock=UnitClock() if clocks is None else clocks[i],
                position_m=None if positions is None else positions[i],
            ),
        )
        for i, unit in enumerate(found)
    ]


def said(folder, model_path, *more):
    out, told = folder.parent / "fused.csv", folder.parent / "said.json"
    code = calibrate.main(["apply", str(model_path), str(folder), "-o", str(out), "--force", "--quiet", "--json", str(told), *more])
    assert code == 0
    table = json.loads(told.read_text())
    assert not strangers(table)
    return read_log(out, model_of(units(2)).units[0].sensor).samples, table


def test_a_folder_becomes_one_log_with_the_best_rate(tmp_path):
    model = model_of(with_places(units(3)))
    save_array_model(model, tmp_path / "array.json")
    omega = motion(2000)
    raw = measured(model, omega)
    raw[900:1400, 2, 1] = 2000 * DEG  # at the end of its range, so it is left out
    level = np.einsum("nji,j->ni", np.stack([unit.place.mounting for unit in model.units]), [0, 0, -G])
    t_s = np.tile(np.arange(2000) / RATE_HZ, (3, 1))
    write_array(tmp_path / "array", model, t_s, raw, np.tile(level, (2000, 1, 1)))
    samples, table = said(tmp_path / "array", tmp_path / "array.json")
    assert len(samples) == table["rows"] == 2000
    assert table["clocks"] == "same"
    assert [unit["used_share"] for unit in table["units"]] == [1.0, 1.0, 0.75]
    assert table["at_end"] == 0
    good = np.r_[0:900, 1400:2000]
    np.testing.assert_allclose(samples.gyro[good], model(raw)[good], atol=1e-8)  # all are in, and the stamps are the same
    assert np.abs(samples.gyro - omega).max() < 6 * model.noise_density.max() * np.sqrt(RATE_HZ / 2 * 1.5)
    np.testing.assert_allclose(samples.accel, np.tile([0, 0, -G], (2000, 1)), atol=1e-5)
    assert any("lever arms of units 1, 2 are left out" in note for note in table["notes"])


def test_units_on_clocks_of_their_own_are_brought_to_the_first_ones(tmp_path):
    """2000 ppm and 7 ms apart: what is left of a motion of 3 Hz is below the noise."""
    clocks = [UnitClock(), UnitClock(0.007, 2e-3, 1.0), UnitClock(-0.013, -1e-3)]
    model = model_of([replace(unit, noise_density=np.full(3, 1e-9)) for unit in with_places(units(3), clocks)])

    def at(t_s):
        return np.sin(2 * np.pi * np.outer(t_s, [0.7, 1.9, 3.0])) * [2.0, 1.0, 0.5]

    t_array, t_own = [], []
    for clock in clocks:
        own = 0.002 * len(t_own) + np.arange(1500) / RATE_HZ
        t_own.append(own)
        t_array.append(clock.array_time(own))
    back = np.linalg.inv(model.matrices)
    raw = np.stack([(at(t) - model.offsets[i]) @ back[i].T for i, t in enumerate(t_array)], axis=1)
    write_array(tmp_path / "array", model, t_own, raw, np.ones_like(raw))
    logs = [tmp_path / "array" / f"log0001.unit{i}.csv" for i in range(3)]
    model = replace(model, units=tuple(replace(unit, sha256=(sha256_of(path),)) for unit, path in zip(model.units, logs, strict=True)))
    save_array_model(model, tmp_path / "array.json")
    samples, table = said(tmp_path / "array", tmp_path / "array.json")
    assert table["clocks"] == "model"
    truth = at(samples.t_s)
    inner = slice(10, -10)
    assert np.abs(samples.gyro - truth)[inner].max() < 3e-5  # (pi f T)^4 of the fastest, and the rounding of the text
    uncorrected = np.abs(np.einsum("nij,tnj->tni", model.matrices, raw) + model.offsets - truth[:, None]).max()
    assert uncorrected > 0.03


def test_the_interpolation_keeps_the_density_and_holds_no_gap():
    rng = np.random.default_rng(2)
    noise = rng.normal(size=(40_000, 1))
    t_s = np.arange(40_000) * 0.01
    between = Resampler(1)
    between.push(t_s, noise)
    at = t_s[5:-5] + rng.uniform(0, 0.01, len(t_s) - 10)
    found = between.at(at)[:, 0]
    assert found.var() == pytest.approx(0.79, abs=0.03)
    slow = found[: len(found) // 100 * 100].reshape(-1, 100).mean(axis=1)
    assert slow.var() * 100 == pytest.approx(1.0, abs=4 * np.sqrt(2 / len(slow)))
    gap = Resampler(1)
    gap.push(np.r_[0:10, 15:25] * 0.01, np.ones((20, 1)))
    values = gap.at(np.array([0.04, 0.045, 0.095, 0.12, 0.148, 0.15, 0.155]))
    np.testing.assert_array_equal(np.isfinite(values[:, 0]), [True, True, False, False, False, True, True])


def test_pieces_are_as_the_whole():
    rng = np.random.default_rng(3)
    t_s, values = np.cumsum(rng.uniform(0.009, 0.011, 500)), rng.normal(size=(500, 2))
    at = np.sort(rng.uniform(t_s[3], t_s[-4], 700))
    whole = Resampler(2)
    whole.push(t_s, values)
    expected = whole.at(at)
    parts, found, done = Resampler(2), [], 0
    for begin in range(0, 700, 70):
        want = at[begin : begin + 70]
        while parts.ends < want[-1]:
            parts.push(t_s[done : done + 37], values[done : done + 37])
            done += 37
        found.append(parts.at(want))
        parts.forget(float(want[-1]))
    np.testing.assert_allclose(np.concatenate(found), expected, atol=1e-12)
    assert len(parts._t) < 100


def test_force_of_units_off_the_axis_is_moved_to_the_first_one():
    """Exact physics: constant angular acceleration about an axis; each unit's own centripetal and tangential part is gone."""
    positions = [np.zeros(3), np.array([0.1, 0.02, -0.03]), np.array([-0.04, 0.2, 0.05])]
    model = model_of(with_places(units(3), positions=positions))
    t_s = np.arange(50) * 0.01
    omega, change = np.outer(1 + 2 * t_s, [0.5, -1.0, 2.0]), np.tile([1.0, -2.0, 4.0], (50, 1))
    common = np.array([0.3, -0.2, -9.8])
    force = np.stack(
        [
            (common + np.cross(change, r) + np.cross(omega, np.cross(omega, r))) @ unit.place.mounting
            for unit, r in zip(model.units, positions, strict=True)
        ],
        axis=1,
    )
    found = fused_force(model, force, omega, change, np.ones((50, 3), dtype=bool))
    np.testing.assert_allclose(found, np.tile(common, (50, 1)), atol=1e-12)


def test_a_unit_that_is_dead_in_another_recording_stops_nothing(tmp_path):
    """Clocks are found anew there; the dead unit has none, so it gives no samples, and the others are fused as ever."""
    clocks = [UnitClock(), UnitClock(0.007, 2e-3, 1.0), UnitClock(-0.013, -1e-3), UnitClock(0.004, 5e-4)]
    model = model_of(with_places(units(4), clocks))
    save_array_model(model, tmp_path / "array.json")
    omega = motion(3000)
    raw = measured(model, omega)
    raw[:, 2] = 0.01
    t_s = np.arange(3000) / RATE_HZ
    write_array(tmp_path / "array", model, np.tile(t_s, (4, 1)), raw, np.ones_like(raw))
    samples, table = said(tmp_path / "array", tmp_path / "array.json")
    assert table["clocks"] == "found"
    assert [unit["used_share"] for unit in table["units"]][2] == 0.0
    assert any("unit 2 reads one and the same rate throughout" in note for note in table["notes"])
    moments = np.rint((samples.t_ns - samples.t_ns[0]) * NS * RATE_HZ).astype(int)
    sigma = model.noise_density * np.sqrt(RATE_HZ / 2) * np.sqrt(4 / 3)  # of three; a little less, since they are interpolated
    assert np.sqrt(np.mean((samples.gyro - omega[moments]) ** 2, axis=0)) == pytest.approx(sigma, rel=0.15)


def test_logs_of_units_that_the_model_has_not_are_left_out_and_said(tmp_path):
    """A fit leaves a unit out that cannot be used; its model still goes with the array's folder."""
    whole = model_of(with_places(units(4)))
    raw = measured(whole, motion(1000))
    write_array(tmp_path / "array", whole, np.tile(np.arange(1000) / RATE_HZ, (4, 1)), raw, np.ones_like(raw))
    three = model_of([whole.units[i] for i in (0, 1, 3)])
    save_array_model(three, tmp_path / "array.json")
    samples, table = said(tmp_path / "array", tmp_path / "array.json")
    np.testing.assert_allclose(samples.gyro, three(raw[:, [0, 1, 3]]), atol=1e-8)
    assert any("the model has no unit 2" in note for note in table["notes"])


def test_what_does_not_go_together_is_refused_in_one_line(tmp_path, capsys):
    model = model_of(units(3))
    path = tmp_path / "array.json"
    save_array_model(model, path)
    raw = measured(model, motion(50))
    t_s = np.tile(np.arange(50) / RATE_HZ, (3, 1))
    write_array(tmp_path / "array", model, t_s, raw, np.ones_like(raw))
    out = ["-o", str(tmp_path / "out.csv"), "--quiet"]

    def refused(*words):
        assert calibrate.main(["apply", *map(str, words), *out]) == 2
        lines = capsys.readouterr().err.strip().splitlines()
        assert len(lines) == 1
        return lines[0]

    assert "no folder" in refused(path, tmp_path / "array" / "log0001.unit0.csv")
    assert "--session is for one sensor" in refused(path, tmp_path / "array", "--session", tmp_path / "array")
    write_array(tmp_path / "array", model, t_s, raw, np.ones_like(raw), "log0002")
    assert "2 logs; give --which one of log0001, log0002" in refused(path, tmp_path / "array")
    (tmp_path / "array" / "log0002.unit1.csv").unlink()
    assert "logs of units 0, 2, the model has units 0, 1, 2" in refused(path, tmp_path / "array", "--which", "log0002")
    assert not (tmp_path / "out.csv").exists()
    for source in (path, tmp_path / "array"):
        assert calibrate.main(["export", str(source), "--to", "json"]) == 2
        assert (
            capsys.readouterr()
            .err.strip()
            .endswith(f"{source}: an array, and an export holds one sensor; give one unit a folder of its own")
        )


def test_a_joint_fit_becomes_a_model_whose_clocks_hold_for_its_own_recording(tmp_path):
    """Of 24 numbers a unit the first twelve count; its logs are known again."""
    clocks = [UnitClock(), UnitClock(0.004, 1e-4)]
    found = with_places(units(2), clocks)
    model = model_of(found)
    t_array = np.arange(3000) / RATE_HZ
    raw = measured(model, motion(3000))
    own = [t_array, (t_array - clocks[1].offset_s) / (1 + clocks[1].rate)]
    write_array(tmp_path / "array", model, own, raw, np.ones_like(raw))
    array = read_array(tmp_path / "array")
    wide, root = 24, np.random.default_rng(4).normal(size=(48, 48))
    covariance = root @ root.T * 1e-10
    fitted = [
        SimpleNamespace(
            number=i,
            session=array.units[i],
            place=unit.place,
            model=unit.model,
            accelerometer=Accelerometer(),
            covariance=covariance[wide * i : wide * (i + 1), wide * i : wide * (i + 1)],
            noise=Noise(unit.noise_density, np.full(3, 1e-3)),
            instability=BiasInstability(2e-5, "given"),
        )
        for i, unit in enumerate(found)
    ]
    made = array_model_of(array, fitted, covariance)
    assert made.rate_hz == pytest.approx(RATE_HZ)
    np.testing.assert_array_equal(made.joint_covariance[12:, :12], covariance[24:36, :12])
    np.testing.assert_array_equal(made.units[1].covariance, covariance[24:36, 24:36])
    save_array_model(made, tmp_path / "array.json")
    _, table = said(tmp_path / "array", tmp_path / "array.json")
    assert table["clocks"] == "model"
