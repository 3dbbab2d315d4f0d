"""Binary logs as other programs write them: one function for each format, of t_ns (N,), rates (N, 3) rad/s, forces (N, 3) m/s^2, degC (N,).

A writer is another program than the reader wherever there is one: rosbags for bags, the mcap package, h5py, SciPy, NumPy and pyarrow; ULog,
and dataflash logs by hand, from the descriptions of their formats.
"""

import struct

import numpy as np

G = 9.80665
DEG = np.pi / 180

# ULog: https://docs.px4.io/main/en/dev_log/ulog_file_format.html

#: the letters of struct for ULog's types
ULOG_TYPES = {"uint64_t": "Q", "uint32_t": "I", "int32_t": "i", "float": "f", "uint8_t": "B", "int16_t": "h"}
FIFO = (
    "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float dt;float scale;"
    "int16_t[32] x;int16_t[32] y;int16_t[32] z;uint8_t samples;"
)
ULOG_FORMATS = {
    "sensor_combined": "uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;int32_t accelerometer_timestamp_relative;"
    "float[3] accelerometer_m_s2;uint32_t accelerometer_integral_dt;",
    "sensor_gyro": "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;float temperature;",
    "sensor_accel": "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;float temperature;",
    "vehicle_imu": "uint64_t timestamp;uint64_t timestamp_sample;float[3] delta_angle;float[3] delta_velocity;"
    "uint32_t delta_angle_dt;uint32_t delta_velocity_dt;",
    "sensor_gyro_fifo": FIFO,
    "sensor_accel_fifo": FIFO,
}


def ulog_message(kind, body):
    return struct.pack("<HB", len(body), ord(kind)) + body


def ulog_struct(name):
    text = "<"
    for field in ULOG_FORMATS[name].split(";")[:-1]:
        kind, _, count = field.split(" ")[0].partition("[")
        text += (count.rstrip("]") if count else "") + ULOG_TYPES[kind]
    return struct.Struct(text)


def ulog_bytes(rows, dropouts=()):
    """rows: (message's name, instance, values in order) one after the other; dropouts: (behind which row, ms)."""
    out = bytearray(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 1000))
    out += ulog_message("B", bytes(40))
    key = b"char[3] sys_name"
    out += ulog_message("I", bytes([len(key)]) + key + b"PX4")
    for name, fields in ULOG_FORMATS.items():
        out += ulog_message("F", f"{name}:{fields}".encode())
    logged = {pair: number for number, pair in enumerate(dict.fromkeys((name, instance) for name, instance, _ in rows))}
    for (name, instance), number in logged.items():
        out += ulog_message("A", struct.pack("<BH", instance, number) + name.encode())
    structs = {name: ulog_struct(name) for name in ULOG_FORMATS}
    lost = dict(dropouts)
    for place, (name, instance, values) in enumerate(rows):
        out += ulog_message("D", struct.pack("<H", logged[name, instance]) + structs[name].pack(*values))
        if place in lost:
            out += ulog_message("O", struct.pack("<H", lost[place]))
        if place % 100 == 0:
            out += ulog_message("S", bytes([0x2F, 0x73, 0x13, 0x20, 0x25, 0x0C, 0xBB, 0x12]))
    return bytes(out)


def write_ulog(path, t_ns, gyro_rps, accel_mps2, temp_c):
    """``sensor_combined``, and ``sensor_gyro`` and ``sensor_accel`` of two instances with their temperature."""
    rows = []
    for t, w, f, temp in zip(t_ns // 1000, gyro_rps, accel_mps2, temp_c, strict=True):
        rows.append(("sensor_combined", 0, (t, *w, 5000, 0, *f, 5000)))
        rows += [("sensor_gyro", i, (t + 7, t, 1, *(w + i), temp)) for i in (0, 1)]
        rows.append(("sensor_accel", 0, (t + 7, t, 1, *f, temp)))
    path.write_bytes(ulog_bytes(rows, [(4, 30), (40, 12)]))


# ROS 1 and ROS 2, by rosbags and by mcap.

TOPIC = "/imu/data_raw"


def ros_imu(store, ros1, t_ns, w, f, frame="imu_link", absent=()):
    """A sensor_msgs/Imu; absent: of gyro and accel, what its covariance says is not there."""
    types = store.types
    stamp = types["builtin_interfaces/msg/Time"](sec=int(t_ns // 10**9), nanosec=int(t_ns % 10**9))
    header = types["std_msgs/msg/Header"](**({"seq": 7} if ros1 else {}), stamp=stamp, frame_id=frame)
    vector = types["geometry_msgs/msg/Vector3"]
    covariance = {what: np.full(9, -1.0 if what in absent else 0.0) for what in ("gyro", "accel")}
    return types["sensor_msgs/msg/Imu"](
        header=header,
        orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
        orientation_covariance=np.full(9, -1.0),
        angular_velocity=vector(*map(float, w)),
        angular_velocity_covariance=covariance["gyro"],
        linear_acceleration=vector(*map(float, f)),
        linear_acceleration_covariance=covariance["accel"],
    )


def ros_messages(store, ros1, t_ns, gyro_rps, accel_mps2, split):
    """(topic, recorder's stamp, bytes): of one topic, or as a camera sends its two sensors; the recorder is 3 ms late."""
    serialise = store.serialize_ros1 if ros1 else store.serialize_cdr
    for t, w, f in zip(t_ns.tolist(), gyro_rps, accel_mps2, strict=True):
        parts = (
            [("/camera/gyro/sample", w, 0 * f, ("accel",)), ("/camera/accel/sample", 0 * w, f, ("gyro",))] if split else [(TOPIC, w, f, ())]
        )
        for topic, rate, force, absent in parts:
            yield topic, t + 3_000_000, bytes(serialise(ros_imu(store, ros1, t, rate, force, absent=absent), "sensor_msgs/msg/Imu"))


def write_ros1(path, t_ns, gyro_rps, accel_mps2, temp_c=None, compression=None, split=False):
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC)
    writer = Writer(path)
    if compression:
        writer.set_compression({"bz2": Writer.CompressionFormat.BZ2, "lz4": Writer.CompressionFormat.LZ4}[compression])
    with writer:
        writer.chunk_threshold = 1 << 14  # several chunks
        connections = {}
        for topic, stamp, data in ros_messages(store, True, t_ns, gyro_rps, accel_mps2, split):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, "sensor_msgs/msg/Imu", typestore=store)
            writer.write(connections[topic], stamp, data)


def write_ros2(path, t_ns, gyro_rps, accel_mps2, temp_c=None, storage="sqlite3", packed=False, split=False):
    """A folder; its file is ``path / f"{path.name}.db3"`` or ``.mcap``."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(path, version=9, storage_plugin={"sqlite3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}[storage])
    if packed:
        writer.set_compression(CompressionMode.MESSAGE, CompressionFormat.ZSTD)
    with writer:
        connections = {}
        for topic, stamp, data in ros_messages(store, False, t_ns, gyro_rps, accel_mps2, split):
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, "sensor_msgs/msg/Imu", typestore=store)
            writer.write(connections[topic], stamp, data)


def write_mcap(path, t_ns, gyro_rps, accel_mps2, temp_c=None, form="cdr", compression="ZSTD", chunk=1 << 14):
    """form: ``cdr`` or ``ros1``, with the definitions of ROS."""
    from mcap.writer import CompressionType, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if form == "ros1" else Stores.ROS2_HUMBLE)
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk, compression=CompressionType[compression])
        writer.start()
        text = store.generate_msgdef("sensor_msgs/msg/Imu", **({} if form == "ros1" else {"ros_version": 2}))[0]
        name = "sensor_msgs/Imu" if form == "ros1" else "sensor_msgs/msg/Imu"
        schema = writer.register_schema(name, f"{'ros1' if form == 'ros1' else 'ros2'}msg", text.encode())
        channel = writer.register_channel(TOPIC, form, schema)
        messages = ros_messages(store, form == "ros1", t_ns, gyro_rps, accel_mps2, False)
        for number, (_, stamp, data) in enumerate(messages):
            writer.add_message(channel, stamp, data, stamp, number)
        writer.finish()


# ArduPilot: messages that describe themselves.

BIN_STRUCT = {"B": "B", "b": "b", "Q": "Q", "f": "f", "d": "d", "n": "4s", "N": "16s", "Z": "64s", "I": "I", "h": "h", "H": "H"}
BIN_TYPES = {
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns"),
    "UNIT": (177, "QbZ", "TimeUS,Id,Label"),
    "MULT": (178, "Qbd", "TimeUS,Id,Mult"),
    "FMTU": (179, "QBNN", "TimeUS,FmtType,UnitIds,MultIds"),
    "PARM": (64, "QNff", "TimeUS,Name,Value,Default"),
    "IMU": (129, "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
    "GYR": (130, "QBQfff", "TimeUS,I,SampleUS,GyrX,GyrY,GyrZ"),
    "ACC": (131, "QBQfff", "TimeUS,I,SampleUS,AccX,AccY,AccZ"),
}


def bin_message(name, *values):
    number, letters, _ = BIN_TYPES[name]
    values = [value.encode() if isinstance(value, str) else value for value in values]
    return b"\xa3\x95" + bytes([number]) + struct.pack("<" + "".join(BIN_STRUCT[letter] for letter in letters), *values)


def write_ardupilot(path, t_ns, gyro_rps, accel_mps2, temp_c, units=True):
    """``IMU`` of two sensors, and ``GYR`` and ``ACC`` of the first."""
    out = bytearray()
    for name, (number, letters, columns) in BIN_TYPES.items():
        length = 3 + struct.calcsize("<" + "".join(BIN_STRUCT[letter] for letter in letters))
        out += bin_message("FMT", number, length, name, letters, columns)
    if units:
        for letter, label in (("s", "s"), ("#", "instance"), ("E", "rad/s"), ("o", "m/s/s"), ("O", "degC"), ("z", "Hz"), ("-", "")):
            out += bin_message("UNIT", 0, ord(letter), label)
        for letter, factor in (("-", 0.0), ("F", 1e-6)):
            out += bin_message("MULT", 0, ord(letter), factor)
        for name, ids, factors in (
            ("IMU", "s#EEEooo--O--zz", "F--------------"),
            ("GYR", "s#sEEE", "F-F---"),
            ("ACC", "s#sooo", "F-F---"),
        ):
            out += bin_message("FMTU", 0, BIN_TYPES[name][0], ids, factors)
    out += bin_message("PARM", 0, "INS_GYRO_FILTER", 20.0, 20.0)
    for t, w, f, temp in zip(t_ns // 1000, gyro_rps, accel_mps2, temp_c, strict=True):
        out += bin_message("IMU", t, 0, *w, *f, 0, 0, temp, 1, 1, 1000, 1000)
        out += bin_message("IMU", t + 1, 1, *(w + 1), *(f + 1), 0, 0, temp + 1, 1, 1, 1000, 1000)
        out += bin_message("GYR", t + 900, 0, t, *w)
        out += bin_message("ACC", t + 900, 0, t, *f)
    path.write_bytes(out)


# Arrays.


def write_hdf5(path, t_ns, gyro_rps, accel_mps2, temp_c, chunks=None):
    import h5py

    packing = {} if chunks is None else {"chunks": (chunks, 3), "compression": "gzip"}
    with h5py.File(path, "w") as file:
        group = file.create_group("imu")
        group["t_ns"] = t_ns
        for name, values, unit in (("gyr", gyro_rps, "rad/s"), ("acc", accel_mps2, "m/s^2")):
            group.create_dataset(name, data=values, **packing).attrs["units"] = unit
        group["temperature"] = temp_c
        group["temperature"].attrs["units"] = "degC"
        file["quaternion"] = np.zeros((len(t_ns), 4))


def write_mat(path, t_ns, gyro_rps, accel_mps2, temp_c, compress=True):
    from scipy.io import savemat

    arrays = {"t_ns": t_ns.astype(float), "gyro_rps": gyro_rps, "accel_mps2": accel_mps2, "temp_c": temp_c}
    savemat(path, {"imu": arrays}, do_compression=compress)


def write_mat73(path, t_ns, gyro_rps, accel_mps2, temp_c):
    """As MATLAB does: HDF5 behind 512 bytes, arrays turned about."""
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in (
            ("t_ns", t_ns[None].astype(float)),
            ("gyro_rps", gyro_rps.T),
            ("accel_mps2", accel_mps2.T),
            ("temp_c", temp_c[None]),
        ):
            file[name] = values
            file[name].attrs["MATLAB_class"] = np.bytes_("double")
    with path.open("r+b") as file:
        file.write(
            b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Thu Nov 26 10:15:02 2026 HDF5 schema 1.00 .".ljust(124) + b"\0\2IM"
        )


def write_npz(path, t_ns, gyro_rps, accel_mps2, temp_c):
    np.savez(path, t_ns=t_ns, gyro_rps=gyro_rps, accel_mps2=accel_mps2, temp_c=temp_c)


def write_npy(path, t_ns, gyro_rps, accel_mps2, temp_c):
    """One array with named columns."""
    rows = np.zeros(len(t_ns), [("t_ns", "i8"), ("gyro_rps", "f8", 3), ("accel_mps2", "f8", 3), ("temp_c", "f8")])
    rows["t_ns"], rows["gyro_rps"], rows["accel_mps2"], rows["temp_c"] = t_ns, gyro_rps, accel_mps2, temp_c
    np.save(path, rows)


def write_parquet(path, t_ns, gyro_rps, accel_mps2, temp_c):
    """Its units in the columns' names, but for the temperature's, which its metadata has."""
    import pyarrow
    from pyarrow import parquet

    columns = {"timestamp": pyarrow.array(t_ns, pyarrow.timestamp("ns"))}
    columns |= {f"gyro_{axis}_rps": gyro_rps[:, i] for i, axis in enumerate("xyz")}
    columns |= {"acc_mps2": pyarrow.FixedSizeListArray.from_arrays(accel_mps2.ravel(), 3), "temp": temp_c}
    table = pyarrow.table(columns)
    unit = table.schema.field("temp").with_metadata({"units": "degc"})
    parquet.write_table(table.cast(table.schema.set(len(columns) - 1, unit)), path)
