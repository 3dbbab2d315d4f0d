"""Public sets as session folders (``benchmarks/public``): what is in the authors' files is in the folders, to the digit; what is damaged
is refused in one line."""

from pathlib import Path

import numpy as np
import pytest
from conftest import DEG, Table
from looks import of
from public_files import (
    mikov_text,
    mimu_data,
    mimu_frames,
    write_euroc,
    write_mimu,
    write_xsens,
)

import tinygc
from benchmarks.public.__main__ import main
from benchmarks.public.broad import read_hdf5
from benchmarks.public.euroc import to_down, write_training_windows
from benchmarks.public.mimu import read_frames
from benchmarks.public.writing import from_stills
from benchmarks.public.xsens import ACCEL_PER_MPS2, BY_IMU_TK, GYRO_PER_RPS
from session.io.units import G
from tinygc import read_session
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.residual import closure_angles

TRIAL = "05_undisturbed_slow_rotation_with_breaks_B.hdf5"


def refused(capsys, arguments, *words):
    """Exit code 2, one line that says every word, and nothing else."""
    assert main(list(map(str, arguments))) == 2
    out, err = capsys.readouterr()
    assert len(err.strip().split("\n")) == 1, err
    for word in words:
        assert word in err, (word, err)
    assert "Traceback" not in out + err


def made(capsys, *arguments):
    """The folders that the command printed, read."""
    assert main(list(map(str, arguments))) == 0
    return {Path(path).name: read_session(path) for path in capsys.readouterr().out.splitlines()}


def test_xsens_counts_come_back_from_a_clone_and_no_folder_is_replaced(tmp_path, capsys, shared):
    t_s, accel, gyro = write_xsens(tmp_path / "bin" / "test_data")
    session = made(capsys, "xsens", tmp_path)["xsens"]
    samples, config = session.logs[0].samples, session.config
    np.testing.assert_array_equal(samples.t_ns, np.rint(t_s * 1e9))
    np.testing.assert_array_equal(np.rint(samples.accel * ACCEL_PER_MPS2) + 32768, accel)
    np.testing.assert_array_equal(np.rint(samples.gyro * GYRO_PER_RPS) + 32768, gyro)
    np.testing.assert_array_equal(config.accelerometer.matrix, BY_IMU_TK.matrix)
    assert session.folder == tmp_path / "sessions" / "xsens"
    refused(capsys, ["xsens", tmp_path], "sessions/xsens: exists", "--out")
    if (shared / "xsens" / "session.toml").exists():
        theirs = read_session(shared / "xsens").config
        assert (config.sensor, config.site, config.protocol) == (theirs.sensor, theirs.site, theirs.protocol)
        np.testing.assert_array_equal(config.accelerometer.bias_mps2, theirs.accelerometer.bias_mps2)


def test_mikov_numbers_stay_as_they_are_written(tmp_path, capsys):
    accel, gyro = np.round(np.random.default_rng(0).normal(0, 5, (2, 50, 3)), 5)
    for name in ("imu0.log", "imu4.log"):
        (tmp_path / name).write_text(mikov_text(accel, gyro))
    sessions = made(capsys, "mikov", tmp_path)
    assert sorted(sessions) == ["imu0", "imu4"]
    samples = sessions["imu4"].logs[0].samples
    np.testing.assert_array_equal(samples.accel, accel)
    np.testing.assert_array_equal(samples.gyro, gyro)
    np.testing.assert_array_equal(samples.t_ns, 10_000_000 * np.arange(50))
    assert sessions["imu4"].config.sensor.serial == "mikov-4"


def tumbled():
    """24 turns of an accelerometer with errors."""
    samples = Table().tumble(24, rest_s=1.6, turn_s=1.5, seed=5).samples(100.0, registers=False)
    matrix = np.array([[0.99, 0.01, -0.02], [0, 1.01, 0.005], [0, 0, 0.995]])
    return samples.with_accel(samples.accel @ np.linalg.inv(matrix).T + [0.3, -0.2, 0.5])


def test_an_accelerometer_comes_from_the_stills_or_there_is_no_folder(tmp_path, capsys):
    for number, samples in enumerate((tumbled(), Table().rest(5).samples(100.0, registers=False), tumbled())):
        (tmp_path / f"imu{number}.log").write_text(mikov_text(samples.accel, samples.gyro))
    assert main(["mikov", str(tmp_path), "--accelerometer", "stills"]) == 2
    out, err = capsys.readouterr()
    assert out.splitlines() == [str(tmp_path / "sessions" / "imu0")]
    assert err.count("\n") == 1
    assert "sessions/imu1: the stills lie in 1 attitude, too few" in err
    assert [path.name for path in (tmp_path / "sessions").iterdir()] == ["imu0"]
    found, plain = read_session(tmp_path / "sessions" / "imu0"), made(capsys, "mikov", tmp_path, "--out", tmp_path / "plain")["imu0"]
    expected = from_stills([plain.logs[0].samples])
    np.testing.assert_allclose(found.config.accelerometer.matrix, expected.matrix, atol=1e-8)
    np.testing.assert_allclose(found.config.accelerometer.bias_mps2, expected.bias_mps2, atol=1e-7)
    assert plain.config.accelerometer.source == "none"


def test_imucal_numbers_stay_as_they_are_written_and_its_circles_are_known(tmp_path, capsys):
    values = np.round(np.random.default_rng(0).normal(0, 5, (50, 6)), 5)
    rows = "".join(f"{number}," + ",".join(f"{value:.5f}" for value in row) + "\n" for number, row in enumerate(values))
    (tmp_path / "example_ferraris_session.csv").write_text("n_samples,gyr_x,gyr_y,gyr_z,acc_x,acc_y,acc_z\n" + rows)
    session = made(capsys, "imucal", tmp_path)["imucal"]
    samples = session.logs[0].samples
    np.testing.assert_allclose(samples.gyro / DEG, values[:, :3], rtol=1e-14)
    np.testing.assert_array_equal(samples.accel, values[:, 3:])
    np.testing.assert_allclose(samples.t_ns * 1e-9, np.arange(50) / 102.4, atol=1e-7)
    turns = [(turn.turn, turn.words, round(turn.angle_rad / DEG)) for turn in session.turns]
    assert turns == [(7, "x", -360), (9, "y", -360), (11, "z", -360)]


def test_euroc_as_its_authors_publish_it_and_from_archives(tmp_path, capsys):
    t_ns, gyro, accel, truth_ns, q_wxyz = write_euroc(tmp_path / "V1_01_easy")
    session = made(capsys, "euroc", tmp_path, "--out", tmp_path / "a")["V1_01"]
    samples, (truth,) = session.logs[0].samples, session.truths
    for name, expected in (("t_ns", t_ns), ("gyro", gyro), ("accel", accel)):
        np.testing.assert_array_equal(getattr(samples, name), expected)
    np.testing.assert_array_equal(truth.t_ns, truth_ns)
    np.testing.assert_allclose(truth.q_nb, to_down(q_wxyz, tmp_path), rtol=0, atol=1e-15)
    np.savez(tmp_path / "euroc_V1_01_easy.npz", t_ns=t_ns, gyro=gyro, acc=accel, gt_t_ns=truth_ns, gt_q_wxyz=q_wxyz)
    made(capsys, "euroc", tmp_path, "--out", tmp_path / "b")
    for name in ("session.toml", "log_V1_01.csv", "truth_V1_01.csv"):
        assert (tmp_path / "a" / "V1_01" / name).read_bytes() == (tmp_path / "b" / "V1_01" / name).read_bytes()


def test_up_becomes_down():
    """A level vehicle, z up, yawed by 30 deg: body z up is down's opposite, and the turn has the other sense."""
    half = 15 * DEG
    ((w, x, y, z),) = to_down(np.array([[np.cos(half), 0, 0, np.sin(half)]]), Path())
    down = np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    assert np.allclose(down, [0, 0, -1], atol=1e-12)


def test_mimu_frames_come_back_bit_for_bit_and_decoded_before(tmp_path, capsys):
    ticks, registers = mimu_data()
    frames = mimu_frames(ticks, registers)
    path = write_mimu(tmp_path / "a", frames, tail=frames[-1][:83])  # a last frame may be cut off
    again, same = read_frames(path)
    np.testing.assert_array_equal(again, ticks - ticks[0])
    np.testing.assert_array_equal(same, registers)
    (tmp_path / "b").mkdir()
    np.savez(tmp_path / "b" / "exp_1.npz", ticks_64mhz=ticks - ticks[0], registers=registers)
    for source in "ab":
        sessions = made(capsys, "mimu", tmp_path / source)
        assert sorted(sessions) == [f"e1u{unit}" for unit in range(8)]
        for unit in range(8):
            samples = sessions[f"e1u{unit}"].logs[0].samples
            np.testing.assert_array_equal(np.rint(samples.gyro / DEG * 16.4), registers[:, unit, 3:])
            np.testing.assert_array_equal(np.rint(samples.accel / G * 2048), registers[:, unit, :3])
            np.testing.assert_array_equal(samples.t_ns, np.rint((ticks - ticks[0]) / 0.064))


# The authors' own files.


@pytest.fixture(scope="module")
def wild(shared):
    if not (shared / "wild").is_dir():
        pytest.skip(f"no public recordings: {shared / 'wild'} is not there")
    return shared / "wild"


def test_the_real_cameras_of_repoimu_saw_what_the_gyro_turned(wild, tmp_path, capsys):
    """Over a tenth of a second, component by component: columns, order, units and sense are right."""
    session = made(capsys, "repoimu", wild / "repoimu", "--out", tmp_path / "r")["Test06_Trial1"]
    samples, (truth,) = session.logs[0].samples, session.truths
    np.testing.assert_array_equal(samples.t_ns, truth.t_ns)
    assert len(samples.t_ns) == 8732
    np.testing.assert_allclose(np.linalg.norm(samples.accel[:200], axis=1).mean(), 9.77, atol=0.05)
    (w, *v), (c, *u) = truth.q_nb[:-10].T, truth.q_nb[10:].T
    v, u = np.array(v).T, np.array(u).T
    turned = 2 * np.sign(w * c + np.sum(v * u, axis=1))[:, None] * (w[:, None] * u - c[:, None] * v - np.cross(v, u))
    summed = np.lib.stride_tricks.sliding_window_view(samples.gyro, 10, axis=0)[1:].sum(axis=2) * 0.01
    held = slice(0, -160)  # the cameras lose the stick in the last 1.3 s
    for axis in range(3):
        assert np.corrcoef(turned[held, axis], summed[held, axis])[0, 1] > 0.9  # another column, order or sense leaves less than 0.5


def test_a_real_trial_of_broad_is_read(wild):
    arrays = read_hdf5(wild / "broad" / TRIAL, ("imu_gyr", "imu_acc", "opt_quat", "movement"))
    assert arrays["imu_gyr"].shape == arrays["imu_acc"].shape == (59212, 3)
    assert np.isnan(arrays["opt_quat"][:, 0]).sum() == 2009
    still = arrays["movement"] == 0
    np.testing.assert_allclose(np.median(np.linalg.norm(arrays["imu_acc"][still], axis=1)), 9.81, atol=0.05)
    assert np.linalg.norm(np.median(arrays["imu_gyr"][still], axis=0)) < 1 * DEG


def test_gravity_says_that_the_rocket_board_turned_twice_as_far(wild, tmp_path, capsys):
    for name, session in made(capsys, "sundevil", wild / "sundevil" / "rev2", "--out", tmp_path / "out").items():
        assert len(session.logs[0].samples.t_ns) == {"long": 3727, "short": 2399}[name]
        finding = of(tinygc.check(session.folder), "gyro scale")
        assert finding.level == "error"
        assert "500 dps would match, not 250" in finding.do


@pytest.mark.slow
def test_euroc_comes_through_the_same_door(shared, tmp_path):
    if not (shared / "euroc").is_dir():
        pytest.skip(f"no recordings: {shared / 'euroc'} is not there")
    problem = build_problem(read_session(write_training_windows(shared / "euroc", tmp_path / "windows")))
    assert len(problem.used) == 243
    fit = fit_least_squares(problem.batch, np.full(243, 1e-3), problem.first)
    rms = np.sqrt(np.mean(np.sum(closure_angles(problem.batch, fit.model) ** 2, axis=1))) / DEG
    assert 0.30 < rms < 0.33
