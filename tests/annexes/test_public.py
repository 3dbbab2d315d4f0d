"""Public sets as session folders: what is in the authors' files is in the folders, to the digit; what is damaged is refused in one line."""

import gzip
from pathlib import Path

import numpy as np
import pytest
from public_files import mikov_text, tofupilot_text, write_euroc, write_xsens

from session.annexes.public.__main__ import main
from session.annexes.public.euroc import to_down
from session.annexes.public.xsens import ACCEL_PER_MPS2, BY_IMU_TK, GYRO_PER_RPS
from session.io.config import read_config
from session.io.rests import read_rest
from session.io.units import DEG
from tinygc import read_session


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


def test_xsens_counts_come_back(tmp_path, capsys):
    t_s, accel, gyro = write_xsens(tmp_path)
    session = made(capsys, "xsens", tmp_path)["xsens"]
    (log,) = session.logs
    np.testing.assert_array_equal(log.samples.t_ns, np.rint(t_s * 1e9))
    np.testing.assert_array_equal(np.rint(log.samples.accel * ACCEL_PER_MPS2) + 32768, accel)
    np.testing.assert_array_equal(np.rint(log.samples.gyro * GYRO_PER_RPS) + 32768, gyro)
    np.testing.assert_array_equal(session.config.accelerometer.matrix, BY_IMU_TK.matrix)
    assert session.folder == tmp_path / "sessions" / "xsens"


def test_the_folder_may_be_a_clone_of_the_authors(tmp_path, capsys):
    write_xsens(tmp_path / "bin" / "test_data")
    assert set(made(capsys, "xsens", tmp_path, "--out", tmp_path / "out")) == {"xsens"}


def test_xsens_refuses(tmp_path, capsys):
    refused(capsys, ["xsens", tmp_path / "nowhere"], "not found")
    refused(capsys, ["xsens", tmp_path], "xsens_acc.mat", "download")
    write_xsens(tmp_path)
    gyro = tmp_path / "xsens_gyro.mat"
    lines = gyro.read_text().splitlines(keepends=True)
    gyro.unlink()
    refused(capsys, ["xsens", tmp_path], "xsens_gyro.mat", "cannot be read")
    gyro.write_text("".join(lines[:-1]))
    refused(capsys, ["xsens", tmp_path], "29 times", "30")
    spoilt = {"  0.1  1  2\n": "line 5", "  0.1  1  2  nan\n": "line 5", "  9.0e-2  1.5  2  3\n": "1.5", "  9.0e-2 70000 2 3\n": "70000"}
    for line, said in spoilt.items():
        gyro.write_text("".join([*lines[:4], line, *lines[5:]]))
        refused(capsys, ["xsens", tmp_path], "xsens_gyro.mat", said)
    gyro.write_text("".join([*lines[:4], lines[3], *lines[5:]]))
    refused(capsys, ["xsens", tmp_path], "sample 5")
    gyro.write_bytes(b"\xff\xfe\x00\x01")
    refused(capsys, ["xsens", tmp_path], "not UTF-8")


def test_mikov_numbers_stay_as_they_are_written(tmp_path, capsys):
    rng = np.random.default_rng(0)
    accel, gyro = np.round(rng.normal(0, 5, (2, 50, 3)), 5)
    for name in ("imu0.log", "imu4.log"):
        (tmp_path / name).write_text(mikov_text(accel, gyro))
    sessions = made(capsys, "mikov", tmp_path)
    assert sorted(sessions) == ["imu0", "imu4"]
    samples = sessions["imu4"].logs[0].samples
    np.testing.assert_array_equal(samples.accel, accel)
    np.testing.assert_array_equal(samples.gyro, gyro)
    np.testing.assert_array_equal(samples.t_ns, 10_000_000 * np.arange(50))
    assert sessions["imu4"].config.sensor.serial == "mikov-4"
    with gzip.open(tmp_path / "sessions" / "imu0" / "log0001.csv.gz", "rt") as file:
        assert file.readlines()[1] == "0.00," + ",".join(f"{value:.5f}" for value in (*gyro[0], *accel[0])) + "\n"


@pytest.mark.parametrize("line", ["1 2 3 4 5\n", "1 2 3 4 5 6 7\n", "1 2 3 4 5 six\n", "1 2 3 4 5 inf\n", "1,2,3,4,5,6\n"])
def test_mikov_refuses_another_line(tmp_path, capsys, line):
    (tmp_path / "imu0.log").write_text("1 2 3 4 5 6\n" + line)
    refused(capsys, ["mikov", tmp_path], "imu0.log line 2", "6 numbers")


def test_mikov_refuses_an_empty_file(tmp_path, capsys):
    (tmp_path / "imu0.log").write_text("")
    refused(capsys, ["mikov", tmp_path], "imu0.log", "0 lines")


def test_imucal_numbers_stay_as_they_are_written_and_its_circles_are_known(tmp_path, capsys):
    values = np.round(np.random.default_rng(0).normal(0, 5, (50, 6)), 5)
    rows = "".join(f"{number}," + ",".join(f"{value:.5f}" for value in row) + "\n" for number, row in enumerate(values))
    path = tmp_path / "example_data" / "example_ferraris_session.csv"
    path.parent.mkdir()
    path.write_text("n_samples,gyr_x,gyr_y,gyr_z,acc_x,acc_y,acc_z\n" + rows)
    session = made(capsys, "imucal", tmp_path)["imucal"]
    samples = session.logs[0].samples
    np.testing.assert_allclose(samples.gyro / DEG, values[:, :3], rtol=1e-14)
    np.testing.assert_array_equal(samples.accel, values[:, 3:])
    np.testing.assert_allclose(samples.t_ns * 1e-9, np.arange(50) / 102.4, atol=1e-7)
    assert [(turn.turn, turn.words, round(turn.angle_rad / DEG)) for turn in session.turns] == [
        (7, "x", -360),
        (9, "y", -360),
        (11, "z", -360),
    ]
    path.write_text("n_samples,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z\n" + rows)
    refused(capsys, ["imucal", tmp_path], "line 1", "expected n_samples,gyr_x")
    path.write_text("n_samples,gyr_x,gyr_y,gyr_z,acc_x,acc_y,acc_z\n" + rows + "50,1,2,3\n")
    refused(capsys, ["imucal", tmp_path], "line 52", "7 numbers")


def test_euroc_as_its_authors_publish_it(tmp_path, capsys):
    t_ns, gyro, accel, truth_ns, q_wxyz = write_euroc(tmp_path / "V1_01_easy")
    session = made(capsys, "euroc", tmp_path)["V1_01"]
    samples, (truth,) = session.logs[0].samples, session.truths
    np.testing.assert_array_equal(samples.t_ns, t_ns)
    np.testing.assert_array_equal(samples.gyro, gyro)
    np.testing.assert_array_equal(samples.accel, accel)
    np.testing.assert_array_equal(truth.t_ns, truth_ns)
    np.testing.assert_allclose(truth.q_nb, to_down(q_wxyz), rtol=0, atol=1e-15)


def test_euroc_from_archives_is_the_same(tmp_path, capsys):
    t_ns, gyro, accel, truth_ns, q_wxyz = write_euroc(tmp_path / "V1_01_easy")
    (tmp_path / "npz").mkdir()
    np.savez(tmp_path / "npz" / "euroc_V1_01_easy.npz", t_ns=t_ns, gyro=gyro, acc=accel, gt_t_ns=truth_ns, gt_q_wxyz=q_wxyz)
    made(capsys, "euroc", tmp_path / "V1_01_easy", "--out", tmp_path / "a")
    made(capsys, "euroc", tmp_path / "npz", "--out", tmp_path / "b")
    for name in ("session.toml", "log_V1_01.csv", "truth_V1_01.csv"):
        assert (tmp_path / "a" / "V1_01" / name).read_bytes() == (tmp_path / "b" / "V1_01" / name).read_bytes()


def test_euroc_refuses(tmp_path, capsys):
    refused(capsys, ["euroc", tmp_path], "mav0/imu0/data.csv")
    write_euroc(tmp_path / "V1_01_easy")
    imu = tmp_path / "V1_01_easy" / "mav0" / "imu0" / "data.csv"
    whole = imu.read_text()
    lines = whole.splitlines()
    imu.write_text("\n".join([*lines[:3], "1.40363657975856E+018,1,2,3,4,5,6", *lines[4:]]))
    refused(capsys, ["euroc", tmp_path], "data.csv", "whole ns")
    imu.write_text("\n".join([*lines[:3], lines[3] + ",7", *lines[4:]]))
    refused(capsys, ["euroc", tmp_path], "line 4", "7 numbers")
    imu.write_text("\n".join([*lines[:3], lines[2], *lines[4:]]))
    refused(capsys, ["euroc", tmp_path], "does not go on")
    imu.write_text(whole)
    truth = tmp_path / "V1_01_easy" / "mav0" / "state_groundtruth_estimate0" / "data.csv"
    truth.write_text("#timestamp\n" + "\n".join(f"{t},0,0,0,2,0,0,0,0,0,0,0,0,0,0,0,0" for t in range(5)))
    refused(capsys, ["euroc", tmp_path], "quaternion", "length 2")
    truth.unlink()
    refused(capsys, ["euroc", tmp_path], "state_groundtruth_estimate0", "cannot be read")
    (tmp_path / "euroc_V2_01_easy.npz").write_bytes(b"PK\x03\x04")
    refused(capsys, ["euroc", tmp_path], "euroc_V2_01_easy.npz")


def test_archives_of_other_shapes_are_refused(tmp_path, capsys):
    path = tmp_path / "euroc_V1_01_easy.npz"
    t_ns, values, q = np.arange(9) * 5_000_000, np.zeros((9, 3)), np.tile([1.0, 0, 0, 0], (9, 1))
    for name, value in (("gyro", values[:5]), ("acc", values[:, :2]), ("gt_q_wxyz", 2 * q), ("t_ns", values), ("gyro", values.astype(str))):
        np.savez(path, **{"t_ns": t_ns, "gyro": values, "acc": values, "gt_t_ns": t_ns, "gt_q_wxyz": q} | {name: value})
        refused(capsys, ["euroc", tmp_path], "euroc_V1_01_easy.npz")


def test_what_no_log_may_hold_is_refused_before_a_folder_is_there(tmp_path, capsys):
    """Found by fuzzing: such values and stamps were written, and no command read them."""
    (tmp_path / "imu0.log").write_text(mikov_text(np.full((5, 3), 1e7), np.zeros((5, 3))))
    refused(capsys, ["mikov", tmp_path], "beyond any sensor", "download them again")
    (tmp_path / "imu_raw_data.csv").write_text(tofupilot_text()[0].replace("2565512", "9999992565512"))
    refused(capsys, ["tofupilot", tmp_path], "too long for any register or stamp", "download them again")
    assert not (tmp_path / "sessions").exists()


def test_a_folder_with_another_log_is_left_alone(tmp_path, capsys):
    write_xsens(tmp_path)
    other = tmp_path / "sessions" / "xsens" / "log0002.csv"
    other.parent.mkdir(parents=True)
    other.write_text("t_s\n")
    refused(capsys, ["xsens", tmp_path], "log0002.csv", "--out")


def test_what_a_person_has_written_into_a_folder_is_not_replaced(tmp_path, capsys):
    """The same files give the same bytes again; a session.toml that somebody has changed, or another recording's log, stays."""
    write_xsens(tmp_path)
    folder = tmp_path / "sessions" / "xsens"
    for _ in range(2):
        assert main(["xsens", str(tmp_path)]) == 0
    for name in ("session.toml", "log0001.csv.gz"):
        made = (folder / name).read_bytes()
        (folder / name).write_bytes(b"mine")
        refused(capsys, ["xsens", tmp_path], f"holds another {name}", "--out")
        assert (folder / name).read_bytes() == b"mine"
        (folder / name).write_bytes(made)
    assert sorted(path.name for path in folder.iterdir()) == ["log0001.csv.gz", "session.toml"]


def test_the_xsens_folder_beside_the_checkout_names_the_same_sensor_and_accelerometer(shared, tmp_path, capsys):
    if not (shared / "xsens" / "session.toml").exists():
        pytest.skip("no recordings: ../shared/xsens is not there")
    write_xsens(tmp_path)
    mine, theirs = made(capsys, "xsens", tmp_path)["xsens"].config, read_session(shared / "xsens").config
    assert (mine.sensor, mine.site, mine.protocol) == (theirs.sensor, theirs.site, theirs.protocol)
    np.testing.assert_array_equal(mine.accelerometer.matrix, theirs.accelerometer.matrix)
    np.testing.assert_array_equal(mine.accelerometer.bias_mps2, theirs.accelerometer.bias_mps2)


def test_tofupilots_rest_log_comes_back(tmp_path, capsys):
    text, rows = tofupilot_text()
    source = tmp_path / "templates" / "imu_thermal_calibration" / "data"
    source.mkdir(parents=True)
    (source / "imu_raw_data.csv").write_text(text)
    assert main(["tofupilot", str(tmp_path)]) == 0
    folder = Path(capsys.readouterr().out.strip())
    seen = []
    log = read_rest(folder / "rest0001.csv.gz", read_config(folder / "session.toml").sensor, seen.append)
    gyro, temp = (np.concatenate([getattr(part, name) for part in seen]) for name in ("gyro", "temp_c"))
    np.testing.assert_allclose(gyro, rows[:, :3], rtol=1e-8)
    np.testing.assert_allclose(temp, rows[:, 6], atol=1e-8)
    assert log.duration_s == pytest.approx(60 * 0.505403, abs=4)


def test_tofupilot_refuses(tmp_path, capsys):
    refused(capsys, ["tofupilot", tmp_path], "imu_raw_data.csv", "download")
    text, _ = tofupilot_text()
    path = tmp_path / "imu_raw_data.csv"
    path.write_text(text.replace("imu.gyro.x", "gyro.x"))
    refused(capsys, ["tofupilot", tmp_path], "header", "download it again")
    lines = text.splitlines()
    path.write_text("\n".join([*lines[:7], lines[7].rsplit("\t", 1)[0], *lines[8:]]))
    refused(capsys, ["tofupilot", tmp_path], "line 8", "expected 9 numbers")
    path.write_text(text)
    refused(capsys, ["tofupilot", tmp_path, "--accelerometer", "stills"], "one attitude")
