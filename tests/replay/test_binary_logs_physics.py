"""Binary logs: what other programs write is read back, number by number, with its units, stamps and notes."""

import importlib
import re
import struct
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import written_logs as written
from numpy.testing import assert_allclose, assert_array_equal

from session.base.budget import budget
from session.base.errors import FormatError
from session.base.units import parse_unit
from session.replay.binary import ardupilot, hdf5, matlab, mcap_file, numpy_file, parquet, ros, rosbag1, rosbag2, ulog
from session.replay.binary.registry import reader_of
from session.replay.named import meaning

COUNT = 120


RNG = np.random.default_rng(7)


#: on whole microseconds, and numbers that single precision holds
T_NS = 5_000_000_000 + 4_807_000 * np.arange(COUNT)


GYRO = RNG.normal(0, 1, (COUNT, 3)).astype(np.float32).astype(float)


ACCEL = RNG.normal([0, 0, -9.8], 1, (COUNT, 3)).astype(np.float32).astype(float)


TEMP = np.linspace(25, 30, COUNT).astype(np.float32).astype(float)


RECORDING = (T_NS, GYRO, ACCEL, TEMP)


def with_(write, **options):
    return lambda *of: write(*of, **options)


#: writer, the reader, the stream with both sensors
FORMATS = {
    "ROS 1": (written.write_ros1, rosbag1.FORMAT, written.TOPIC),
    "ROS 1, bz2": (with_(written.write_ros1, compression="bz2"), rosbag1.FORMAT, written.TOPIC),
    "ROS 1, lz4": (with_(written.write_ros1, compression="lz4"), rosbag1.FORMAT, written.TOPIC),
    "ROS 2": (written.write_ros2, rosbag2.FORMAT, written.TOPIC),
    "ROS 2, zstd": (with_(written.write_ros2, packed=True), rosbag2.FORMAT, written.TOPIC),
    "ROS 2, MCAP": (with_(written.write_ros2, storage="mcap"), rosbag2.FORMAT, written.TOPIC),
    "MCAP": (written.write_mcap, mcap_file.FORMAT, written.TOPIC),
    "MCAP, unpacked": (with_(written.write_mcap, compression="NONE"), mcap_file.FORMAT, written.TOPIC),
    "MCAP, ROS 1": (with_(written.write_mcap, form="ros1", compression="LZ4"), mcap_file.FORMAT, written.TOPIC),
    "ULog": (written.write_ulog, ulog.FORMAT, "sensor_combined[0]"),
    "dataflash": (written.write_ardupilot, ardupilot.FORMAT, "IMU[0]"),
}


ARRAYS = {
    "HDF5": (written.write_hdf5, hdf5.FORMAT, "imu"),
    "HDF5, packed": (with_(written.write_hdf5, chunks=50), hdf5.FORMAT, "imu"),
    "MATLAB 7.3": (written.write_mat73, hdf5.FORMAT, "imu"),
    "MATLAB 5": (written.write_mat, matlab.FORMAT, "imu"),
    "MATLAB 5, unpacked": (with_(written.write_mat, compress=False), matlab.FORMAT, "imu"),
    "npz": (written.write_npz, numpy_file.FORMAT, "imu"),
    "npy": (written.write_npy, numpy_file.FORMAT, "imu"),
    "Parquet": (written.write_parquet, parquet.FORMAT, "imu"),
}


#: one of each reader
EACH_READER = pytest.mark.parametrize("name", ["ROS 1", "ROS 2", "MCAP", "ULog", "dataflash", "HDF5", "MATLAB 5", "npz", "Parquet"])


def file_of(write, tmp_path):
    """What it writes, under a name that says nothing of it."""
    write(tmp_path / "made", *RECORDING)
    (path,) = tmp_path.iterdir()
    return path.rename(tmp_path / "a.dat")


def head_of(path):
    return b"" if path.is_dir() else path.read_bytes()[:4096]


def same(stream, rates=GYRO, forces=ACCEL):
    assert_array_equal(stream.t_ns, T_NS)
    assert_array_equal(stream.parts["gyro"].values, rates)
    assert_array_equal(stream.parts["accel"].values, forces)


def one(path, name=""):
    """The one stream of a file, or that of this name, by the reader that knows the file."""
    (stream,) = reader_of(path, head_of(path)).read(path, [name] if name else [], None)
    return stream


@pytest.mark.parametrize("name", FORMATS | ARRAYS)
def test_every_number_comes_back(name, tmp_path):
    write, reader, topic = (FORMATS | ARRAYS)[name]
    path = file_of(write, tmp_path)
    assert reader_of(path, head_of(path)) is reader
    temp = ("temp",) if name == "dataflash" or name in ARRAYS else ()
    listed = {found.name: found for found in reader.topics(path, None)}
    assert (listed[topic].rows, listed[topic].holds) == (COUNT, ("gyro", "accel", *temp))
    assert listed[topic].columns
    assert [found.name for found in reader.read(path, [], None)] == list(listed)
    same(stream := one(path, topic))
    assert (stream.t_ns.dtype, stream.parts["gyro"].values.dtype) == (np.int64, float)
    if temp:
        assert_array_equal(stream.parts["temp"].values, TEMP)
    assert ("temp" in stream.parts) == bool(temp)
    # in HDF5's words, as its writer has them
    units = ["rad/s", "m/s^2", "degC"] if name.startswith("HDF5") else ["rad/s", "m/s2", "degc"]
    assert [part.unit for part in stream.parts.values()] == units[: len(stream.parts)]


@EACH_READER
def test_a_wrong_name_is_answered_with_those_that_are_there(name, tmp_path):
    write, reader, topic = (FORMATS | ARRAYS)[name]
    path = file_of(write, tmp_path)
    with pytest.raises(FormatError, match=f"nothing.*{re.escape(topic)}"):
        reader.read(path, ["nothing"], None)
    if name in FORMATS:
        with pytest.raises(FormatError, match="leave --columns out"):
            reader.topics(path, "t_s=t")


def test_other_bytes_are_no_log(tmp_path):
    for other in (b"", b"t_us,gx,gy\n", b"\x89PNG\r\n\x1a\n" + bytes(100), b"PK\x03\x04" + bytes(100), bytes(4096)):
        assert reader_of(tmp_path / "other.dat", other) is None


@EACH_READER
def test_more_than_the_budget_is_refused(name, tmp_path):
    write, reader, _ = (FORMATS | ARRAYS)[name]
    path = file_of(write, tmp_path)
    with budget((), 10_000), pytest.raises(FormatError, match=r"(takes|unpacks to) more than .* MB"):
        reader.read(path, [], None)


@pytest.mark.parametrize(
    ("write", "reader", "module", "said"),
    [
        (written.write_ulog, ulog.FORMAT, "pyulog", "a ULog; reading it needs pyulog"),
        (written.write_ros1, rosbag1.FORMAT, "rosbags.rosbag1.reader", "a ROS 1 bag; reading it needs rosbags"),
        (written.write_ros2, rosbag2.FORMAT, "rosbags.typesys", "a ROS 2 bag; reading it needs rosbags"),
        (written.write_mcap, mcap_file.FORMAT, "mcap.stream_reader", "an MCAP file; reading it needs mcap"),
        (written.write_hdf5, hdf5.FORMAT, "h5py", "an HDF5 file; reading it needs h5py"),
        (written.write_parquet, parquet.FORMAT, "pyarrow.parquet", "a Parquet file; reading it needs pyarrow"),
    ],
)
def test_a_package_that_is_not_installed_is_named(write, reader, module, said, tmp_path, monkeypatch):
    path = file_of(write, tmp_path)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(FormatError, match=rf"{said}: python -m pip install -e '.*\[logs\]'"):
        reader.topics(path, None)


# ULog.


def ulog_file(tmp_path, rows, **more):
    path = tmp_path / "a.ulg"
    path.write_bytes(written.ulog_bytes(rows, **more))
    return path


def test_ulog_keeps_instances_apart_and_reads_temperatures(tmp_path):
    path = tmp_path / "a.ulg"
    written.write_ulog(path, *RECORDING)
    first, second = ulog.FORMAT.read(path, ["sensor_gyro[0]", "sensor_gyro[1]"], None)
    assert_allclose(second.parts["gyro"].values - first.parts["gyro"].values, 1, atol=1e-6)
    assert_array_equal(first.parts["temp"].values, TEMP)
    assert_array_equal(first.t_ns, T_NS)  # of the sample, not of the message
    (accel,) = ulog.FORMAT.read(path, ["sensor_accel[0]"], None)
    assert (tuple(accel.parts), accel.parts["temp"].unit) == (("accel", "temp"), "degc")
    assert any("2 dropouts of the logger, 42 ms in all, the longest 30 ms" in note for note in accel.notes)


def test_ulog_increments_over_their_intervals_are_rates(tmp_path):
    dt_us = 5000
    rows = [
        ("vehicle_imu", 0, (t + 9, t, *(w * dt_us * 1e-6), *(f * dt_us * 1e-6), dt_us, dt_us))
        for t, w, f in zip(T_NS // 1000, GYRO, ACCEL, strict=True)
    ]
    stream = one(ulog_file(tmp_path, rows))
    assert_allclose(stream.parts["gyro"].values, GYRO, rtol=1e-6)
    assert_allclose(stream.parts["accel"].values, ACCEL, rtol=1e-6)
    assert_array_equal(stream.t_ns, T_NS)
    assert any("increments" in note for note in stream.notes)


@pytest.mark.parametrize("steady", [True, False])
def test_ulog_fifo_samples_have_their_own_stamps_and_scale(tmp_path, steady):
    """Batches of up to 32 samples, 125 us apart, the last one at the message's stamp."""
    rng, rows, stamps, values = np.random.default_rng(3), [], [], []
    scale = np.float32(2000 / 32768 * written.DEG)
    for number in range(20):
        count, last = int(rng.integers(1, 33)), 1_000_000 + 5000 * number
        counts = np.zeros((32, 3), int)
        counts[:count] = rng.integers(-32768, 32768, (count, 3))
        own = scale if steady or number < 10 else scale / 2
        rows.append(("sensor_gyro_fifo", 0, (last + 99, last, 1, 125.0, own, *counts[:, 0], *counts[:, 1], *counts[:, 2], count)))
        stamps += [last * 1000 - 125_000 * (count - 1 - i) for i in range(count)]
        values += list(counts[:count] * (1 if steady else float(np.float32(own))))
    stream = one(ulog_file(tmp_path, rows))
    assert_array_equal(stream.t_ns, stamps)
    assert_array_equal(stream.parts["gyro"].values, values)
    assert stream.odr_hz == 8000
    if steady:
        assert stream.parts["gyro"].full_scale == pytest.approx(2000, rel=1e-6)
        assert parse_unit("gyro", stream.parts["gyro"].unit).si == pytest.approx(float(scale), rel=1e-12)
    else:
        assert (stream.parts["gyro"].full_scale, stream.parts["gyro"].unit) == (None, "rad/s")


def test_ulog_rows_with_impossible_stamps_are_left_out(tmp_path):
    rows = [("sensor_combined", 0, (t, 0, 0, 1, 5000, 1, 0, 0, -9.8, 5000)) for t in (1000, 2**63, 3000)]
    stream = one(ulog_file(tmp_path, rows))
    assert any("the accelerometer's samples are +1 us from the gyroscope's" in note for note in stream.notes)
    assert_array_equal(stream.t_ns, [1_000_000, 3_000_000])
    assert any("1 rows with stamps that are no time" in note for note in stream.notes)


def test_ulog_that_nests_without_end_is_refused_before_it_is_unfolded(tmp_path):
    levels = [f"{a}:{b}[60000] x;" for a, b in pairwise("abcde")] + ["e:uint8_t x;"]
    loop = ["a:b x;", "b:a x;"]
    whole = written.ulog_bytes([("sensor_combined", 0, (1, *[0] * 9))])
    for formats, said in ((levels, "more fields than a message has bytes"), (loop, "holds itself")):
        place = 16 + 3 + 40
        bad = whole[:place] + b"".join(written.ulog_message("F", text.encode()) for text in formats) + whole[place:]
        (tmp_path / "a.ulg").write_bytes(bad)
        with pytest.raises(FormatError, match=said):
            ulog.FORMAT.topics(tmp_path / "a.ulg", None)


# ROS.


def test_a_bag_without_its_index_is_read(tmp_path):
    """A recorder that was killed has written neither the index nor its place."""
    path = tmp_path / "a.bag"
    written.write_ros1(path, *RECORDING)
    data = path.read_bytes()
    place = data.index(b"index_pos=") + len(b"index_pos=")
    (end,) = struct.unpack_from("<Q", data, place)
    path.write_bytes(data[:place] + bytes(8) + data[place + 8 : end])
    assert_array_equal(one(path).parts["gyro"].values, GYRO)
    assert one(path).notes == ()


def test_a_bag_of_several_files_is_one(tmp_path):
    half = COUNT // 2
    for number, part in enumerate((slice(0, half), slice(half, COUNT))):
        written.write_ros2(tmp_path / f"part{number}", *(values[part] for values in RECORDING))
    folder = tmp_path / "bag"
    folder.mkdir()
    for number in range(2):
        (tmp_path / f"part{number}" / f"part{number}.db3").rename(folder / f"bag_{number}.db3")
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n  version: 5\n  relative_file_paths:\n    - bag_0.db3\n    - bag_1.db3\n  message_count: 120\n"
    )
    assert_array_equal(one(folder).parts["gyro"].values, GYRO)
    (folder / "bag_1.db3").unlink()
    with pytest.raises(FormatError, match=r"bag_1\.db3: cannot be read"):
        one(folder)
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  relative_file_paths:\n    - bag_0.db3.zstd\n")
    with pytest.raises(FormatError, match="unpack it"):
        one(folder)


def ros2_bag_of(path, name, text, messages):
    """A bag of one topic of somebody's own type; messages: (stamp, keyword arguments)."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(text, name))
    with Writer(path, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/fmu/out/imu", name, typestore=store)
        for stamp, values in messages:
            writer.write(connection, stamp, bytes(store.serialize_cdr(store.types[name](**values), name)))


def test_messages_of_px4_in_a_ros_2_bag_are_read_by_their_definition(tmp_path):
    """Single precision, arrays, a flag before them that shifts what must be aligned, a stamp in us."""
    text = "uint64 timestamp\nuint8 flag\nfloat32[3] gyro_rad\nuint32 gyro_integral_dt\nfloat32[3] accelerometer_m_s2\n"
    names = ("timestamp", "flag", "gyro_rad", "gyro_integral_dt", "accelerometer_m_s2")
    rows = ((t // 1000, 1, w.astype(np.float32), 5000, f.astype(np.float32)) for t, w, f in zip(T_NS.tolist(), GYRO, ACCEL, strict=True))
    messages = [(1000 * row[0] + 3_000_000, dict(zip(names, row, strict=True))) for row in rows]
    ros2_bag_of(tmp_path / "bag", "px4_msgs/msg/SensorCombined", text, messages)
    same(stream := one(tmp_path / "bag"))
    assert (stream.parts["gyro"].unit, stream.parts["accel"].unit) == ("rad/s", "m/s2")


def test_numbers_behind_texts_and_sequences_are_found(tmp_path):
    text = "string name\nuint8[] blob\nfloat64[] list\nfloat64 gyro_x\nfloat64 gyro_y\nfloat64 gyro_z\nstring tail\n"
    rates = [dict(zip(("gyro_x", "gyro_y", "gyro_z"), w, strict=True)) for w in GYRO[:30]]
    before = [{"name": "x" * i, "blob": np.zeros(i % 5, np.uint8), "list": np.zeros(i % 3), "tail": "end"} for i in range(30)]
    messages = [(1000 * i, before[i] | rates[i]) for i in range(30)]
    ros2_bag_of(tmp_path / "bag", "my_msgs/msg/Rates", text, messages)
    stream = one(tmp_path / "bag")
    assert_array_equal(stream.parts["gyro"].values, GYRO[:30])
    assert_array_equal(stream.t_ns, 1000 * np.arange(30))
    assert stream.parts["gyro"].unit == ""  # nobody says it
    assert any("the time is the recorder's" in note for note in stream.notes)


def test_the_layout_agrees_with_rosbags_on_every_number_of_an_imu():
    """Another program's answer: each scalar of a message, little and big-endian, and as ROS 1 packs it."""
    from rosbags.typesys import Stores, get_typestore

    rng = np.random.default_rng(5)
    for store_of, ros1 in ((Stores.ROS2_HUMBLE, False), (Stores.ROS1_NOETIC, True)):
        store = get_typestore(store_of)
        layout = ros.Layout(Path("a.bag"), dict(store.fielddefs), ros.IMU, cdr=not ros1)
        layout.want(layout.paths)
        for frame in ("", "a", "imu_link", "frame of 13 .."):
            message = written.ros_imu(store, ros1, 123_456_789_012, rng.normal(size=3), rng.normal(size=3), frame)
            message.orientation_covariance[:] = rng.normal(size=9)
            forms = (
                [store.serialize_ros1(message, ros.IMU)]
                if ros1
                else [store.serialize_cdr(message, ros.IMU, little_endian=end) for end in (True, False)]
            )
            for data in forms:
                got = dict(zip(layout.paths, layout(bytes(data)), strict=True))
                assert (got["header.stamp.sec"], got["header.stamp.nanosec"]) == (123, 456_789_012)
                for path, value in got.items():
                    if path.startswith("header"):
                        continue
                    field, _, rest = path.partition("." if "." in path else "[")
                    there = getattr(message, field)
                    assert value == (there[int(rest[:-1])] if isinstance(there, np.ndarray) else getattr(there, rest)), path


@pytest.mark.parametrize(
    ("kind", "path", "ns"),
    [
        *(("a/msg/B", path, ns) for path, ns in (("t_ns", 1), ("t_us", 1000), ("t_ms", 10**6), ("t_s", 10**9))),
        ("px4_msgs/msg/B", "timestamp", 1000),
    ],
)
def test_a_stamp_is_in_the_unit_of_its_name_or_of_its_package(kind, path, ns):
    assert ros.fields_of(["gyro.x", "gyro.y", "gyro.z", path], kind).stamp == ((path, ns),)


# ArduPilot.


def test_dataflash_says_what_it_passed_over(tmp_path):
    """Bytes of no message between two messages, and a mark among them that begins none."""
    path = tmp_path / "a.BIN"
    written.write_ardupilot(path, *RECORDING)
    data = path.read_bytes()
    middle = data.index(b"\xa3\x95\x81", len(data) // 2)
    path.write_bytes(data[:middle] + b"\x00\xa3\x95\x81\xff\xa3\x95" + data[middle:])
    stream = one(path, "IMU[0]")
    assert_array_equal(stream.parts["gyro"].values, GYRO)
    assert f"the log is damaged at byte {middle}: 7 bytes that hold no message are passed over" in stream.notes


def test_dataflash_units_are_those_of_its_own_records_or_documented(tmp_path):
    """A multiplier of the angular rates alone; without FMTU, what ArduPilot documents."""
    path = tmp_path / "a.BIN"
    written.write_ardupilot(path, *RECORDING)
    path.write_bytes(path.read_bytes().replace(b"F" + b"-" * 14, b"F-FFF" + b"-" * 10))
    assert (one(path, "IMU[0]").parts["gyro"].unit, one(path, "IMU[0]").parts["accel"].unit) == ("1e-06rad/s", "m/s2")
    data = path.read_bytes()
    path.write_bytes(data.replace(b"rad/s" + bytes(3), b"rad/s\0\0x"))  # a text ends at its first byte of nought
    assert one(path, "IMU[0]").parts["gyro"].unit == "1e-06rad/s"
    for without in (
        data.replace(struct.pack("<d", 1e-6), struct.pack("<d", 1.0)),
        data.replace(b"F-FFF", b"F-???"),  # of no record
        data.replace(b"F-FFF" + b"-" * 10, b"F".ljust(15, b"\0")),  # of the time alone
    ):
        path.write_bytes(without)
        assert one(path, "IMU[0]").parts["gyro"].unit == "rad/s"
    written.write_ardupilot(path, *RECORDING, units=False)
    stream = one(path, "IMU[0]")
    assert (stream.parts["gyro"].unit, stream.parts["accel"].unit) == ("rad/s", "m/s2")
    assert "the unit of GyrX is taken as ArduPilot documents it" in stream.notes


def test_dataflash_agrees_with_pymavlink(tmp_path):
    """Another program's answer."""
    reader = pytest.importorskip("pymavlink.DFReader")
    path = tmp_path / "a.BIN"
    written.write_ardupilot(path, *RECORDING)
    log, rows = reader.DFReader_binary(str(path)), []
    while (message := log.recv_match(type="IMU")) is not None:
        if message.I == 1:
            rows.append([message.TimeUS, *(getattr(message, f"{what}{axis}") for what in ("Gyr", "Acc") for axis in "XYZ"), message.T])
    log.filehandle.close()
    theirs, ours = np.array(rows), one(path, "IMU[1]")
    assert_array_equal(ours.t_ns // 1000, theirs[:, 0])
    assert_array_equal(np.column_stack([part.values for part in ours.parts.values()]), theirs[:, 1:])


# Arrays: names, shapes, units, and what each format has of its own.


@pytest.mark.parametrize(
    ("name", "kind", "axis", "unit", "of"),
    [
        ("angular_velocity.x", "gyro", 0, "", ""),
        ("imu1/gyr_z [deg/s]", "gyro", 2, "deg/s", "imu.1"),
        ("Gyroscope X (deg/s)", "gyro", 0, "deg/s", ""),
        ("gyro0_y", "gyro", 1, "", "0"),
        ("w", "gyro", None, "", ""),
        ("wz", "gyro", 2, "", ""),
        ("gyrox", "gyro", 0, "", ""),
        ("imu_angular_velocity.x", "gyro", 0, "", "imu"),
        ("imu gyro data", "gyro", None, "", "imu"),
        ("imu_gyroy", "gyro", 1, "", "imu"),
        ("accelerometer_m_s2[2]", "accel", 2, "m/s2", ""),
        ("lin_acc", "accel", None, "", ""),
        ("AccZ", "accel", 2, "", ""),
        ("TimeUS", "time", None, "us", ""),
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


def npz(tmp_path, **arrays):
    path = tmp_path / "a.npz"
    np.savez(path, **arrays)
    return path


def test_rows_for_axes_are_turned(tmp_path):
    same(stream := one(npz(tmp_path, time_s=T_NS * 1e-9, gyro=GYRO.T, acc=ACCEL)))
    assert "gyro has a row for each axis" in stream.notes
    assert_array_equal(one(npz(tmp_path, t_us=T_NS // 1000, gyro=GYRO)).t_ns, T_NS)
    twice = one(npz(tmp_path, time=T_NS // 7, t_us=T_NS // 1000, gyro=GYRO))
    assert_array_equal(twice.t_ns, T_NS)
    assert "of several times t_us is taken, which states its unit" in twice.notes


def test_arrays_without_stamps_or_units_have_none_and_a_rate_where_it_stands(tmp_path):
    stream = one(npz(tmp_path, gyr=GYRO, acc=ACCEL, sampling_rate=208.5))
    assert (stream.t_ns, stream.parts["gyro"].unit, stream.parts["accel"].unit, stream.odr_hz) == (None, "", "", 208.5)


@pytest.mark.parametrize(
    ("arrays", "said"),
    [
        ({"one": GYRO, "two": ACCEL}, "is clear by name; it holds one (120, 3), two (120, 3)"),
        ({"gyro": GYRO, "gyr": GYRO}, "gyro and gyr may both be the gyro"),
        ({"gyro": GYRO, "time": T_NS}, "does not state the unit of its time 'time'"),
        ({"gx_dps": GYRO[:, 0], "gy_rps": GYRO[:, 1], "gz_dps": GYRO[:, 2]}, "in different units (dps, rad/s)"),
        ({"gyro_x": GYRO[:, 0], "gyro_y": GYRO[:, 1]}, "is clear by name"),
        ({"label": np.array(["a", "b"])}, "it holds no arrays of numbers"),
        *(({"gyro": GYRO, "t_s": np.full(COUNT, t_s)}, "t_s holds stamps that are no time in s") for t_s in (np.nan, 2**63 / 1e9)),
    ],
)
def test_what_is_not_clear_is_listed(arrays, said, tmp_path):
    with pytest.raises(FormatError) as raised:
        numpy_file.FORMAT.read(npz(tmp_path, **arrays), [], None)
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)


def test_columns_name_whole_arrays(tmp_path):
    path = npz(tmp_path, one=T_NS * 1e-9, two=GYRO, three=ACCEL, four=TEMP)
    text = "t_s=1,gyro_dps=two,accel_mps2=-3,temp_c=4"  # by its name or its place
    (topic,) = numpy_file.FORMAT.topics(path, text)
    assert (topic.name, topic.holds, topic.columns) == ("columns", ("gyro", "accel", "temp"), ("one", "two", "three", "four"))
    (stream,) = numpy_file.FORMAT.read(path, [], text)
    same(stream, GYRO, -ACCEL)
    assert (stream.parts["gyro"].unit, stream.parts["accel"].unit, stream.parts["temp"].unit) == ("dps", "mps2", "c")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("gyro_dps=none", "no array 'none'"),
        ("gyro_dps=0", "no array '0'"),
        ("gx_dps=one", "needs x, y and z in one unit"),
        ("gx_dps=one,gy_dps=one", "needs x, y and z in one unit"),
        ("gyro=two,gx=two", "given whole and by its axes"),
        ("gx_dps=one,gy_rps=one,gz_dps=one", "in one unit"),
        ("gyro_dps=one", "needs (N, 3)"),
        ("t_s=one", "neither a gyroscope nor an accelerometer"),
        ("t=one,gyro=two", "t needs a unit"),
        ("t_s=short,gyro=two", "100 and 120 rows"),
        ("speed=two", "'speed=two' is no column"),
        ("gyro=two,gyro=three", "gyro is given twice"),
    ],
)
def test_wrong_columns_are_refused_in_one_line(text, said, tmp_path):
    path = npz(tmp_path, one=T_NS * 1e-9, two=GYRO, three=ACCEL, short=np.arange(100.0))
    with pytest.raises(FormatError) as raised:
        numpy_file.FORMAT.topics(path, text)
    assert said in str(raised.value)
    assert "\n" not in str(raised.value)


def test_pickles_are_never_opened(tmp_path):
    class Trap:
        def __reduce__(self):
            return (pytest.fail, ("a pickle was opened",))

    path = npz(tmp_path, gyro=np.array([Trap()] * 4, dtype=object), gyro_rps=GYRO)
    assert_array_equal(one(path).parts["gyro"].values, GYRO)
    np.save(tmp_path / "a.npy", np.array([Trap()], dtype=object), allow_pickle=True)
    with pytest.raises(FormatError):
        numpy_file.FORMAT.read(tmp_path / "a.npy", [], None)


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
        hdf5.FORMAT.topics(tmp_path / "a.h5", None)


def deep(value):
    """Eight levels of structs and cells."""
    for _ in range(4):
        value = {"d": np.array([value, "text"], dtype=object)}
    return value


def test_matlab_agrees_with_scipy(tmp_path):
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
        "deep": deep(1.0),
        "deeper": deep({"d": 1.0}),
    }
    io.savemat(tmp_path / "a.mat", file, do_compression=True)
    ours = dict(matlab._variables(tmp_path / "a.mat", notes := []))
    theirs = io.loadmat(tmp_path / "a.mat")
    assert notes == []
    for name in (*arrays, "row", "cube"):
        assert_array_equal(ours[name], theirs[name])
        assert ours[name].dtype == theirs[name].dtype or ours[name].dtype.kind in "iu"
    assert_array_equal(ours["flags"], theirs["flags"])
    assert_array_equal(ours["complex"], theirs["complex"].real)
    assert_array_equal(ours["nested.inner.x"], file["nested"]["inner"]["x"])
    assert ours["nested.inner.word"] == "rad/s"
    assert_array_equal(ours["nested.y"].ravel(), file["nested"]["y"])
    assert_array_equal(ours["cells[0]"].ravel(), np.arange(4.0))
    assert ours["deep" + 4 * ".d[0]"] == 1.0
    assert "deeper" + 4 * ".d[0]" + ".d" not in ours


@pytest.mark.parametrize("order", "<>")
def test_matlab_of_both_byte_orders(order, tmp_path):
    """Elements by hand: numbers column by column, a text of two bytes a letter, a small element."""

    def element(kind, body):
        return struct.pack(order + "II", kind, len(body)) + body + bytes(-len(body) % 8)

    def matrix(name, kind, shape, body):
        sizes = struct.pack(f"{order}{len(shape)}i", *shape)
        small = struct.pack(order + "I", 1 | len(name) << 16) + name.ljust(4, b"\0")
        return element(14, element(6, struct.pack(order + "II", kind, 0)) + element(5, sizes) + small + body)

    values = np.arange(6.0).reshape(2, 3)
    numbers = matrix(b"a", 6, (2, 3), element(9, values.T.astype(order + "f8").tobytes()))
    word = matrix(b"unit", 4, (1, 3), element(17, "°/s".encode("utf-16-le" if order == "<" else "utf-16-be")))
    head = b"MATLAB 5.0 MAT-file".ljust(124) + struct.pack(order + "H", 0x0100) + (b"IM" if order == "<" else b"MI")
    (tmp_path / "a.mat").write_bytes(head + numbers + word)
    found = dict(matlab._variables(tmp_path / "a.mat", notes := []))
    assert (list(found), found["unit"], notes) == (["a", "unit"], "°/s", [])
    assert_array_equal(found["a"], values)
