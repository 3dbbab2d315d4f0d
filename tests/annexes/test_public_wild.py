"""BROAD, RepoIMU, a rocket's board and the ADIS16405: the authors' numbers are in the folders, and damaged files are refused."""

import lzma
import re
import struct
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hdf5_and_rda import hdf5_bytes, rda_bytes
from looks import of
from public_files import broad_arrays, repoimu_text
from test_public import made, refused

import tinygc
from session.annexes.public.__main__ import main
from session.annexes.public.broad import read_hdf5
from session.annexes.public.euroc import to_down
from session.io.config import read_config
from session.io.errors import FormatError
from session.io.rests import read_rest
from session.io.units import DEG, G
from tinygc import read_session

RATE = {"sampling_rate": 285.714286}
TRIAL = "05_undisturbed_slow_rotation_with_breaks_B.hdf5"


@pytest.mark.parametrize("chunk", [None, 7])
def test_hdf5_arrays_come_back_bit_for_bit(tmp_path, chunk):
    arrays = broad_arrays()
    path = tmp_path / "a.hdf5"
    path.write_bytes(hdf5_bytes(arrays, RATE | {"count": np.array([3, -4], np.int32)}, chunk))
    again = read_hdf5(path, tuple(arrays), ("sampling_rate", "count"))
    for name, array in arrays.items():
        assert again[name].dtype == array.dtype
        np.testing.assert_array_equal(again[name], array)
    assert again["sampling_rate"] == RATE["sampling_rate"]
    np.testing.assert_array_equal(again["count"], [3, -4])


def test_hdf5_refuses_every_file_that_is_cut_short_and_survives_every_flipped_byte(tmp_path):
    whole = hdf5_bytes({"a": np.arange(12.0).reshape(4, 3), "b": np.zeros((4, 2))}, RATE, chunk=3)
    path = tmp_path / "a.hdf5"
    for length in range(0, len(whole) - 24, 17):
        path.write_bytes(whole[:length])
        with pytest.raises(FormatError, match="download it again"):
            read_hdf5(path, ("a", "b"), ("sampling_rate",))
    for at in range(0, len(whole), 11):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :])
        with suppress(FormatError):
            read_hdf5(path, ("a", "b"), ("sampling_rate",))


def test_hdf5_says_what_it_does_not_hold(tmp_path):
    path = tmp_path / "a.hdf5"
    path.write_bytes(hdf5_bytes({"a": np.zeros((2, 2))}, RATE, chunk=2))
    for names, attributes in ((("b",), ()), (("a",), ("b",))):
        with pytest.raises(FormatError, match="holds no b"):
            read_hdf5(path, names, attributes)
    packed = path.read_bytes().replace(struct.pack("<BB6xH", 1, 1, 1), struct.pack("<BB6xH", 1, 1, 32000))
    path.write_bytes(packed)
    with pytest.raises(FormatError, match="not an HDF5 file that can be read here"):  # a filter that nobody has
        read_hdf5(path, ("a",))


def test_hdf5_without_h5py_says_what_to_install(tmp_path, monkeypatch):
    path = tmp_path / "a.hdf5"
    path.write_bytes(hdf5_bytes({"a": np.zeros((2, 2))}, RATE))
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(FormatError, match=re.escape("a.hdf5: an HDF5 file; reading it needs h5py: python -m pip install 'tinygc[logs]'")):
        read_hdf5(path, ("a",))


def test_hdf5_opens_no_other_file(tmp_path):
    h5py = pytest.importorskip("h5py")
    (tmp_path / "b.hdf5").write_bytes(hdf5_bytes({"a": np.zeros((2, 2))}, RATE))
    with h5py.File(tmp_path / "a.hdf5", "w") as file:
        file["a"] = h5py.ExternalLink("b.hdf5", "/a")
    with pytest.raises(FormatError, match="no array in this file"):
        read_hdf5(tmp_path / "a.hdf5", ("a",))


def test_broad_as_its_authors_publish_it(tmp_path, capsys):
    arrays = broad_arrays()
    path = tmp_path / "data_hdf5" / TRIAL
    path.parent.mkdir()
    path.write_bytes(hdf5_bytes(arrays, RATE, chunk=7))
    session = made(capsys, "broad", tmp_path, "--out", tmp_path / "out")["trial05"]
    samples, (truth,) = session.logs[0].samples, session.truths
    np.testing.assert_array_equal(samples.gyro, arrays["imu_gyr"])
    np.testing.assert_array_equal(samples.accel, arrays["imu_acc"])
    np.testing.assert_array_equal(samples.t_ns, 3_500_000 * np.arange(25))
    np.testing.assert_array_equal(truth.t_ns, samples.t_ns[3:])
    # the reader turns the world with z up over, as session.toml says it stands
    np.testing.assert_allclose(truth.q_nb, to_down(arrays["opt_quat"][3:]), rtol=0, atol=1e-15)
    assert session.config.truth.frame == "enu"
    assert session.config.sensor.odr_hz == RATE["sampling_rate"]


def test_broad_refuses(tmp_path, capsys):
    path = tmp_path / TRIAL
    good = broad_arrays()
    for spoilt, rate, said in (
        ({"imu_gyr": good["imu_gyr"][:, :2]}, 286.0, "imu_gyr has not the shape"),
        ({"opt_quat": good["opt_quat"][:-1]}, 286.0, "opt_quat has not the shape"),
        ({"opt_quat": 2 * good["opt_quat"]}, 286.0, "length 1"),
        ({}, 0.0, "expected one number of Hz"),
        ({}, [286.0, 286.0], "expected one number of Hz"),
    ):
        path.write_bytes(hdf5_bytes(good | spoilt, {"sampling_rate": rate}))
        refused(capsys, ["broad", tmp_path], TRIAL, said)
    path.write_text("time,x\n")
    refused(capsys, ["broad", tmp_path], TRIAL, "no HDF5 file")


def test_repoimu_numbers_stay_as_they_are_written(tmp_path, capsys):
    text, rows = repoimu_text()
    path = tmp_path / "TStick" / "TStick_Test06_Trial1.csv"
    path.parent.mkdir()
    path.write_text(text)
    session = made(capsys, "repoimu", tmp_path, "--out", tmp_path / "out")["Test06_Trial1"]
    samples, (truth,) = session.logs[0].samples, session.truths
    np.testing.assert_allclose(samples.gyro, rows[:, 8:11], rtol=1e-7)
    np.testing.assert_allclose(samples.accel, rows[:, 5:8], rtol=1e-7)
    np.testing.assert_array_equal(samples.t_ns - samples.t_ns[0], 10_000_000 * np.arange(25))
    seen = np.delete(np.arange(25), 1)
    np.testing.assert_array_equal(truth.t_ns, samples.t_ns[seen])
    np.testing.assert_allclose(truth.q_nb, rows[seen, 1:5], atol=2e-8)
    lines = text.splitlines(keepends=True)
    path.write_text("".join(lines[1:]))
    refused(capsys, ["repoimu", tmp_path], "header lines")
    path.write_text("".join([*lines[:4], "1;2;3\n"]))
    refused(capsys, ["repoimu", tmp_path], "line 5", "14 numbers")
    path.write_text("".join([*lines[:3], lines[4].replace(lines[4].split(";")[1], "2")]))
    refused(capsys, ["repoimu", tmp_path], "length 1")


def test_the_rocket_board_stays_as_its_authors_converted_it(tmp_path, capsys):
    values = np.round(np.random.default_rng(0).normal(0, 5, (30, 13)), 6)
    values[:, 0] = 0.05 * np.arange(30)
    text = "".join("\t".join(f"{value:.6f}" for value in row) + "\n" for row in values)
    path = tmp_path / "Rev2_IMU_Data" / "IMU_Rev2_Data_Short.txt"
    path.parent.mkdir()
    path.write_text(text)
    session = made(capsys, "sundevil", tmp_path, "--out", tmp_path / "out")["short"]
    samples = session.logs[0].samples
    np.testing.assert_allclose(samples.gyro / DEG, values[:, 4:7], rtol=1e-12)
    np.testing.assert_array_equal(samples.accel, values[:, 1:4])
    np.testing.assert_array_equal(samples.temp_c, values[:, 12])
    assert session.config.sensor.gyro_fs_dps == 250  # their own, which the recording contradicts
    path.write_text(text + "0\t1\t2\n")
    refused(capsys, ["sundevil", tmp_path], "line 31", "13 numbers")


@pytest.mark.parametrize("packed", [True, False])
def test_adis16405_becomes_a_rest_log(tmp_path, capsys, packed):
    """As R wrote it, and as the arrays that were read from it."""
    rng = np.random.default_rng(0)
    gyro, accel = 0.05 * rng.integers(-40, 40, (400, 3)), 0.00333 * rng.integers(-5, 5, (400, 3))
    values = np.column_stack([gyro, accel])
    if packed:
        (tmp_path / "data").mkdir()
        (tmp_path / "data" / "adis_16405_imu1.rda").write_bytes(lzma.compress(rda_bytes(values)))
    else:
        arrays = {"gyro_dps": gyro.astype(np.float32), "accel_g": accel.astype(np.float32), "rate_hz": np.float64(100)}
        np.savez(tmp_path / "adis16405_imu1.npz", **arrays)
    assert main(["adis16405", str(tmp_path)]) == 0
    folder = Path(capsys.readouterr().out.strip())
    config = read_config(folder / "session.toml")
    rest = read_rest(folder / "rest0001.csv.gz", config.sensor)
    assert (rest.samples, len(rest), config.sensor.odr_hz, rest.has_temperature) == (400, 4, 100, False)
    np.testing.assert_allclose(rest.gyro / DEG, gyro.reshape(4, 100, 3).mean(axis=1), atol=1e-9)
    np.testing.assert_allclose(rest.accel / G, accel.reshape(4, 100, 3).mean(axis=1), atol=1e-9)
    refused(capsys, ["adis16405", tmp_path, "--accelerometer", "stills"], "one attitude")


def test_adis16405_refuses(tmp_path, capsys):
    path = tmp_path / "adis_16405_imu1.rda"
    good = rda_bytes(np.zeros((9, 6)))
    five = rda_bytes(np.zeros((9, 5)))
    for data, said in (
        (b"RDX2", "no R workspace"),
        (lzma.compress(good[:200]), "no R workspace"),
        (lzma.compress(five), "no matrix of Gyro. X"),
        (lzma.compress(good.replace(b"Accel. Z", b"Accel. W")), "no matrix of Gyro. X"),
        (lzma.compress(rda_bytes(np.full((9, 6), np.nan))), "no number"),
        (lzma.compress(rda_bytes(np.zeros((9, 6)), 0.0)), "rate of 0 Hz"),
    ):
        path.write_bytes(data)
        refused(capsys, ["adis16405", tmp_path], "adis_16405_imu1.rda", said)
    np.savez(tmp_path / "adis16405_imu1.npz", gyro_dps=np.zeros((9, 3)), accel_g=np.zeros((8, 3)), rate_hz=100.0)
    refused(capsys, ["adis16405", tmp_path], "accel_g (N, 3)")


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
    arrays = read_hdf5(wild / "broad" / TRIAL, ("imu_gyr", "imu_acc", "opt_quat", "movement"), ("sampling_rate",))
    assert arrays["imu_gyr"].shape == arrays["imu_acc"].shape == (59212, 3)
    assert np.isnan(arrays["opt_quat"][:, 0]).sum() == 2009
    assert arrays["movement"].sum() == 29132
    still = arrays["movement"] == 0
    np.testing.assert_allclose(np.median(np.linalg.norm(arrays["imu_acc"][still], axis=1)), 9.81, atol=0.05)
    assert np.linalg.norm(np.median(arrays["imu_gyr"][still], axis=0)) < 1 * DEG


def test_gravity_says_that_the_rocket_board_turned_twice_as_far(wild, tmp_path, capsys):
    assert main(["sundevil", str(wild / "sundevil" / "rev2"), "--out", str(tmp_path)]) == 0
    for folder in map(Path, capsys.readouterr().out.splitlines()):
        assert len(read_session(folder).logs[0].samples.t_ns) == {"long": 3727, "short": 2399}[folder.name]
        finding = of(tinygc.check(folder), "gyro scale")
        assert finding.level == "error"
        assert "500 dps would match, not 250" in finding.do
