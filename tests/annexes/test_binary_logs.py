"""Binary logs: what other programs write is read back, number by number, with its units, stamps and notes."""

import re
import struct
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import written_logs as written

from session.annexes.logs import ardupilot, betaflight, mcap_file, registry, ros, rosbag1, rosbag2, ulog
from session.annexes.logs.registry import reader_of
from session.io.annexes import need
from session.io.budget import Budget, budget
from session.io.errors import FormatError
from session.io.units import parse_unit

COUNT = 120
RNG = np.random.default_rng(7)
#: on whole microseconds, and numbers that single precision holds
T_NS = 5_000_000_000 + 4_807_000 * np.arange(COUNT)
GYRO = RNG.normal(0, 1, (COUNT, 3)).astype(np.float32).astype(float)
ACCEL = RNG.normal([0, 0, -9.8], 1, (COUNT, 3)).astype(np.float32).astype(float)
TEMP = np.linspace(25, 30, COUNT).astype(np.float32).astype(float)
RECORDING = (T_NS, GYRO, ACCEL, TEMP)
#: writer, file, the reader, the stream with both sensors, its temperature, what one count may be off
FORMATS = {
    "ROS 1": (written.write_ros1, "a.bag", rosbag1, written.TOPIC, False),
    "ROS 1, bz2": (lambda *a: written.write_ros1(*a, compression="bz2"), "a.bag", rosbag1, written.TOPIC, False),
    "ROS 1, lz4": (lambda *a: written.write_ros1(*a, compression="lz4"), "a.bag", rosbag1, written.TOPIC, False),
    "ROS 2": (written.write_ros2, "bag", rosbag2, written.TOPIC, False),
    "ROS 2, zstd": (lambda *a: written.write_ros2(*a, packed=True), "bag", rosbag2, written.TOPIC, False),
    "ROS 2, MCAP": (lambda *a: written.write_ros2(*a, storage="mcap"), "bag", rosbag2, written.TOPIC, False),
    "MCAP": (written.write_mcap, "a.mcap", mcap_file, written.TOPIC, False),
    "MCAP, unpacked": (lambda *a: written.write_mcap(*a, compression="NONE"), "a.mcap", mcap_file, written.TOPIC, False),
    "MCAP, ROS 1": (lambda *a: written.write_mcap(*a, form="ros1", compression="LZ4"), "a.mcap", mcap_file, written.TOPIC, False),
    "MCAP, JSON": (lambda *a: written.write_mcap(*a, form="json"), "a.mcap", mcap_file, written.TOPIC, False),
    "ULog": (written.write_ulog, "a.ulg", ulog, "sensor_combined[0]", False),
    "dataflash": (written.write_ardupilot, "a.BIN", ardupilot, "IMU[0]", True),
}
HEAD = 4096
SI = {"gyro": "rad/s", "accel": "m/s2"}
each_format = pytest.mark.parametrize("name", FORMATS)


def head_of(path: Path) -> bytes:
    return b"" if path.is_dir() else path.read_bytes()[:4096]


def one(path: Path, name: str = ""):
    """The one stream of a file, or that of this name, by the reader that knows the file."""
    (stream,) = reader_of(path, head_of(path)).read(path, [name] if name else [], None)
    return stream


@each_format
def test_every_number_comes_back(name, tmp_path):
    write, file, reader, topic, has_temp = FORMATS[name]
    path = tmp_path / file
    write(path, *RECORDING)
    assert reader_of(path, head_of(path)) is reader
    listed = {found.name: found for found in reader.topics(path, None)}[topic]
    assert (listed.rows, listed.holds) == (COUNT, ("gyro", "accel", "temp") if has_temp else ("gyro", "accel"))
    assert listed.columns
    stream = one(path, topic)
    np.testing.assert_array_equal(stream.t_ns, T_NS)
    np.testing.assert_array_equal(stream.gyro, GYRO)
    np.testing.assert_array_equal(stream.accel, ACCEL)
    assert (stream.gyro_unit, stream.accel_unit) == ("rad/s", "m/s2")
    assert stream.t_ns.dtype == np.int64
    assert stream.gyro.dtype == float
    if has_temp:
        np.testing.assert_array_equal(stream.temp, TEMP)
    assert (stream.temp is not None) == has_temp
    assert [found.name for found in reader.read(path, [], None)] == [found.name for found in reader.topics(path, None)]


@each_format
def test_a_wrong_name_is_answered_with_those_that_are_there(name, tmp_path):
    write, file, reader, topic, _ = FORMATS[name]
    write(tmp_path / file, *RECORDING)
    with pytest.raises(FormatError, match=f"nothing.*{re.escape(topic)}"):
        reader.read(tmp_path / file, ["nothing"], None)
    with pytest.raises(FormatError, match="leave --columns out"):
        reader.topics(tmp_path / file, "t_s=t")


def test_a_file_is_known_by_its_bytes_whatever_its_name(tmp_path):
    for name, (write, file, reader, _, _) in FORMATS.items():
        if file == "bag":
            continue
        path = tmp_path / f"{name}.dat"
        write(path, *RECORDING)
        assert reader_of(path, head_of(path)) is reader, name
    for other in (b"", b"t_us,gx,gy\n", b"\x89PNG\r\n\x1a\n" + bytes(100), b"PK\x03\x04" + bytes(100), bytes(4096)):
        assert reader_of(tmp_path / "other.dat", other) is None


def test_the_core_finds_the_readers_by_name():
    assert need("binary logs") is registry


@pytest.mark.parametrize(
    ("name", "module", "said"),
    [
        ("ULog", "pyulog", "a ULog; reading it needs pyulog: python -m pip install 'tinygc[logs]'"),
        ("ROS 1", "rosbags.rosbag1.reader", "a ROS 1 bag; reading it needs rosbags: python -m pip install 'tinygc[logs]'"),
        ("ROS 2", "rosbags.typesys", "a ROS 2 bag; reading it needs rosbags: python -m pip install 'tinygc[logs]'"),
        ("MCAP", "mcap.stream_reader", "an MCAP file; reading it needs mcap: python -m pip install 'tinygc[logs]'"),
    ],
)
def test_a_package_that_is_not_installed_is_named(name, module, said, tmp_path, monkeypatch):
    write, file, reader, _, _ = FORMATS[name]
    write(tmp_path / file, *RECORDING)
    monkeypatch.setitem(sys.modules, module, None)
    for call in (reader.topics, lambda path, columns: reader.read(path, [], columns)):
        with pytest.raises(FormatError) as raised:
            call(tmp_path / file, None)
        assert str(raised.value).endswith(said)


@pytest.mark.parametrize("name", ["ROS 1", "ROS 2", "MCAP", "ULog", "dataflash"])
def test_more_than_the_budget_is_refused(name, tmp_path):
    write, file, reader, _, _ = FORMATS[name]
    write(tmp_path / file, *RECORDING)
    with budget((), 10_000), pytest.raises(FormatError, match=r"(takes|unpacks to) more than .* MB"):
        reader.read(tmp_path / file, [], None)


# ULog.


def ulog_file(tmp_path, rows, **more):
    path = tmp_path / "a.ulg"
    path.write_bytes(written.ulog_bytes(rows, **more))
    return path


def test_ulog_keeps_instances_apart_and_reads_temperatures(tmp_path):
    path = tmp_path / "a.ulg"
    written.write_ulog(path, *RECORDING)
    first, second = ulog.read(path, ["sensor_gyro[0]", "sensor_gyro[1]"], None)
    np.testing.assert_allclose(second.gyro - first.gyro, 1, atol=1e-6)
    np.testing.assert_array_equal(first.temp, TEMP)
    np.testing.assert_array_equal(first.t_ns, T_NS)  # of the sample, not of the message
    (accel,) = ulog.read(path, ["sensor_accel[0]"], None)
    assert (accel.gyro, accel.holds, accel.temp_unit) == (None, ("accel", "temp"), "degc")
    assert any("2 dropouts of the logger, 42 ms in all, the longest 30 ms" in note for note in accel.notes)


def test_ulog_increments_over_their_intervals_are_rates(tmp_path):
    dt_us = 5000
    rows = [
        ("vehicle_imu", 0, (t + 9, t, *(w * dt_us * 1e-6), *(f * dt_us * 1e-6), dt_us, dt_us))
        for t, w, f in zip(T_NS // 1000, GYRO, ACCEL, strict=True)
    ]
    stream = one(ulog_file(tmp_path, rows))
    np.testing.assert_allclose(stream.gyro, GYRO, rtol=1e-6)
    np.testing.assert_allclose(stream.accel, ACCEL, rtol=1e-6)
    np.testing.assert_array_equal(stream.t_ns, T_NS)
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
    np.testing.assert_array_equal(stream.t_ns, stamps)
    np.testing.assert_array_equal(stream.gyro, values)
    assert stream.odr_hz == 8000
    if steady:
        assert stream.gyro_fs_dps == pytest.approx(2000, rel=1e-6)
        assert parse_unit("gyro", stream.gyro_unit).si == pytest.approx(float(scale), rel=1e-12)
    else:
        assert (stream.gyro_fs_dps, stream.gyro_unit) == (None, "rad/s")


def test_ulog_fifo_of_the_accelerometer_is_in_parts_of_its_range(tmp_path):
    scale = np.float32(16 * written.G / 32768)
    counts = np.arange(96).reshape(3, 32)
    stream = one(ulog_file(tmp_path, [("sensor_accel_fifo", 0, (99, 4000, 1, 125.0, scale, *counts.ravel(), 32))]))
    np.testing.assert_array_equal(stream.accel, counts.T)
    assert stream.holds == ("accel",)
    assert stream.accel_fs_g == pytest.approx(16, rel=1e-6)
    assert parse_unit("accel", stream.accel_unit).si == pytest.approx(float(scale), rel=1e-12)


def test_ulog_rows_with_impossible_stamps_are_left_out(tmp_path):
    rows = [("sensor_combined", 0, (t, 0, 0, 1, 5000, 0, 0, 0, -9.8, 5000)) for t in (1000, 2**63, 3000)]
    stream = one(ulog_file(tmp_path, rows))
    np.testing.assert_array_equal(stream.t_ns, [1_000_000, 3_000_000])
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
            ulog.topics(tmp_path / "a.ulg", None)


def test_a_real_ulog_holds_three_imus(shared):
    """A CubeOrange: one combined stream at the logger's rate, and three sensors of each kind; gravity points down its z axis."""
    path = shared / "wild" / "px4_small.ulg"
    if not path.is_file():
        pytest.skip(f"no real ULog: {path} is not there")
    rows = {topic.name: topic.rows for topic in ulog.topics(path, None)}
    assert rows["sensor_combined[0]"] == 1298
    assert {name.split("[")[0] for name in rows} == {"sensor_combined", "vehicle_imu", "sensor_gyro", "sensor_accel"}
    assert len(rows) == 10
    stream = one(path, "sensor_combined[0]")
    np.testing.assert_allclose(np.median(stream.accel, axis=0), [0, 0, -9.8], atol=0.3)
    assert abs(np.median(stream.gyro, axis=0)).max() < 0.05
    assert 190 < 1e9 / np.median(np.diff(stream.t_ns)) < 210
    for number in range(3):
        assert one(path, f"sensor_gyro[{number}]").temp[0] == pytest.approx(45, abs=25)
        norm = np.linalg.norm(one(path, f"vehicle_imu[{number}]").accel, axis=1)
        np.testing.assert_allclose(norm, 9.8, atol=0.3)


# ROS.


@pytest.mark.parametrize("name", ["ROS 1", "ROS 2", "ROS 2, zstd"])
def test_a_camera_sends_its_two_sensors_on_two_topics(name, tmp_path):
    write = {"ROS 1": written.write_ros1, "ROS 2": written.write_ros2}[name.split(",")[0]]
    path = tmp_path / "bag"
    write(path, *RECORDING, split=True, **({"packed": True} if "zstd" in name else {}))
    reader = rosbag1 if write is written.write_ros1 else rosbag2
    assert [(topic.name, topic.holds) for topic in reader.topics(path, None)] == [
        ("/camera/gyro/sample", ("gyro",)),
        ("/camera/accel/sample", ("accel",)),
    ]
    gyro, accel = reader.read(path, [], None)
    np.testing.assert_array_equal(gyro.gyro, GYRO)
    np.testing.assert_array_equal(accel.accel, ACCEL)
    assert (gyro.accel, gyro.accel_unit, accel.gyro, accel.gyro_unit) == (None, "", None, "")


@pytest.mark.parametrize("write", [written.write_ros1, written.write_ros2])
def test_stamps_that_stand_still_give_way_to_the_recorders(write, tmp_path):
    logged = T_NS + 3_000_000
    stuck = np.full(COUNT, T_NS[0])
    messages = written.ros_messages

    def of_a_stuck_clock(store, ros1, t_ns, gyro, accel, split):
        for (topic, _, data), stamp in zip(messages(store, ros1, stuck, gyro, accel, split), logged.tolist(), strict=True):
            yield topic, stamp, data

    written.ros_messages = of_a_stuck_clock
    try:
        write(tmp_path / "bag", *RECORDING)
    finally:
        written.ros_messages = messages
    stream = one(tmp_path / "bag")
    np.testing.assert_array_equal(stream.t_ns, logged)
    assert any("do not go forward 119 times: the time is the recorder's" in note for note in stream.notes)


def test_a_bag_without_its_index_is_read(tmp_path):
    """A recorder that was killed has written neither the index nor its place."""
    path = tmp_path / "a.bag"
    written.write_ros1(path, *RECORDING)
    data = path.read_bytes()
    place = data.index(b"index_pos=") + len(b"index_pos=")
    (end,) = struct.unpack_from("<Q", data, place)
    path.write_bytes(data[:place] + bytes(8) + data[place + 8 : end])
    np.testing.assert_array_equal(one(path).gyro, GYRO)
    assert one(path).notes == ()


def test_a_ros_2_bag_without_definitions_is_read_by_those_of_ros(tmp_path):
    """As ROS 2 up to Humble records it."""
    import sqlite3

    written.write_ros2(tmp_path / "bag", *RECORDING)
    path = tmp_path / "bag" / "bag.db3"
    with sqlite3.connect(path) as database:
        database.execute("DROP TABLE message_definitions")
    database.close()
    np.testing.assert_array_equal(one(path).gyro, GYRO)


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
    np.testing.assert_array_equal(one(folder).gyro, GYRO)
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
    messages = [
        (
            int(t) + 3_000_000,
            {
                "timestamp": int(t) // 1000,
                "flag": 1,
                "gyro_rad": w.astype(np.float32),
                "gyro_integral_dt": 5000,
                "accelerometer_m_s2": f.astype(np.float32),
            },
        )
        for t, w, f in zip(T_NS, GYRO, ACCEL, strict=True)
    ]
    ros2_bag_of(tmp_path / "bag", "px4_msgs/msg/SensorCombined", text, messages)
    stream = one(tmp_path / "bag")
    np.testing.assert_array_equal(stream.t_ns, T_NS)
    np.testing.assert_array_equal(stream.gyro, GYRO)
    np.testing.assert_array_equal(stream.accel, ACCEL)
    assert (stream.gyro_unit, stream.accel_unit) == ("rad/s", "m/s2")


@pytest.mark.parametrize("several", [True, False])
def test_definitions_may_be_idl(tmp_path, several):
    from mcap.writer import Writer

    idl = "module my_msgs { module msg { struct Rates { double gyro_x; double gyro_y; double gyro_z; }; }; };\n"
    text = f"{'=' * 80}\nIDL: my_msgs/msg/Rates\n{idl}" if several else idl
    with (tmp_path / "a.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/rates", "cdr", writer.register_schema("my_msgs/msg/Rates", "ros2idl", text.encode()))
        for number, w in enumerate(GYRO):
            writer.add_message(channel, 1000 * number, b"\0\1\0\0" + w.tobytes(), 1000 * number)
        writer.finish()
    np.testing.assert_array_equal(one(tmp_path / "a.mcap").gyro, GYRO)


def test_numbers_behind_texts_and_sequences_are_found(tmp_path):
    text = "string name\nuint8[] blob\nfloat64[] list\nfloat64 gyro_x\nfloat64 gyro_y\nfloat64 gyro_z\nstring tail\n"
    messages = [
        (
            1000 * i,
            {
                "name": "x" * i,
                "blob": np.zeros(i % 5, np.uint8),
                "list": np.zeros(i % 3),
                "gyro_x": w[0],
                "gyro_y": w[1],
                "gyro_z": w[2],
                "tail": "end",
            },
        )
        for i, w in enumerate(GYRO[:30])
    ]
    ros2_bag_of(tmp_path / "bag", "my_msgs/msg/Rates", text, messages)
    stream = one(tmp_path / "bag")
    np.testing.assert_array_equal(stream.gyro, GYRO[:30])
    np.testing.assert_array_equal(stream.t_ns, 1000 * np.arange(30))
    assert stream.gyro_unit == ""  # nobody says it
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


def test_a_bag_of_other_things_names_its_topics(tmp_path):
    ros2_bag_of(tmp_path / "bag", "my_msgs/msg/Wheel", "float64 speed\n", [(0, {"speed": 1.0})])
    with pytest.raises(FormatError, match=re.escape("its topics are /fmu/out/imu (my_msgs/msg/Wheel)")):
        rosbag2.topics(tmp_path / "bag", None)


def test_chunks_that_unpack_to_more_than_the_memory_are_left_out(tmp_path, monkeypatch):
    monkeypatch.setattr(Budget, "piece", 256)
    for name in ("ROS 1, bz2", "ROS 1, lz4", "MCAP", "MCAP, ROS 1"):
        write, _, reader, _, _ = FORMATS[name]
        path = tmp_path / name
        write(path, *RECORDING)
        with pytest.raises(FormatError, match=r"unpacks to more than 0.000256 MB, the memory that is left"):
            reader.topics(path, None)


# ArduPilot.


def test_dataflash_keeps_sensors_and_raw_samples_apart(tmp_path):
    path = tmp_path / "a.BIN"
    written.write_ardupilot(path, *RECORDING)
    assert [topic.name for topic in ardupilot.topics(path, None)] == ["IMU[0]", "IMU[1]", "ACC[0]", "GYR[0]"]
    second, gyro, accel = ardupilot.read(path, ["IMU[1]", "GYR[0]", "ACC[0]"], None)
    np.testing.assert_allclose(second.gyro, GYRO + 1, atol=1e-6)
    np.testing.assert_array_equal(gyro.gyro, GYRO)
    np.testing.assert_array_equal(gyro.t_ns, T_NS)  # of the sample, not of the message
    np.testing.assert_array_equal(accel.accel, ACCEL)
    assert (gyro.accel, accel.gyro) == (None, None)


def test_a_sensor_that_a_dataflash_log_lacks_is_answered_with_those_that_are_there(tmp_path):
    written.write_ardupilot(tmp_path / "a.BIN", *RECORDING)
    for names in (["IMU[7]"], ["IMU[0]", "IMU[7]"]):
        with pytest.raises(FormatError, match=r"no stream 'IMU\[7\]'; it holds IMU\[0\]"):
            ardupilot.read(tmp_path / "a.BIN", names, None)


def test_dataflash_without_units_has_those_that_are_documented(tmp_path):
    path = tmp_path / "a.BIN"
    written.write_ardupilot(path, *RECORDING, units=False)
    stream = one(path, "IMU[0]")
    assert (stream.gyro_unit, stream.accel_unit, stream.temp_unit) == ("rad/s", "m/s2", "degc")
    assert "the unit of GyrX is taken as ArduPilot documents it" in stream.notes


def test_dataflash_says_what_it_passed_over(tmp_path):
    """Bytes of no message between two messages, and a mark among them that begins none."""
    path = tmp_path / "a.BIN"
    written.write_ardupilot(path, *RECORDING)
    data = path.read_bytes()
    middle = data.index(b"\xa3\x95\x81", len(data) // 2)
    path.write_bytes(data[:middle] + b"\x00\xa3\x95\x81\xff\xa3\x95" + data[middle:])
    stream = one(path, "IMU[0]")
    np.testing.assert_array_equal(stream.gyro, GYRO)
    assert f"the log is damaged at byte {middle}: 7 bytes that hold no message are passed over" in stream.notes


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
    np.testing.assert_array_equal(ours.t_ns // 1000, theirs[:, 0])
    np.testing.assert_array_equal(np.column_stack([ours.gyro, ours.accel, ours.temp]), theirs[:, 1:])


# Betaflight.

COUNTS = np.rint(GYRO / written.DEG / 0.1), np.rint(ACCEL / written.G * 2048)


@pytest.mark.parametrize("key", ["gyro_scale", "gyro.scale"])
def test_blackbox_counts_come_back_with_their_units(key, tmp_path):
    pytest.importorskip("orangebox")
    path = tmp_path / "a.bbl"
    written.write_blackbox(path, *RECORDING, key=key)
    assert reader_of(path, head_of(path)) is betaflight
    (topic,) = betaflight.topics(path, None)
    assert (topic.name, topic.rows, topic.holds) == ("log1", COUNT, ("gyro", "accel"))
    stream = one(path)
    np.testing.assert_array_equal(stream.t_ns, T_NS)
    np.testing.assert_array_equal(stream.gyro, COUNTS[0])
    np.testing.assert_array_equal(stream.accel, COUNTS[1])
    assert (stream.gyro_unit, stream.accel_unit) == ("0.1dps", "g/2048")
    assert (stream.gyro_fs_dps, stream.accel_fs_g) == (2000, 16)
    assert any("2000 dps is assumed" in note for note in stream.notes)
    np.testing.assert_allclose(stream.gyro * parse_unit("gyro", stream.gyro_unit).si, GYRO, atol=0.05 * written.DEG)
    np.testing.assert_allclose(stream.accel * parse_unit("accel", stream.accel_unit).si, ACCEL, atol=0.5 * written.G / 2048)


def test_blackbox_logs_of_one_file_are_streams_of_their_own(tmp_path):
    pytest.importorskip("orangebox")
    t_us = T_NS // 1000
    first = written.blackbox_bytes(t_us, *COUNTS)
    second = written.blackbox_bytes(t_us, -COUNTS[0], COUNTS[1], more=["blackbox_high_resolution:1"])
    (tmp_path / "a.bbl").write_bytes(first + second)
    one_of, other = betaflight.read(tmp_path / "a.bbl", [], None)
    assert (one_of.name, other.name) == ("log1", "log2")
    np.testing.assert_array_equal(one_of.gyro, -other.gyro)
    assert (one_of.gyro_unit, other.gyro_unit) == ("0.1dps", "0.01dps")


def test_blackbox_rates_before_the_filters_are_a_stream_of_their_own(tmp_path):
    pytest.importorskip("orangebox")
    (tmp_path / "a.bbl").write_bytes(written.blackbox_bytes(T_NS // 1000, *COUNTS, unfiltered=COUNTS[0] + 5))
    filtered, unfiltered = betaflight.read(tmp_path / "a.bbl", [], None)
    assert (filtered.name, unfiltered.name) == ("log1", "log1.unfiltered")
    np.testing.assert_array_equal(unfiltered.gyro, filtered.gyro + 5)
    np.testing.assert_array_equal(unfiltered.accel, filtered.accel)


def test_blackbox_counter_that_comes_round_goes_on(tmp_path):
    pytest.importorskip("orangebox")
    t_us = 2**32 - 50_000 + 1000 * np.arange(COUNT)
    (tmp_path / "a.bbl").write_bytes(written.blackbox_bytes(t_us % 2**32, *COUNTS, interval=1))
    np.testing.assert_array_equal(one(tmp_path / "a.bbl").t_ns, t_us * 1000)


def test_blackbox_intervals_without_end_are_refused(tmp_path):
    pytest.importorskip("orangebox")
    for bad in (b"P interval:0/1", b"P interval:1/0", b"P interval:abc"):
        (tmp_path / "a.bbl").write_bytes(written.blackbox_bytes(T_NS // 1000, *COUNTS).replace(b"P interval:1/1", bad))
        with pytest.raises(FormatError, match="log1 cannot be read"):
            betaflight.topics(tmp_path / "a.bbl", None)


def test_blackbox_header_without_its_interval_has_the_default(tmp_path):
    """orangebox 0.4.0 has it as a class property, which Python 3.13 has no more."""
    data = written.blackbox_bytes(T_NS // 1000, *COUNTS, interval=1)
    (tmp_path / "a.bbl").write_bytes(data.replace(b"H I interval:1\n", b""))
    np.testing.assert_array_equal(one(tmp_path / "a.bbl").t_ns, T_NS)


def test_blackbox_without_orangebox_says_what_to_install(tmp_path, monkeypatch):
    written.write_blackbox(tmp_path / "a.bbl", *RECORDING)
    monkeypatch.setitem(sys.modules, "orangebox", None)
    with pytest.raises(
        FormatError, match=re.escape("a blackbox log; reading it needs orangebox: python -m pip install 'tinygc[betaflight]'")
    ):
        betaflight.topics(tmp_path / "a.bbl", None)
