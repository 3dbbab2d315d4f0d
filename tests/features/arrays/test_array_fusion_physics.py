"""The best combination of units: its weights, rate, sigma and file, and ``apply`` of it to a folder of units with clocks of their own."""

import json
from dataclasses import replace
from functools import reduce
from operator import getitem

import numpy as np
import pytest
from formats_page import strangers
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

import calibrate
from session.base.errors import FormatError
from session.base.records import table_of, write_whole
from session.base.units import DEG, NS, G
from session.detect.events import FULL_SCALE_ROUNDING
from session.log.config import Accelerometer, Sensor
from session.log.folder import sha256_of
from session.log.logfile import read_log
from tinygc.features.arrays.apply import _fused_force
from tinygc.features.arrays.clocks import UnitClock
from tinygc.features.arrays.model import FusedUnit, Resampler, best_weights, combined, fuse, load_array_model, with_best_weights
from tinygc.models.linear import LinearModel

RATE_HZ = 100.0


DENSITY = 0.01 * DEG  #: rad/s/sqrt(Hz)


def units(count=8, seed=1, density=DENSITY, full_scale=2000):
    """Units in any mounting, each with its own E and B; density: of all, or one for each."""
    rng = np.random.default_rng(seed)
    densities = np.broadcast_to(np.asarray(density, dtype=float), (count,))
    found = []
    for i in range(count):
        mounting = np.eye(3) if i == 0 else Rotation.random(random_state=seed + i).as_matrix()
        model = LinearModel(np.eye(3) + 0.01 * rng.normal(size=(3, 3)), 0.5 * DEG * rng.normal(size=3))
        sensor = Sensor("MPU-9150", f"s{i}", RATE_HZ, full_scale, 4.0)
        noise = {"noise_density_rps_rthz": np.full(3, densities[i]), "bias_instability_rps": np.full(3, 2e-5)}
        of_model = {"E": model.E, "B": model.B, "covariance": np.diag([1e-8] * 9 + [1e-10] * 3)}
        found.append(FusedUnit(number=i, mounting=mounting, clock=UnitClock(), sensor=sensor, weights=np.eye(3), **noise, **of_model))
    return found


def model_of(found, **options):
    """The model of units."""
    return with_best_weights(found, RATE_HZ, **options)


def motion(samples, seed=3):
    """(T, 3) rad/s: a smooth hand's motion with rests."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(samples) / RATE_HZ
    phase, turn = rng.uniform(0, 2 * np.pi, 6), np.zeros((samples, 3))
    for k, hz in enumerate((0.11, 0.23, 0.41, 0.77, 1.3, 0.05)):
        turn[:, k % 3] += np.sin(2 * np.pi * hz * t_s + phase[k]) / 2
    return 200.0 * DEG * turn * (np.sin(2 * np.pi * 0.03 * t_s) > -0.3)[:, None]


def measured(model, omega, seed=5):
    """(T, N, 3) rad/s that the units read at true rates (T, 3) in the array's frame, each with its own white noise."""
    rng = np.random.default_rng(seed)
    clean = np.einsum("nij,tnj->tni", np.linalg.inv(model.matrices), omega[:, None] - model.offsets)
    sigma = np.stack([unit.noise_density_rps_rthz for unit in model.units]) * np.sqrt(model.rate_hz / 2)
    return clean + sigma * rng.normal(size=clean.shape)


# The best combination.


RNG = np.random.default_rng(16)


def test_no_other_unbiased_combination_has_less_noise():
    """Gauss and Markov: any other weights that sum to identity have a covariance greater by a positive matrix."""
    root = RNG.normal(size=(12, 12))
    covariance = root @ root.T + 12 * np.eye(12)
    weights, fused = best_weights(covariance)
    assert_allclose(weights.sum(axis=0), np.eye(3), atol=1e-12)
    assert_allclose(combined(weights, covariance), fused, rtol=1e-10)
    for _ in range(20):
        change = RNG.normal(size=(4, 3, 3)) * 0.1
        assert np.linalg.eigvalsh(combined(weights + change - change.mean(axis=0), covariance) - fused)[0] > 0


def test_the_file_gives_the_model_back_and_stands_on_the_page(tmp_path):
    found = [replace(unit, sha256=("0" * 64, "1" * 64)) for unit in units(3)]
    model = model_of(found, joint_covariance=np.eye(36) * 1e-8, session="a\nb")
    write_whole(tmp_path / "array.json", model)
    again = load_array_model(tmp_path / "array.json")
    assert table_of(again) == table_of(model)
    raw = RNG.normal(size=(5, 3, 3))
    assert_array_equal(again(raw), model(raw))
    assert not strangers(json.loads((tmp_path / "array.json").read_text()))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({("units", 1, "E"): [[1, 0, 0], [1, 0, 0], [0, 0, 1]]}, r"units\[1\].E is singular"),
        ({("units", 2, "mounting"): [[1, 0, 0], [0, 1, 0], [0, 0, 1.01]]}, "is no rotation"),
        ({("units", 0, "weights"): np.eye(3).tolist()}, "miss identity by"),
        ({("units", i, "weights"): (np.eye(3) * share).tolist() for i, share in enumerate((1.5, -1.0, 0.5))}, "not positive"),
        ({("units", 0, "covariance"): (-np.eye(12)).tolist()}, "not positive"),
    ],
)
def test_what_is_no_model_is_refused_in_one_line(changes, said, tmp_path):
    table, path = table_of(model_of(units(3))), tmp_path / "array.json"
    path.write_text(json.dumps(table | {"units": table["units"][:1]}))
    with pytest.raises(FormatError, match="units has 1 entries, expected 2"):
        load_array_model(path)
    for (*where, key), value in changes.items():
        reduce(getitem, where, table)[key] = value
    path.write_text(json.dumps(table))
    with pytest.raises(FormatError, match=said) as caught:
        load_array_model(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(path))


# The fused rate.


#: just below and just above the reading at which a unit is at its end
BELOW, ABOVE = (1 - FULL_SCALE_ROUNDING) * 250 * DEG * np.array([1 - 1e-9, 1 + 1e-9])


def plain(density, **options):
    """Units with E = 1, B = 0 and no mounting, of 250 dps; nothing is known of their parameters."""
    found = units(len(density), density=density, full_scale=250)
    nothing = {"E": np.eye(3), "B": np.zeros(3), "mounting": np.eye(3), "bias_instability_rps": None, "covariance": None}
    return model_of([replace(unit, **nothing) for unit in found], **options)


def along_x(*readings):
    """(T, N, 3): values along x of each unit, NaN for no sample."""
    raw = np.zeros((len(readings), len(readings[0]), 3))
    raw[..., 0] = readings
    return raw


def test_the_rate_of_the_units_that_are_left_and_its_sigma():
    """Densities 0.1, 0.2, 0.2 at 100 Hz: variances 0.5, 2, 2 a sample; weights 4, 1, 1, of those that are left."""
    rate, sigma, used = fuse(plain([0.1, 0.2, 0.2]), along_x([1, 2, 3], [1, np.nan, 2], [np.nan, np.nan, 3], [np.nan] * 3))
    assert_allclose(rate[:3, 0], [9 / 6, 6 / 5, 3])
    assert_allclose(sigma[:3], np.sqrt([1 / 3, 0.4, 2])[:, None] * np.ones(3))
    assert np.isnan(rate[3]).all()
    assert np.isnan(sigma[3]).all()
    assert_array_equal(used.sum(axis=1), [3, 2, 1, 0])


def test_the_sigma_holds_that_of_the_parameters_where_it_is_known():
    known = model_of(units(3))
    for model, count, own in ((plain([0.1, 0.2]), 2, 0.0), (known, 3, known.bias_sigma)):
        assert_allclose(fuse(model, np.zeros((count, 3)))[1][0], np.hypot(model.noise_density * np.sqrt(RATE_HZ / 2), own))


def test_a_reading_at_the_end_of_a_range_is_used_only_where_all_are():
    rate, sigma, used = fuse(plain([0.1, 0.1]), along_x([BELOW, ABOVE], [-ABOVE, 1], [ABOVE, -ABOVE], [ABOVE, np.nan]))
    assert_array_equal(used, [[True, False], [False, True], [True, True], [True, False]])
    assert_allclose(rate[:, 0], [BELOW, 1, 0, ABOVE], atol=1e-12)
    assert_array_equal(np.isinf(sigma).all(axis=1), [False, False, True, True])


# Between samples, and forces.
def test_the_interpolation_keeps_the_density_holds_no_gap_and_pieces_are_as_the_whole():
    rng = np.random.default_rng(2)
    noise, t_s = rng.normal(size=(40_000, 1)), np.arange(40_000) * 0.01
    at = t_s[5:-5] + rng.uniform(0, 0.01, len(t_s) - 10)
    found = whole(t_s, noise, at)[:, 0]
    assert found.var() == pytest.approx(0.79, abs=0.03)
    slow = found[: len(found) // 100 * 100].reshape(-1, 100).mean(axis=1)
    assert slow.var() * 100 == pytest.approx(1.0, abs=4 * np.sqrt(2 / len(slow)))
    values = whole(np.r_[0:10, 15:25] * 0.01, np.ones((20, 1)), np.array([0.04, 0.045, 0.095, 0.12, 0.148, 0.15, 0.155]))
    assert_array_equal(np.isfinite(values[:, 0]), [True, True, False, False, False, True, True])
    parts, found, done = Resampler(1), [], 0
    for want in np.split(at[:700], 10):
        while parts.ends < want[-1]:
            parts.push(t_s[done : done + 37], noise[done : done + 37])
            done += 37
        found.append(parts.at(want))
        parts.forget(float(want[-1]))
    assert_allclose(np.concatenate(found), whole(t_s[:1000], noise[:1000], at[:700]), atol=1e-12)
    assert len(parts._t) < 100


def whole(t_s, values, at):
    resampler = Resampler(1)
    resampler.push(t_s, values)
    return resampler.at(at)


def test_force_of_units_off_the_axis_is_moved_to_the_first_one():
    """Exact physics: constant angular acceleration about an axis; each unit's own centripetal and tangential part is gone."""
    positions = [np.zeros(3), np.array([0.1, 0.02, -0.03]), np.array([-0.04, 0.2, 0.05])]
    model = model_of(with_places(units(3), positions=positions))
    t_s = np.arange(50) * 0.01
    omega, change = np.outer(1 + 2 * t_s, [0.5, -1.0, 2.0]), np.tile([1.0, -2.0, 4.0], (50, 1))
    common = np.array([0.3, -0.2, -9.8])
    moved = [common + np.cross(change, r) + np.cross(omega, np.cross(omega, r)) for r in positions]
    force = np.stack([each @ unit.mounting for each, unit in zip(moved, model.units, strict=True)], axis=1)
    found = _fused_force(model, force, omega, change, np.ones((50, 3), dtype=bool))
    assert_allclose(found, np.tile(common, (50, 1)), atol=1e-12)


# ``apply`` to a folder.


TOML = """schema = "tinygc-session/1"

[sensor]
model = "MPU-9150"
serial = "array"
odr_hz = 100.0
gyro_fs_dps = 2000
accel_fs_g = 4

[array]
"""


def write_array(folder, model, t_s, raw, force, which="log0001"):
    """Logs of all units: t_s (N, T) s on their own clocks, raw and force (T, N, 3)."""
    folder.mkdir(exist_ok=True)
    (folder / "session.toml").write_text(TOML)
    for i, number in enumerate(model.numbers):
        lines = ["t_ns,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"]
        for t, m, f in zip(t_s[i], raw[:, i] / DEG, force[:, i] / G, strict=True):
            lines.append(f"{round(t / NS)},{','.join(f'{v:.7f}' for v in (*m, *f))}")
        (folder / f"{which}.unit{number}.csv").write_text("\n".join(lines) + "\n")


ONE_CLOCK, NO_PLACE = [UnitClock()] * 4, [None] * 4


def with_places(found, clocks=ONE_CLOCK, positions=NO_PLACE):
    """Units with an accelerometer, on clocks, at positions."""
    return [
        replace(unit, accelerometer=Accelerometer(), clock=clock, position_m=at)
        for unit, clock, at in zip(found, clocks, positions, strict=False)
    ]


def said(folder, model_path, *more):
    out, told = folder.parent / "fused.csv", folder.parent / "said.json"
    code = calibrate.main(["apply", str(model_path), str(folder), "-o", str(out), "--force", "--quiet", "--json", str(told), *more])
    assert code == 0
    table = json.loads(told.read_text())
    assert not strangers(table)
    return read_log(out, model_of(units(2)).units[0].sensor).samples, table


def test_a_folder_becomes_one_log_with_the_best_rate(tmp_path):
    """Unit 2 leaves its range meanwhile; unit 3 has a log and is not in the model, as where a fit left it out."""
    four = model_of(with_places(units(4)))
    model = model_of(four.units[:3])
    write_whole(tmp_path / "array.json", model)
    omega = motion(1000)
    raw = measured(four, omega)
    raw[450:700, 2, 1] = 2000 * DEG
    level = np.einsum("nji,j->ni", np.stack([unit.mounting for unit in four.units]), [0, 0, -G])
    write_array(tmp_path / "array", four, np.tile(np.arange(1000) / RATE_HZ, (4, 1)), raw, np.tile(level, (1000, 1, 1)))
    samples, table = said(tmp_path / "array", tmp_path / "array.json")
    assert len(samples) == table["rows"] == 1000
    assert (table["clocks"], table["at_end"]) == ("same", 0)
    assert [unit["used_share"] for unit in table["units"]] == [1.0, 1.0, 0.75]
    good = np.r_[0:450, 700:1000]
    assert_allclose(samples.gyro[good], model(raw[:, :3])[good], atol=1e-8)  # all are in, and the stamps are the same
    assert np.abs(samples.gyro - omega).max() < 6 * model.noise_density.max() * np.sqrt(RATE_HZ / 2 * 1.5)
    assert_allclose(samples.accel, np.tile([0, 0, -G], (1000, 1)), atol=1e-5)
    for note in ("lever arms of units 1, 2 are left out", "the model has no unit 3"):
        assert any(note in each for each in table["notes"])


CLOCKS = [UnitClock(), UnitClock(0.007, 2e-3, 1.0), UnitClock(-0.013, -1e-3)]


def test_units_on_clocks_of_their_own_are_brought_to_the_first_ones(tmp_path):
    """2000 ppm and 7 ms apart: what is left of a motion of 3 Hz is below the noise."""
    model = model_of([replace(unit, noise_density_rps_rthz=np.full(3, 1e-9)) for unit in with_places(units(3), CLOCKS)])

    def at(t_s):
        return np.sin(2 * np.pi * np.outer(t_s, [0.7, 1.9, 3.0])) * [2.0, 1.0, 0.5]

    t_own = [0.002 * i + np.arange(700) / RATE_HZ for i in range(3)]
    t_array = [clock.array_time(own) for clock, own in zip(CLOCKS, t_own, strict=True)]
    back = np.linalg.inv(model.matrices)
    raw = np.stack([(at(t) - model.offsets[i]) @ back[i].T for i, t in enumerate(t_array)], axis=1)
    write_array(tmp_path / "array", model, t_own, raw, np.ones_like(raw))
    hashes = [(sha256_of(tmp_path / "array" / f"log0001.unit{i}.csv"),) for i in range(3)]
    known = replace(model, units=tuple(replace(unit, sha256=each) for unit, each in zip(model.units, hashes, strict=True)))
    write_whole(tmp_path / "array.json", known)
    samples, table = said(tmp_path / "array", tmp_path / "array.json")
    assert table["clocks"] == "model"
    off = np.abs(samples.gyro - at(samples.t_s))[10:-10].max()
    assert off < 3e-5  # (pi f T)^4 of the fastest, and the rounding of the text
    assert np.abs(np.einsum("nij,tnj->tni", model.matrices, raw) + model.offsets - at(samples.t_s)[:, None]).max() > 0.03


def test_a_unit_that_is_dead_in_another_recording_stops_nothing(tmp_path):
    """Clocks are found anew there; the dead unit has none, so it gives no samples, and the others are fused as ever."""
    model = model_of(with_places(units(4), [*CLOCKS, UnitClock(0.004, 5e-4)]))
    write_whole(tmp_path / "array.json", model)
    omega = motion(3000)
    raw = measured(model, omega)
    raw[:, 2] = 0.01
    write_array(tmp_path / "array", model, np.tile(np.arange(3000) / RATE_HZ, (4, 1)), raw, np.ones_like(raw))
    samples, table = said(tmp_path / "array", tmp_path / "array.json")
    assert table["clocks"] == "found"
    assert table["units"][2]["used_share"] == 0.0
    assert any("unit 2 reads one and the same rate throughout" in note for note in table["notes"])
    moments = np.rint((samples.t_ns - samples.t_ns[0]) * NS * RATE_HZ).astype(int)
    sigma = model.noise_density * np.sqrt(RATE_HZ / 2) * np.sqrt(4 / 3)  # of three; a little less, since they are interpolated
    assert np.sqrt(np.mean((samples.gyro - omega[moments]) ** 2, axis=0)) == pytest.approx(sigma, rel=0.15)


def test_what_does_not_go_together_is_refused_in_one_line(tmp_path, capsys):
    model, path, array = model_of(units(3)), tmp_path / "array.json", tmp_path / "array"
    write_whole(path, model)
    raw = measured(model, motion(50))
    for which in ("log0001", "log0002"):
        write_array(array, model, np.tile(np.arange(50) / RATE_HZ, (3, 1)), raw, np.ones_like(raw), which)
    (array / "log0002.unit1.csv").unlink()
    out = ["-o", tmp_path / "out.csv", "--quiet"]
    for words, says in (
        (["apply", path, array / "log0001.unit0.csv", *out], "no folder"),
        (["apply", path, array, *out], "2 logs; give --which one of log0001, log0002"),
        (["apply", path, array, *out, "--which", "log0002"], "logs of units 0, 2, the model has units 0, 1, 2"),
    ):
        assert calibrate.main([*map(str, words)]) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert says in line
    assert not (tmp_path / "out.csv").exists()
