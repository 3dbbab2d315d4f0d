"""The simulated bench, in the words of physics: what it turns it must show, and nothing else."""

import json
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from conftest import DEG, product, turned
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from session.base.errors import FormatError
from session.base.units import EARTH_RATE_RPS
from session.detect.stills import find_stills
from session.log.registers import gyro_rps_per_lsb
from tinygc import CalibrationError, SimulationOptions, read_session
from tinygc.simulation import simulator, write
from tinygc.simulation.movement import earth_rate_table, hand_plan, motion_of, move, table_to_body
from tinygc.simulation.options import GYRO_LPF2_HZ, in_python
from tinygc.simulation.sensor import Flicker, LowPass, oversampling
from tinygc.simulation.simulator import simulate_session
from tinygc.simulation.write import write_session

SHORT = SimulationOptions(segments=3, closure_s=20, seed=5)
QUIET = replace(SHORT, gyro_noise_dps_rthz=0, accel_noise_ug_rthz=0, bias_instability_dph=0)


def attitude(angles):
    """R_tb of gimbal angles (3, ...) outer, middle, inner."""
    return Rotation.from_euler("ZYX", np.moveaxis(angles, 0, -1))


def test_true_rate_integrates_to_the_attitude_and_acceleration_is_its_derivative():
    plan = hand_plan(SimulationOptions(segments=4, closure_s=20), np.random.default_rng(1))
    angles = move(plan, np.array([0.0, plan.duration_s])).angles
    first, last = attitude(angles)
    turn = turned(lambda t_s: move(plan, t_s).rate, plan.duration_s, fine_hz=1000.0)
    assert (last.inv() * first * turn).magnitude() < 1e-7
    motion = move(plan, np.arange(0, plan.duration_s, 1e-3))
    slope = (motion.rate[2:] - motion.rate[:-2]) / 2e-3
    assert np.abs(slope - motion.acceleration[1:-1]).max() < 1e-3 * np.abs(motion.acceleration).max()


def test_at_rest_it_feels_gravity_and_the_earth_and_in_a_turn_the_lever_arm():
    simulation = simulate_session(SHORT)
    start_s, stop_s = simulation.plan.turns[0]
    t_s = np.array([start_s - 0.1, (start_s + stop_s) / 2])
    motion = move(simulation.plan, t_s)
    rate, force, _ = motion_of(SHORT, simulation.unit, simulation.plan)(t_s)
    to_body = attitude(motion.angles).inv()
    gravity = to_body.apply([0, 0, -SHORT.gravity_mps2])
    assert_allclose(force[0], gravity[0], atol=1e-12)
    to_table = Rotation.from_euler("ZY", [-simulation.unit.heading_deg, SHORT.latitude_deg], degrees=True)
    assert_allclose(rate[0], to_body[0].apply(to_table.apply([EARTH_RATE_RPS, 0, 0])), atol=1e-12)
    # The sensor's position in the table, differentiated twice.
    step_s = 1e-4
    near = move(simulation.plan, t_s[1] + np.array([-step_s, 0, step_s]))
    place = attitude(near.angles).apply(SHORT.lever_m)
    acceleration = attitude(near.angles)[1].inv().apply(place[0] - 2 * place[1] + place[2]) / step_s**2
    assert np.linalg.norm(acceleration) > 0.01
    assert_allclose(force[1] - gravity[1], acceleration, atol=1e-4)


@pytest.mark.parametrize("odr_hz", [104, 1667])
def test_noise_has_the_stated_density_after_the_low_pass(odr_hz):
    factor, block = oversampling(odr_hz), int(odr_hz / 5)
    still = np.zeros((600 * block * factor, 3))
    noise = LowPass(GYRO_LPF2_HZ[odr_hz], 0.005, odr_hz, np.random.default_rng(6))(still)
    means = noise.reshape(-1, block, 3).mean(axis=1)
    assert np.sqrt(2 * means.var() * block / odr_hz) == pytest.approx(0.005, rel=0.06)


def test_flicker_goes_on_where_its_stretch_ends():
    """Between two moments it changes as much across the end of a stretch as within one, and is as large behind it."""
    drawn = [Flicker(1.0, 4.0, np.random.default_rng(seed))(np.array([1.9, 2.2, 3.9, 4.2, 9.0])) for seed in range(300)]
    early, within, last, beyond, later = np.moveaxis(drawn, 1, 0)
    assert np.std(beyond - last) == pytest.approx(np.std(within - early), rel=0.1)
    assert np.std(later) == pytest.approx(np.std(early), rel=0.1)
    assert np.corrcoef(last.ravel(), beyond.ravel())[0, 1] > 0.9


def test_filters_begin_at_rest_and_a_sensor_without_noise_closes():
    """Less its errors: what is left over 20 s is the register's step and the integration's, below 0.03 deg."""
    simulation = simulate_session(QUIET)
    first, log = slice(0, int(1.5 * SHORT.odr_hz)), simulation.closure
    assert np.ptp(simulation.log.accel[first], axis=0).max() == np.ptp(simulation.log.gyro[first], axis=0).max() == 0
    t_s = log.t_us * 1e-6
    angles = move(simulation.plan, t_s).angles
    unit = simulation.unit
    earth = table_to_body(angles, earth_rate_table(QUIET.latitude_deg * DEG, unit.heading_deg * DEG))
    rate = log.gyro * gyro_rps_per_lsb(QUIET.gyro_fs_dps) @ unit.E.T + unit.B - earth
    dt = np.diff(t_s)[:, None]
    steps = dt * (rate[1:] + rate[:-1]) / 2 + dt**2 / 6 * np.cross(rate[:-1], rate[1:])  # from rest to rest
    turn = (t_s[:-1] > simulation.plan.closure[0]) & (t_s[1:] < simulation.plan.closure[1] + 0.05)
    assert product(Rotation.from_rotvec(steps[turn])).magnitude() < 0.03 * DEG


def test_stamps_show_the_true_rate():
    simulation = simulate_session(replace(SHORT, odr_error=0.02))
    stamps = np.concatenate([simulation.log.t_us, simulation.closure.t_us])
    true_hz = 208 * (1 + 0.0015 * 13)  # 0.02 in steps of 0.0015
    assert simulation.unit.odr_hz == pytest.approx(true_hz)
    assert_array_equal(stamps, np.rint(np.arange(len(stamps)) / true_hz * 1e6))
    assert len(simulation.closure.t_us) / true_hz == pytest.approx(20, abs=0.01)


def test_registers_are_16_bit_and_cut_at_full_scale_which_turns_do_not_reach():
    simulation = simulate_session(SHORT, distort=lambda t_s, rate, force, temp_c: rate * 50)
    assert {registers.dtype for registers in (simulation.log.gyro, simulation.log.accel, simulation.log.temp)} == {np.dtype(np.int16)}
    assert np.abs(simulation.log.gyro.astype(int)).max() == round(500 / 0.0175)
    log = simulate_session(SimulationOptions(segments=12, closure_s=0, seed=9, gyro_fs_dps=125, vigour=3, odr_hz=104.0)).log
    assert 0.5 * 125 < np.abs(log.gyro * gyro_rps_per_lsb(125) / DEG).max() < 0.9 * 125


def test_distort_adds_to_the_true_rate_and_sees_what_the_elements_feel():
    seen, added = {}, np.array([3.0, -2.0, 1.0]) * DEG

    def distort(t_s, rate, force, temp_c):
        seen.update(t_s=t_s, force=force, temp_c=temp_c)
        return rate + added

    options = replace(SHORT, closure_s=0, gyro_scale_error=0, gyro_misalignment=0)  # the same noise in both: it dithers the registers
    plain, distorted = simulate_session(options), simulate_session(options, distort)
    shift = (distorted.log.gyro.astype(int) - plain.log.gyro) * gyro_rps_per_lsb(options.gyro_fs_dps)
    assert_allclose(shift.mean(axis=0), added, atol=1e-3 * DEG)
    assert np.linalg.norm(seen["force"][0]) == pytest.approx(options.gravity_mps2)
    assert seen["t_s"].shape == seen["temp_c"].shape
    with pytest.raises(ValueError, match="distort"):
        simulate_session(options, lambda t_s, rate, force, temp_c: rate[:-1])


def test_purposes_have_their_own_stream_and_a_folder_reads_like_a_recorded_one(tmp_path):
    options = SimulationOptions(segments=8, closure_s=10, seed=10, odr_hz=62.5, with_heading=True)
    first, second = (write_session(options, tmp_path / name) for name in "ab")
    names = sorted(path.name for path in first.iterdir())
    assert names == ["closure0001.csv.gz", "log0001.csv.gz", "session.toml", "truth.json"]
    assert all((first / name).read_bytes() == (second / name).read_bytes() for name in names)
    other = write_session(replace(options, gyro_noise_dps_rthz=0.01), tmp_path / "c")
    truth, again = (json.loads((folder / "truth.json").read_text()) for folder in (first, other))
    assert all(truth[key] == again[key] for key in ("E", "B_dps", "turns_s", "closure_s", "odr_hz"))
    assert (first / "log0001.csv.gz").read_bytes() != (other / "log0001.csv.gz").read_bytes()
    session = read_session(first)
    (log,), (closure,) = session.logs, session.closures
    assert session.config.site.heading_deg == truth["heading_deg"]
    assert float(log.comments["odr_hz"]) == pytest.approx(truth["odr_hz"], abs=1e-3)
    assert (log.comments["serial"], session.config.sensor.serial, log.notes) == ("SIM-10", "SIM-10", ())
    assert closure.samples.t_ns[0] - log.samples.t_ns[-1] == pytest.approx(log.samples.period_s * 1e9, abs=2000)
    stills, noise = find_stills(session.calibrated(log), session.config.protocol.still_s)
    assert len(stills) == 9
    assert_allclose(noise.gyro / DEG, 0.005, rtol=0.25)
    assert_allclose([still.gravity_mps2 for still in stills], options.gravity_mps2, atol=2e-3)


def test_a_file_says_how_to_make_it_again_and_nothing_but_a_simulation_is_replaced(tmp_path):
    options = replace(SHORT, with_heading=True, odr_hz=104.0, heading_deg=-12.5)
    expected = "tinygc.simulate(segments=3, closure_s=20, seed=5, odr_hz=104.0, heading_deg=-12.5, with_heading=True)"
    assert in_python(options) == expected
    folder = write_session(options, tmp_path / "s")
    head = (folder / "session.toml").read_text().splitlines()[0]
    assert ("SIMULATED" in head, expected in head) == (True, True)
    with pytest.raises(FormatError, match="not empty"):
        write_session(SHORT, folder)
    write_session(replace(SHORT, closure_s=0), folder, force=True)
    session = read_session(folder)
    assert (session.config.site.heading_deg, session.closures) == (None, ())
    (folder / "truth.json").unlink()
    with pytest.raises(FormatError, match="no simulation"):
        write_session(SHORT, folder, force=True)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"odr_hz": 300}, "odr_hz is 300, expected one of 62.5, 104, 208"),
        ({"segments": 0}, "segments"),
        ({"closure_s": 3}, "closure_s is 3"),
        ({"gyro_fs_dps": 300}, "no ASM330LHH full scale"),
        ({"gyro_noise_dps_rthz": float("nan")}, "gyro_noise"),
    ],
)
def test_wrong_options_are_named(wrong, message):
    with pytest.raises(CalibrationError, match=message):
        SimulationOptions(**wrong)


@pytest.mark.broad
def test_pieces_are_the_whole_and_hours_take_no_more_memory_than_minutes(tmp_path, monkeypatch):
    """An effect that changes nothing has the movement computed at once."""
    monkeypatch.setattr(simulator, "PIECE", 1 << 11)
    monkeypatch.setattr(write, "ROWS", 1 << 11)
    options = SimulationOptions(segments=10, closure_s=0.0, seed=4)
    whole = simulate_session(options, lambda t_s, rate, force, temp_c: rate).log
    assert len(whole.t_us) > 4 * simulator.PIECE
    tracemalloc.start()
    try:
        write_session(options, tmp_path / "s")
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 15e6
    logged = np.loadtxt(tmp_path / "s" / "log0001.csv.gz", delimiter=",", skiprows=2, dtype=np.int64)
    assert_array_equal(logged, np.column_stack([whole.t_us, whole.gyro, whole.accel, whole.temp]))
