"""Simulated arrays: one motion that each unit feels in its own place, by its own clock; jerks that come back."""

import json

import numpy as np
import pytest
from conftest import DEG, product
from formats_page import strangers
from scipy.spatial.transform import Rotation

import calibrate
from session.annexes.arrays.recording import read_array
from session.io.errors import FormatError
from tinygc import CalibrationError, SimulationOptions
from tinygc.annexes.arrays.options import ArrayOptions
from tinygc.annexes.arrays.simulation import Jerks, jerks_in_turns, simulate_array, write_array
from tinygc.simulation import movement
from tinygc.simulation.simulator import plan_of

QUIET = {"gyro_noise_dps_rthz": 0.0, "accel_noise_ug_rthz": 0.0, "bias_instability_dph": 0.0, "odr_error": 0.0, "vigour": 0.5}


def options(**more) -> SimulationOptions:
    return SimulationOptions(**{"segments": 3, "closure_s": 0, "odr_hz": 208, "seed": 7, **more})


def test_units_feel_one_motion_each_in_its_own_axes():
    """Without noise every unit's true rate, in the first one's axes, is the same but for the registers' steps."""
    made = simulate_array(options(**QUIET), ArrayOptions(units=3, clock_rate=0.0, clock_offset_ms=0.0))
    lsb = made.options.register_units.gyro_rps
    body = []
    for unit, truth in zip(made.units, made.truths, strict=True):
        rate = unit.log.gyro * lsb @ unit.unit.E.T + unit.unit.B
        body.append(rate @ truth.mounting.T)
    for other in body[1:]:
        assert np.abs(other - body[0]).max() < 3 * lsb
    assert np.abs(body[0]).max() > 1000 * lsb


def test_forces_differ_by_where_units_are():
    """a_i - a_0 = alpha x r + omega x (omega x r), within registers and the accelerometer's filter."""
    made = simulate_array(options(**QUIET), ArrayOptions(units=2, position_mm=200.0, clock_rate=0.0, clock_offset_ms=0.0))
    step = made.options.register_units.accel_mps2
    force = []
    for unit, truth in zip(made.units, made.truths, strict=True):
        f = (unit.log.accel * step - unit.unit.accel_bias) @ unit.unit.accel_matrix.T
        force.append(f @ truth.mounting.T)
    motion = movement.move(made.plan, made.units[0].log.t_us * 1e-6)
    r = made.truths[1].position_m
    expected = np.cross(motion.acceleration, r) + np.cross(motion.rate, np.cross(motion.rate, r))
    late = 2  # samples of the accelerometer's filter, about
    off = (force[1] - force[0])[late:] - expected[:-late]
    assert np.abs(expected).max() > 0.4
    assert np.sqrt(np.mean(off**2)) < 0.08 * np.sqrt(np.mean(expected**2)) + step


def test_a_jerk_comes_back_and_is_exact():
    """Its rate is its angle's derivative, and a body that jerks ends where it would have."""
    jerks = Jerks(np.array([1.0, 1.3]), np.array([0.02, -0.01]), np.array([0.6, 0.0, 0.8]), 0.01)
    t_s = np.linspace(0.5, 1.8, 13001)
    angle, rate, acceleration = jerks.angle(t_s)
    assert np.abs(np.gradient(angle, t_s) - rate).max() < 1e-4 * np.abs(rate).max()
    assert np.abs(np.gradient(rate, t_s) - acceleration).max() < 1e-3 * np.abs(acceleration).max()
    steady = np.tile([0.3, -0.2, 0.5], (len(t_s), 1))
    whole, plain = (np.diff(t_s)[:, None] * (r[1:] + r[:-1]) / 2 for r in (jerks.rate(t_s, steady), steady))
    jerked, straight = (product(Rotation.from_rotvec(steps)) for steps in (whole, plain))
    assert (jerked.inv() * straight).magnitude() < 1e-6


def test_clocks_stamp_as_they_say():
    made = simulate_array(options(odr_error=0.0), ArrayOptions(units=3, clock_rate=0.003, clock_offset_ms=30.0))
    first = made.units[0].log.t_us * 1e-6
    for unit, truth in zip(made.units, made.truths, strict=True):
        own = unit.log.t_us * 1e-6
        assert np.abs(own * (1 + truth.rate) + truth.offset_s - first[: len(own)]).max() < 2e-6
    together = simulate_array(options(), ArrayOptions(units=3, synchronous=True))
    assert all(np.array_equal(unit.log.t_us, together.units[0].log.t_us) for unit in together.units)


def test_jerks_lie_in_turns_and_units_differ_only_by_themselves():
    plan = plan_of(options())
    jerks = jerks_in_turns(plan, DEG, 208.0, np.random.default_rng(1))
    assert len(jerks.at_s) == 9
    assert all(any(a < at < b for a, b in plan.turns) for at in jerks.at_s)
    made = simulate_array(options(), ArrayOptions(units=3))
    errors = [unit.unit.E for unit in made.units]
    assert all(np.abs(errors[0] - other).max() > 1e-4 for other in errors[1:])
    assert made.truths[0].mounting.tolist() == np.eye(3).tolist()
    again = simulate_array(options(), ArrayOptions(units=3))
    assert all(np.array_equal(a.log.gyro, b.log.gyro) for a, b in zip(made.units, again.units, strict=True))


def test_the_command_writes_what_the_reader_reads(tmp_path):
    folder, table = tmp_path / "array", tmp_path / "x.json"
    words = [
        "simulate",
        "--units",
        "3",
        "--segments",
        "3",
        "--closure",
        "12",
        "--odr-hz",
        "104",
        "--out",
        str(folder),
        "--json",
        str(table),
    ]
    assert calibrate.main([*words, "--quiet"]) == 0
    array = read_array(folder)
    assert array.numbers == (0, 1, 2)
    assert all(len(unit.logs) == 1 and len(unit.closures) == 1 for unit in array.units)
    assert len({unit.config.sensor.serial for unit in array.units}) == 3
    assert all(not unit.config.unknown for unit in array.units)
    truth = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    assert truth["schema"] == "tinygc-array-truth/1"
    assert not strangers(truth)
    assert not strangers(json.loads(table.read_text(encoding="utf-8")))
    before = (folder / "log0001.unit1.csv.gz").read_bytes()
    assert calibrate.main([*words, "--quiet", "--force"]) == 0
    assert (folder / "log0001.unit1.csv.gz").read_bytes() == before
    assert calibrate.main([*words, "--quiet"]) == 2


def test_nothing_but_a_simulation_is_replaced(tmp_path):
    made = simulate_array(options(segments=1), ArrayOptions(units=2))
    folder = write_array(made, tmp_path / "array")
    (folder / "notes.txt").write_text("mine")
    with pytest.raises(FormatError, match=r"notes\.txt"):
        write_array(made, folder, force=True)
    (folder / "notes.txt").unlink()
    (folder / "session.toml").write_text('schema = "tinygc-session/1"\n')
    with pytest.raises(FormatError, match="not replaced"):
        write_array(made, folder, force=True)


def test_options_that_cannot_be(tmp_path, capsys):
    for wrong in ({"units": 0}, {"units": 65}, {"mounting_deg": -1.0}, {"clock_rate": float("nan")}, {"jerk_deg": 11.0}):
        with pytest.raises(CalibrationError, match="expected"):
            ArrayOptions(**wrong)
    assert calibrate.main(["simulate", "--mounting-deg", "3", "--out", str(tmp_path / "a"), "--quiet"]) == 2
    assert "--units" in capsys.readouterr().err
