"""Public recordings through the core: accelerometers calibrated from stills, EuRoC's truth."""

import numpy as np
import pytest
from conftest import DEG, Table
from public_files import mikov_text

from session.annexes.public.__main__ import main as public
from session.annexes.public.euroc import read_sequence, to_down, write_training_windows
from session.detect.accelerometer import from_stills
from tinygc import read_session
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.residual import closure_angles

MATRIX = np.array([[0.99, 0.01, -0.02], [0, 1.01, 0.005], [0, 0, 0.995]])
BIAS = np.array([0.3, -0.2, 0.5])


def tumbled():
    """24 turns of an accelerometer with these errors."""
    samples = Table().tumble(24, rest_s=1.6, turn_s=1.5, seed=5).samples(100.0, registers=False)
    return samples.with_accel(samples.accel @ np.linalg.inv(MATRIX).T + BIAS)


def test_the_command_writes_what_the_stills_give(tmp_path, capsys):
    samples = tumbled()
    (tmp_path / "imu0.log").write_text(mikov_text(samples.accel, samples.gyro))
    assert public(["mikov", str(tmp_path), "--out", str(tmp_path / "plain")]) == 0
    assert public(["mikov", str(tmp_path), "--accelerometer", "stills"]) == 0
    plain, found = (read_session(tmp_path / name / "imu0") for name in ("plain", "sessions"))
    assert "[accelerometer]" not in (tmp_path / "plain" / "imu0" / "session.toml").read_text()
    expected = from_stills([plain.logs[0].samples])
    np.testing.assert_allclose(found.config.accelerometer.matrix, expected.matrix, atol=1e-8)
    np.testing.assert_allclose(found.config.accelerometer.bias_mps2, expected.bias_mps2, atol=1e-7)
    assert found.config.unknown == ()


def test_the_command_says_in_one_line_where_stills_are_missing(tmp_path, capsys):
    samples = Table().rest(5).samples(100.0, registers=False)
    (tmp_path / "imu0.log").write_text(mikov_text(samples.accel, samples.gyro))
    assert public(["mikov", str(tmp_path), "--accelerometer", "stills"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "sessions/imu0: the stills lie in 1 attitude, too few" in err
    assert not (tmp_path / "sessions").exists()


def test_a_recording_that_cannot_be_calibrated_leaves_no_folder_that_looks_whole(tmp_path, capsys):
    """The first is calibrated and printed, the second is refused, the third is not begun."""
    still = Table().rest(5).samples(100.0, registers=False)
    for number, samples in enumerate((tumbled(), still, tumbled())):
        (tmp_path / f"imu{number}.log").write_text(mikov_text(samples.accel, samples.gyro))
    assert public(["mikov", str(tmp_path), "--accelerometer", "stills"]) == 2
    out, err = capsys.readouterr()
    assert out.splitlines() == [str(tmp_path / "sessions" / "imu0")]
    assert "sessions/imu1: the stills" in err
    assert [path.name for path in (tmp_path / "sessions").iterdir()] == ["imu0"]
    assert {path.name for path in (tmp_path / "sessions" / "imu0").iterdir()} == {"session.toml", "log0001.csv.gz"}
    assert "[accelerometer]" in (tmp_path / "sessions" / "imu0" / "session.toml").read_text()


def test_what_was_written_before_stays_as_it_was_where_it_cannot_be_calibrated(tmp_path):
    log, folder = tmp_path / "imu0.log", tmp_path / "sessions" / "imu0"
    samples = tumbled()
    log.write_text(mikov_text(samples.accel, samples.gyro))
    assert public(["mikov", str(tmp_path), "--accelerometer", "stills"]) == 0
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    still = Table().rest(5).samples(100.0, registers=False)
    log.write_text(mikov_text(still.accel, still.gyro))
    assert public(["mikov", str(tmp_path), "--accelerometer", "stills"]) == 2
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_up_becomes_down():
    """A level vehicle, z up, yawed by 30 deg: body z up is down's opposite, and the turn has the other sense."""
    half = 15 * DEG
    q = to_down(np.array([np.cos(half), 0, 0, np.sin(half)]))
    w, x, y, z = q
    down = np.array([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)])
    assert np.allclose(down, [0, 0, -1], atol=1e-12)


@pytest.mark.slow
def test_euroc_comes_through_the_same_door(shared, tmp_path):
    euroc = shared / "euroc"
    if not euroc.is_dir():
        pytest.skip(f"no recordings: {euroc} is not there")
    problem = build_problem(read_session(write_training_windows(euroc, tmp_path)))
    assert len(problem.used) == 243
    fit = fit_least_squares(problem.batch, np.full(243, 1e-3), problem.first)
    rms = np.sqrt(np.mean(np.sum(closure_angles(problem.batch, fit.model) ** 2, axis=1))) / DEG
    assert 0.30 < rms < 0.33
    _, gyro, accel, truth = read_sequence(euroc, "MH_02")
    assert np.isfinite(gyro).all()
    assert 0.2 < np.mean((accel == 0).all(axis=1)) < 0.3
    assert np.allclose(np.linalg.norm(truth.q_nb, axis=1), 1)
