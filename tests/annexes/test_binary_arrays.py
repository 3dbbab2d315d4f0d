"""Files of arrays: which array is what, by names, shapes and units; what is not clear is listed, and ``--columns`` says it."""

import importlib
import re
import sys
import zipfile

import numpy as np
import pytest
import written_logs as written
from test_binary_logs import ACCEL, COUNT, GYRO, RECORDING, T_NS, TEMP, head_of, one

from session.annexes.logs import arrow, hdf5, matlab, numpy_file
from session.annexes.logs.named import meaning, triads
from session.annexes.logs.registry import reader_of
from session.io.budget import budget
from session.io.errors import FormatError

FORMATS = {
    "HDF5": (written.write_hdf5, "a.h5", hdf5),
    "HDF5, packed": (lambda *a: written.write_hdf5(*a, chunks=50), "a.h5", hdf5),
    "MATLAB 7.3": (written.write_mat73, "a.mat", hdf5),
    "MATLAB 5": (written.write_mat, "a.mat", matlab),
    "MATLAB 5, unpacked": (lambda *a: written.write_mat(*a, compress=False), "a.mat", matlab),
    "MATLAB 4": (lambda *a: written.write_mat(*a, version="4"), "a.mat", matlab),
    "npz": (written.write_npz, "a.npz", numpy_file),
    "npy": (written.write_npy, "a.npy", numpy_file),
    "Parquet": (written.write_parquet, "a.parquet", arrow),
    "Feather": (written.write_feather, "a.feather", arrow),
}
#: HDF5's words for the units, as its writer has them
UNITS = {"HDF5": ("rad/s", "m/s^2", "degC"), "HDF5, packed": ("rad/s", "m/s^2", "degC")}
each_format = pytest.mark.parametrize("name", FORMATS)


@each_format
def test_every_number_comes_back(name, tmp_path):
    write, file, reader = FORMATS[name]
    path = tmp_path / file
    write(path, *RECORDING)
    assert reader_of(path, head_of(path)) is reader
    (topic,) = reader.topics(path, None)
    assert (topic.name, topic.rows, topic.holds) == ("imu", COUNT, ("gyro", "accel", "temp"))
    stream = one(path, "imu")
    np.testing.assert_array_equal(stream.t_ns, T_NS)
    np.testing.assert_array_equal(stream.gyro, GYRO)
    np.testing.assert_array_equal(stream.accel, ACCEL)
    np.testing.assert_array_equal(stream.temp, TEMP)
    assert (stream.gyro_unit, stream.accel_unit, stream.temp_unit) == UNITS.get(name, ("rad/s", "m/s2", "degc"))
    with pytest.raises(FormatError, match="no stream 'other'; it holds imu"):
        reader.read(path, ["other"], None)


@pytest.mark.parametrize("name", ["HDF5", "MATLAB 5", "MATLAB 4", "npz", "npy", "Parquet"])
def test_more_than_the_budget_is_refused(name, tmp_path):
    write, file, reader = FORMATS[name]
    write(tmp_path / file, *RECORDING)
    with budget((), 10_000), pytest.raises(FormatError, match=r"reading it takes more than .* MB of memory, and 0.01 MB may be taken"):
        reader.read(tmp_path / file, [], None)


@pytest.mark.parametrize(("name", "package", "said"), [("HDF5", "h5py", "an HDF5 file"), ("Parquet", "pyarrow", "a table of Arrow")])
def test_a_package_that_is_not_installed_is_named(name, package, said, tmp_path, monkeypatch):
    write, file, reader = FORMATS[name]
    write(tmp_path / file, *RECORDING)
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(FormatError, match=re.escape(f"{said}; reading it needs {package}: python -m pip install 'tinygc[logs]'")):
        reader.read(tmp_path / file, [], None)


# Names.


@pytest.mark.parametrize(
    ("name", "kind", "axis", "unit", "of"),
    [
        ("gyro", "gyro", None, "", ""),
        ("imu_gyr", "gyro", None, "", "imu"),
        ("angular_velocity.x", "gyro", 0, "", ""),
        ("imu1/gyr_z [deg/s]", "gyro", 2, "deg/s", "imu.1"),
        ("Gyroscope X (deg/s)", "gyro", 0, "deg/s", ""),
        ("gx_dps", "gyro", 0, "dps", ""),
        ("gyro0_y", "gyro", 1, "", "0"),
        ("gyro_rad[2]", "gyro", 2, "rad/s", ""),
        ("w", "gyro", None, "", ""),
        ("wx", "gyro", 0, "", ""),
        ("acc_m_s2", "accel", None, "m/s2", ""),
        ("accelerometer_m_s2[2]", "accel", 2, "m/s2", ""),
        ("lin_acc", "accel", None, "", ""),
        ("fz_g", "accel", 2, "g", ""),
        ("AccZ", "accel", 2, "", ""),
        ("TimeUS", "time", None, "us", ""),
        ("t", "time", None, "", ""),
        ("Timestamp (ms)", "time", None, "ms", ""),
        ("temp_c", "temp", None, "degc", ""),
    ],
)
def test_a_name_says_what_a_column_is(name, kind, axis, unit, of):
    found = meaning(name)
    assert (found.kind, found.axis, found.unit, found.of) == (kind, axis, unit, of)


@pytest.mark.parametrize(
    "name", ["gyro_bias", "mag_x", "angular_acceleration.x", "orientation.x", "wrench.force.x", "x", "", "sample_rate", "q"]
)
def test_other_names_say_nothing(name):
    assert meaning(name) is None


def test_triads_are_whole_and_of_one_sensor():
    names = ["imu0.wx", "imu0.wy", "imu0.wz", "imu1.wx", "imu1.wz", "ax", "ay", "az"]
    assert triads(names) == {("gyro", "imu.0"): ("imu0.wx", "imu0.wy", "imu0.wz"), ("accel", ""): ("ax", "ay", "az")}


# Which array is what.


def npz(tmp_path, **arrays):
    path = tmp_path / "a.npz"
    np.savez(path, **arrays)
    return path


def test_rows_for_axes_are_turned(tmp_path):
    stream = one(npz(tmp_path, time_s=T_NS * 1e-9, gyro=GYRO.T, acc=ACCEL))
    np.testing.assert_array_equal(stream.gyro, GYRO)
    np.testing.assert_array_equal(stream.accel, ACCEL)
    assert "gyro has a row for each axis" in stream.notes
    np.testing.assert_array_equal(stream.t_ns, T_NS)


def test_sensors_of_their_own_rates_are_streams_of_their_own(tmp_path):
    path = npz(tmp_path, gyro_t_us=T_NS // 1000, gyro_dps=GYRO, accel_t_us=T_NS[::2] // 1000, accel_g=ACCEL[::2])
    gyro, accel = numpy_file.read(path, [], None)
    assert (gyro.name, gyro.holds, len(gyro), gyro.gyro_unit) == ("gyro", ("gyro",), COUNT, "dps")
    assert (accel.name, accel.holds, len(accel), accel.accel_unit) == ("accel", ("accel",), COUNT // 2, "g")
    np.testing.assert_array_equal(accel.t_ns, T_NS[::2])


def test_several_sensors_are_told_apart_by_their_groups(tmp_path):
    path = npz(tmp_path, t_s=T_NS * 1e-9, imu0_gyro=GYRO, imu0_acc=ACCEL, imu1_gyro=-GYRO, imu1_acc=-ACCEL)
    first, second = numpy_file.read(path, ["imu.0", "imu.1"], None)
    np.testing.assert_array_equal(first.gyro, GYRO)
    np.testing.assert_array_equal(second.accel, -ACCEL)
    np.testing.assert_array_equal(second.t_ns, T_NS)


def test_arrays_without_stamps_or_units_have_none_and_a_rate_where_it_stands(tmp_path):
    stream = one(npz(tmp_path, gyr=GYRO, acc=ACCEL, sampling_rate=208.5))
    assert (stream.t_ns, stream.gyro_unit, stream.accel_unit, stream.odr_hz) == (None, "", "", 208.5)


def test_a_rate_among_attributes_is_found(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["imu_gyr"], file["imu_acc"] = GYRO, ACCEL
        file.attrs["sampling_rate"] = 285.714286
    assert one(tmp_path / "a.h5").odr_hz == 285.714286


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"one": GYRO, "two": ACCEL}, "is clear by name; it holds one (120, 3), two (120, 3)"),
        ({"gyro": GYRO, "gyr": GYRO}, "gyro and gyr may both be the gyro"),
        ({"gyro": GYRO, "time": T_NS}, "does not say the unit of its time 'time'"),
        ({"gyro": GYRO, "time": T_NS, "ts": T_NS}, "time and ts may both be the time"),
        ({"gx_dps": GYRO[:, 0], "gy_rps": GYRO[:, 1], "gz_dps": GYRO[:, 2]}, "in different units (dps, rad/s)"),
        ({"gyro_x": GYRO[:, 0], "gyro_y": GYRO[:, 1]}, "is clear by name"),
        ({"label": np.array(["a", "b"])}, "it holds no arrays of numbers"),
        ({"gyro": GYRO, "t_s": np.full(COUNT, np.nan)}, "t_s holds stamps that are no time in s"),
        ({"gyro": GYRO, "t_s": np.full(COUNT, 1e12)}, "t_s holds stamps that are no time in s"),
    ],
)
def test_what_is_not_clear_is_listed(arrays, said, tmp_path):
    with pytest.raises(FormatError) as raised:
        numpy_file.read(npz(tmp_path, **arrays), [], None)
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)


def test_of_two_times_the_one_that_says_its_unit_is_taken(tmp_path):
    stream = one(npz(tmp_path, gyro=GYRO, time=np.arange(COUNT), t_ns=T_NS))
    np.testing.assert_array_equal(stream.t_ns, T_NS)
    assert "of several times t_ns is taken, which says its unit" in stream.notes


# --columns


def test_columns_name_whole_arrays(tmp_path):
    path = npz(tmp_path, one=T_NS * 1e-9, two=GYRO, three=ACCEL, four=TEMP)
    text = "t_s=one,gyro_dps=two,accel_mps2=-three,temp_c=four"
    (topic,) = numpy_file.topics(path, text)
    assert (topic.name, topic.holds, topic.columns) == ("columns", ("gyro", "accel", "temp"), ("one", "two", "three", "four"))
    (stream,) = numpy_file.read(path, [], text)
    np.testing.assert_array_equal(stream.gyro, GYRO)
    np.testing.assert_array_equal(stream.accel, -ACCEL)
    np.testing.assert_array_equal(stream.t_ns, T_NS)
    assert (stream.gyro_unit, stream.accel_unit, stream.temp_unit) == ("dps", "mps2", "c")


def test_columns_name_single_columns_by_name_or_number(tmp_path):
    np.save(tmp_path / "a.npy", np.column_stack([T_NS / 1e6, GYRO, ACCEL]))
    text = "t_ms=1,gx_rps=2,gy_rps=-3,gz_rps=4,ax_g=5,ay_g=6,az_g=7"
    (stream,) = numpy_file.read(tmp_path / "a.npy", [], text)
    np.testing.assert_array_equal(stream.gyro, GYRO * [1, -1, 1])
    np.testing.assert_array_equal(stream.t_ns, T_NS)
    with pytest.raises(FormatError, match="is clear by name"):
        numpy_file.topics(tmp_path / "a.npy", None)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("gyro_dps=none", "no array 'none'"),
        ("gyro=two,gx=two", "given whole and by its axes"),
        ("gx_dps=one,gy_dps=one", "needs x, y and z"),
        ("gx_dps=one,gy_rps=one,gz_dps=one", "in one unit"),
        ("gyro_dps=one", "needs (N, 3)"),
        ("gx=two,gy=two,gz=two", "needs (N,)"),
        ("t_s=one", "neither a gyroscope nor an accelerometer"),
        ("t=one,gyro=two", "t needs a unit"),
        ("t_h=one,gyro=two", "t needs a unit"),
        ("t_s=short,gyro=two", "100 and 120 rows"),
        ("speed=two", "'speed=two' is no column"),
        ("gyro=two,gyro=three", "gyro is given twice"),
    ],
)
def test_wrong_columns_are_refused_in_one_line(text, said, tmp_path):
    path = npz(tmp_path, one=T_NS * 1e-9, two=GYRO, three=ACCEL, short=np.arange(100.0))
    with pytest.raises(FormatError) as raised:
        numpy_file.topics(path, text)
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)


# What each format has of its own.


def test_seconds_of_an_epoch_keep_what_the_file_has_of_them(tmp_path):
    t_s = 1_700_000_000 + np.arange(COUNT) / 128  # exact in double precision
    stream = one(npz(tmp_path, t_s=t_s, gyro=GYRO))
    np.testing.assert_array_equal(stream.t_ns, 1_700_000_000 * 10**9 + np.arange(COUNT) * 7_812_500)


def test_pickles_are_never_opened(tmp_path):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("a pickle was opened",))

    path = npz(tmp_path, gyro=np.array([Trap()] * 4, dtype=object), gyro_rps=GYRO)
    np.testing.assert_array_equal(one(path).gyro, GYRO)
    np.save(tmp_path / "a.npy", np.array([Trap()], dtype=object), allow_pickle=True)
    with pytest.raises(FormatError):
        numpy_file.read(tmp_path / "a.npy", [], None)


def test_an_archive_that_states_more_than_it_holds_is_refused(tmp_path):
    path = tmp_path / "a.npz"
    head = b"\x93NUMPY\x01\x00\x76\x00" + b"{'descr': '<f8', 'fortran_order': False, 'shape': (30000000, 3), }".ljust(117) + b"\n"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("gyro.npy", head + bytes(240))
    with pytest.raises(FormatError):
        numpy_file.read(path, [], None)


def test_hdf5_opens_no_other_file(tmp_path):
    h5py = pytest.importorskip("h5py")
    (tmp_path / "secret.bin").write_bytes(GYRO.tobytes())
    written.write_hdf5(tmp_path / "other.h5", *RECORDING)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("gyro", GYRO.shape, "f8", external=[(str(tmp_path / "secret.bin"), 0, GYRO.nbytes)])
        file["acc"] = h5py.ExternalLink("other.h5", "/imu/acc")
        layout = h5py.VirtualLayout(ACCEL.shape, "f8")
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "imu/acc", ACCEL.shape)
        file.create_virtual_dataset("accel", layout)
    with pytest.raises(FormatError, match="it holds no arrays of numbers"):
        hdf5.topics(tmp_path / "a.h5", None)


def test_hdf5_tables_are_read_by_their_columns(tmp_path):
    h5py = pytest.importorskip("h5py")
    rows = np.zeros(COUNT, [("t_us", "i8"), *((f"{letter}{axis}", "f4") for letter in ("gyr_", "acc_") for axis in "xyz")])
    rows["t_us"] = T_NS // 1000
    for place, axis in enumerate("xyz"):
        rows[f"gyr_{axis}"], rows[f"acc_{axis}"] = GYRO[:, place], ACCEL[:, place]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["log/imu"] = rows
    stream = one(tmp_path / "a.h5")
    np.testing.assert_array_equal(stream.gyro, GYRO)
    np.testing.assert_array_equal(stream.accel, ACCEL)
    np.testing.assert_array_equal(stream.t_ns, T_NS)


def test_hdf5_of_absurd_length_is_refused_before_it_is_read(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("gyro", (10**12, 3), "f8", chunks=(1000, 3))
    with pytest.raises(FormatError, match=r"reading it takes more than 6e\+04 GB of memory, and 1 GB may be taken"):
        hdf5.read(tmp_path / "a.h5", [], None)


def test_a_real_trial_of_broad_is_clear_by_its_names(shared):
    pytest.importorskip("h5py")
    path = shared / "wild" / "broad" / "05_undisturbed_slow_rotation_with_breaks_B.hdf5"
    if not path.is_file():
        pytest.skip(f"no trial of BROAD: {path} is not there")
    (topic,) = hdf5.topics(path, None)
    assert (topic.name, topic.rows, topic.holds) == ("imu", 59212, ("gyro", "accel"))
    stream = one(path)
    assert (stream.t_ns, stream.gyro_unit) == (None, "")
    assert stream.odr_hz == pytest.approx(285.714286)
    assert np.median(np.linalg.norm(stream.accel, axis=1)) == pytest.approx(9.81, abs=0.1)


@pytest.mark.parametrize("packed", [True, False])
def test_matlab_agrees_with_scipy(packed, tmp_path):
    """Another program's answer: types of numbers, one row, texts, structs in structs, cells, what is passed over."""
    io = importlib.import_module("scipy.io")
    rng = np.random.default_rng(2)
    arrays = {
        f"a_{kind}": (rng.normal(size=(5, 3)) * 50).astype(kind) for kind in ("f4", "f8", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8")
    }
    file = {
        **arrays,
        "row": rng.normal(size=(1, 9)),
        "flags": rng.normal(size=(4, 2)) > 0,
        "complex": rng.normal(size=(4, 3)) + 1j,
        "nested": {"inner": {"x": rng.normal(size=(6, 3)), "word": "rad/s"}, "y": np.arange(7.0)},
        "cells": np.array([np.arange(4.0), "text"], dtype=object),
        "cube": rng.normal(size=(2, 3, 4)),
    }
    io.savemat(tmp_path / "a.mat", file, do_compression=packed)
    ours = dict(matlab._variables(tmp_path / "a.mat", notes := []))
    theirs = io.loadmat(tmp_path / "a.mat")
    assert notes == []
    for name in (*arrays, "row", "cube"):
        np.testing.assert_array_equal(ours[name], theirs[name])
        assert ours[name].dtype == theirs[name].dtype or ours[name].dtype.kind in "iu"
    np.testing.assert_array_equal(ours["flags"], theirs["flags"])
    np.testing.assert_array_equal(ours["complex"], theirs["complex"].real)
    np.testing.assert_array_equal(ours["nested.inner.x"], file["nested"]["inner"]["x"])
    assert ours["nested.inner.word"] == "rad/s"
    np.testing.assert_array_equal(ours["nested.y"].ravel(), file["nested"]["y"])
    np.testing.assert_array_equal(ours["cells[0]"].ravel(), np.arange(4.0))


def test_matlab_texts_name_units(tmp_path):
    io = importlib.import_module("scipy.io")
    io.savemat(tmp_path / "a.mat", {"imu": {"t": T_NS * 1e-9, "t_unit": "s", "gyro": GYRO, "gyro_units": "deg/s", "fs": 104.0}})
    stream = one(tmp_path / "a.mat")
    assert (stream.gyro_unit, stream.odr_hz) == ("deg/s", 104)
    np.testing.assert_array_equal(stream.t_ns, T_NS)


def test_a_matlab_file_that_is_cut_gives_its_whole_variables(tmp_path):
    io = importlib.import_module("scipy.io")
    path = tmp_path / "a.mat"
    io.savemat(path, {"t_s": T_NS * 1e-9, "gyro": GYRO, "accel": ACCEL})
    path.write_bytes(path.read_bytes()[:-100])
    stream = one(path)
    np.testing.assert_array_equal(stream.gyro, GYRO)
    assert stream.accel is None
    assert any(note.startswith("cut in the variable at byte") for note in stream.notes)


def test_parquet_columns_of_three_numbers_and_units_in_their_metadata(tmp_path):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    three = pyarrow.list_(pyarrow.float64(), 3)
    schema = pyarrow.schema(
        [
            pyarrow.field("t", pyarrow.int64(), metadata={"units": "us"}),
            pyarrow.field("gyro", three, metadata={"units": "dps"}),
            pyarrow.field("acc", pyarrow.list_(pyarrow.float64())),
        ]
    )
    table = pyarrow.table([pyarrow.array(T_NS // 1000), pyarrow.array(GYRO.tolist(), three), pyarrow.array(ACCEL.tolist())], schema=schema)
    parquet.write_table(table, tmp_path / "a.parquet", row_group_size=50)
    stream = one(tmp_path / "a.parquet")
    np.testing.assert_array_equal(stream.gyro, GYRO)
    np.testing.assert_array_equal(stream.accel, ACCEL)
    np.testing.assert_array_equal(stream.t_ns, T_NS)
    assert (stream.gyro_unit, stream.accel_unit) == ("dps", "")
