"""One recording as the text logs of many programs, written by hand from what each documents.

Every writer takes samples and gives the files: names and bytes.  ``TEXTS`` lists them with the options that answer what the log does not
say, none where it says all.
"""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from session.base.units import DEG, G
from session.log.samples import Samples

Files = list[tuple[str, bytes]]
EPOCH_NS = 1_732_600_000 * 10**9
#: counts of an MPU-6050 at ±500 dps and ±4 g
LSB_DPS, LSB_G = 65.5, 8192


@dataclass(frozen=True)
class Text:
    """write: samples -> files; options: answers; exact_s: how far stamps may be off; gyro_lsb, accel_lsb: steps of what is written, SI."""

    write: Callable[[Samples], Files]
    options: tuple[str, ...] = ()
    exact_s: float = 1e-6
    gyro_lsb: float = 1e-9
    accel_lsb: float = 1e-8


def lines(*columns, delimiter=",", digits=10):
    texts = [[v if isinstance(v, str) else str(v) if isinstance(v, int | np.integer) else f"{v:.{digits}f}" for v in c] for c in columns]
    return "".join(delimiter.join(row) + "\n" for row in zip(*texts, strict=True))


def file(name, *parts):
    return [(name, "".join(parts).encode())]


def dps(s):
    return list((np.asarray(s.gyro) / DEG).T)


def rps(s):
    return list(np.asarray(s.gyro).T)


def g(s):
    return list((np.asarray(s.accel) / G).T)


def mps2(s):
    return list(np.asarray(s.accel).T)


def us(s):
    return s.t_ns // 1000


def registers(s):
    """(N, 6) int: gx … az as an MPU-6050 has them."""
    return np.rint(np.column_stack([np.asarray(s.gyro) / DEG * LSB_DPS, np.asarray(s.accel) / G * LSB_G])).astype(int)


def own(s):
    return file("log.csv", "t_us,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n", lines(us(s), *dps(s), *g(s)))


def st_datalog(s):
    head = "LSM6DSO ready\nTimestamp[ms] A_X [mg] A_Y [mg] A_Z [mg] G_X [mdps] G_Y [mdps] G_Z [mdps]\n"
    return file("DATALOG.TXT", head, lines(us(s) / 1e3, *(1e3 * a for a in g(s)), *(1e3 * w for w in dps(s)), delimiter=" "))


def st_hsdatalog(s):
    """Two files; the accelerometer at another rate than the gyroscope, with a clock of its own."""
    return [
        *file("gyro.csv", "Time,G_x [mdps],G_y [mdps],G_z [mdps]\n", lines(s.t_ns * 1e-9, *(1e3 * w for w in dps(s)))),
        *file("accel.csv", "Time,A_x [g],A_y [g],A_z [g]\n", lines(s.t_ns * 1e-9, *g(s))),
    ]


def x_imu3(s):
    head = ",".join(f"{what} {axis} ({unit})" for what, unit in (("Gyroscope", "deg/s"), ("Accelerometer", "g")) for axis in "XYZ")
    return file("Inertial.csv", f"Timestamp (us),{head}\n", lines(us(s), *dps(s), *g(s)))


def euroc(s):
    head = "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
    return file("data.csv", head, "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n", lines(EPOCH_NS + s.t_ns, *rps(s), *mps2(s)))


def clock(t_us, start_s=86_390):
    seconds = (start_s * 10**6 + t_us) % (86_400 * 10**6)
    return [f"{v // 3_600_000_000:02d}:{v // 60_000_000 % 60:02d}:{v // 1_000_000 % 60:02d}.{v % 1_000_000:06d}" for v in seconds.tolist()]


def artemis(s):
    none = ["0.00"] * len(s)
    head = "rtcDate,rtcTime,aX,aY,aZ,gX,gY,gZ,mX,mY,mZ,imu_degC,output_Hz,\n"
    body = lines(["12/31/2023"] * len(s), clock(us(s)), *(1e3 * a for a in g(s)), *dps(s), none, none, none, ["25.0"] * len(s), none, none)
    return file("dataLog00001.TXT", head, body)


def px4(s):
    head = "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],gyro_integral_dt,accelerometer_timestamp_relative,"
    head += "accelerometer_m_s2[0],accelerometer_m_s2[1],accelerometer_m_s2[2],accelerometer_integral_dt\n"
    some = ["4000"] * len(s)
    return file("log_sensor_combined_0.csv", head, lines(us(s) + 10**9, *rps(s), some, some, *mps2(s), some))


BLACKBOX = "loopIteration,time,axisP[0],gyroADC[0],gyroADC[1],gyroADC[2],accSmooth[0],accSmooth[1],accSmooth[2],motor[0]\n"


def blackbox_rows(s, per_dps):
    counts = [np.rint(np.asarray(w) * per_dps).astype(int) for w in dps(s)]
    accel = [np.rint(a * 2048).astype(int) for a in g(s)]
    none = ["0"] * len(s)
    return lines(range(len(s)), us(s), none, *counts, *accel, none)


def betaflight_explorer(s):
    """As the Blackbox Explorer exports: the recorder's header lines as ``"name",value``, then the table; counts of 1/16.4 dps."""
    bits = np.float32(1 / 16.4).tobytes()[::-1].hex()
    head = f'"Product","Blackbox flight data recorder by Nicholas Sherlock"\n"gyro_scale","0x{bits}"\n"acc_1G",2048\n"looptime",312\n'
    return file("btfl_001.csv", head, BLACKBOX, blackbox_rows(s, 16.4))


def betaflight_fine(s):
    """With ``blackbox_high_resolution``: tenths of the scale, which is 1 dps here."""
    head = '"Product","Blackbox flight data recorder"\n"gyro_scale","0x3f800000"\n"acc_1G","2048"\n"blackbox_high_resolution","1"\n'
    return file("btfl_002.csv", head, BLACKBOX, blackbox_rows(s, 10.0))


def betaflight_2016(s):
    """With a point in the scale's key."""
    ((_, data),) = betaflight_explorer(s)
    return [("LOG00002.csv", data.replace(b"gyro_scale", b"gyro.scale"))]


def betaflight_bare(s):
    return file("LOG00001.01.csv", BLACKBOX, blackbox_rows(s, 16.4))


def ardupilot(s):
    """A whole day's kinds of rows, parameters first."""
    head = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 129, 23, PARM, QNf, TimeUS,Name,Value\n"
    head += "FMT, 131, 48, IMU, QBffffffIIfBB, TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH\n"
    head += "FMT, 132, 27, ATT, QccccCCCC, TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw\n"
    head += "".join(f"PARM, {i}, P{i}, {i}\n" for i in range(600))
    zero, one = ["0"] * len(s), ["1"] * len(s)
    imu = lines(["IMU"] * len(s), us(s), zero, *rps(s), *mps2(s), zero, zero, ["31.5"] * len(s), one, one, delimiter=", ").splitlines()
    return file(
        "00000042.log", head, "".join(f"{row}\nATT, {t}, 0, 0.5, 0, 1.5, 0, 2.5, 0.1, 0.2\n" for t, row in zip(us(s), imu, strict=True))
    )


def rostopic(s):
    names = [f"field.{what}.{axis}" for what in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
    head = "%time,field.header.seq,field.header.stamp,field.header.frame_id," + ",".join(names) + "\n"
    body = lines(EPOCH_NS + s.t_ns + 2_000_000, range(len(s)), EPOCH_NS + s.t_ns, ["imu"] * len(s), *rps(s), *mps2(s))
    return file("imu.txt", head, body)


def ros_pair(s, whole, part):
    stamps = EPOCH_NS + s.t_ns
    return f"{whole},{part},", [stamps // 10**9, stamps % 10**9]


def bagpy(s):
    head, stamps = ros_pair(s, "header.stamp.secs", "header.stamp.nsecs")
    names = [f"{what}.{axis}" for what in ("angular_velocity", "linear_acceleration") for axis in "xyz"]
    received = [f"{t * 1e-9:.6f}" for t in (EPOCH_NS + s.t_ns + 3_000_000)]
    return file(
        "imu-data.csv", "Time,header.seq," + head + ",".join(names) + "\n", lines(received, range(len(s)), *stamps, *rps(s), *mps2(s))
    )


def ros2_echo(s):
    """``ros2 topic echo --csv``: no header, and in the order of the message."""
    stamps = EPOCH_NS + s.t_ns
    zeros = [["0.0"] * len(s)] * 9
    quaternion = [["0.0"] * len(s)] * 3 + [["1.0"] * len(s)]
    return file(
        "echo.csv", lines(stamps // 10**9, stamps % 10**9, ["imu_link"] * len(s), *quaternion, *zeros, *rps(s), *zeros, *mps2(s), *zeros)
    )


ROS2 = "t_s=1+2*1e-9,gx_rps=17,gy_rps=18,gz_rps=19,ax_mps2=29,ay_mps2=30,az_mps2=31"


def xsens(s):
    head = "// Start Time: Unknown\n// Sample rate: 100.0Hz\n// Firmware Version: 1.7.2\n"
    names = "PacketCounter\tSampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z\tGyr_X\tGyr_Y\tGyr_Z\n"
    return file("MT_0780-000.txt", head, names, lines(range(len(s)), us(s), *mps2(s), *rps(s), delimiter="\t"))


def phyphox(s):
    """Two sensors, each with its own stamps, from the same zero: the accelerometer's fall between the gyroscope's."""
    fine = np.arange(0, int(s.t_ns[-1]) + 1, 4_000_000)
    force = [np.interp(fine, s.t_ns, each) for each in mps2(s)]
    gyro = '"Time (s)","Gyroscope x (rad/s)","Gyroscope y (rad/s)","Gyroscope z (rad/s)"\n'
    accel = '"Time (s)","Acceleration x (m/s^2)","Acceleration y (m/s^2)","Acceleration z (m/s^2)"\n'
    return [*file("Gyroscope.csv", gyro, lines(s.t_ns * 1e-9, *rps(s))), *file("Accelerometer.csv", accel, lines(fine * 1e-9, *force))]


def phyphox_simple(s):
    """An experiment of one's own: the sensor is the file's, the columns are axes."""
    gyro, accel = ('"Time (s)","X (unit)","Y (unit)","Z (unit)"\n'.replace("unit", unit) for unit in ("rad/s", "m/s^2"))
    return [
        *file("Gyroscope.csv", gyro, lines(s.t_ns * 1e-9, *rps(s))),
        *file("Accelerometer.csv", accel, lines(s.t_ns * 1e-9, *mps2(s))),
    ]


def kalibr(s):
    head = "timestamp,omega_x,omega_y,omega_z,alpha_x,alpha_y,alpha_z\n"
    return file("imu0.csv", head, lines(EPOCH_NS + s.t_ns, *rps(s), *mps2(s)))


def gopro(s):
    """A name for three columns, which says their order and signs."""
    parts = (("gyro.csv", "Gyroscope (z,-x,y) [rad/s]", rps(s)), ("accl.csv", "Accelerometer (z,-x,y) [m/s2]", mps2(s)))
    stamps = s.t_ns * 1e-6, ["2026-05-02T09:30:00.000Z"] * len(s)
    return [
        *(f for name, head, (x, y, z) in parts for f in file(name, f'"cts","date","{head}","1","2"\n', lines(*stamps, z, -x, y))),
    ]


def spreadsheet(headings, encoding="utf-8"):
    """ms, g and °/s with decimal commas under headings, ``{}`` for the axis, as a spreadsheet saves them."""

    def write(s):
        time, accel, gyro = headings.split(";")
        head = ";".join([time, *(each.format(axis) for each in (accel, gyro) for axis in "XYZ")]) + "\r\n"
        body = lines(s.t_ns * 1e-6, *g(s), *dps(s), delimiter=";").replace(".", ",").replace("\n", "\r\n")
        return [("Mappe1.csv", (head + body).encode(encoding))]

    return write


def zipped(files, name):
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", zipfile.ZIP_DEFLATED) as archive:
        for each, data in files:
            archive.writestr(zipfile.ZipInfo(each), data)
        archive.writestr(zipfile.ZipInfo("meta/device.csv"), '"property","value"\n"deviceModel","X"\n')
    return [(name, buffer.getvalue())]


def phyphox_zip(s):
    return zipped(phyphox(s), "phyphox 2024-11-26.zip")


def sensor_logger(s):
    """With the acceleration without gravity beside it, which is no reference."""
    head = "time,seconds_elapsed,z,y,x\n"
    stamps = EPOCH_NS + s.t_ns
    small = [a * 0.01 for a in mps2(s)]
    return zipped(
        [
            *file("Gyroscope.csv", head, lines(stamps, s.t_ns * 1e-9, *rps(s)[::-1])),
            *file("Accelerometer.csv", head, lines(stamps, s.t_ns * 1e-9, *small[::-1])),
            *file("TotalAcceleration.csv", head, lines(stamps, s.t_ns * 1e-9, *mps2(s)[::-1])),
        ],
        "2024-11-26_10-00-00.zip",
    )


def physics_toolbox(s):
    return file("toolbox.csv", "time;wx;wy;wz;gFx;gFy;gFz\n", lines(s.t_ns * 1e-9, *rps(s), *g(s), delimiter=";").replace(".", ","))


def androsensor(s):
    head = ";".join([f"ACCELEROMETER {axis} (m/s²)" for axis in "XYZ"] + [f"GYROSCOPE {axis} (rad/s)" for axis in "XYZ"])
    return file("Sensor_record.csv", head + ";Time since start in ms \n", lines(*mps2(s), *rps(s), s.t_ns * 1e-6, delimiter=";"))


def sensorlog(s):
    head = "loggingTime(txt),loggingSample(N),accelerometerTimestamp_sinceReboot(s),"
    head += ",".join(f"accelerometerAcceleration{axis}(G)" for axis in "XYZ") + ",gyroTimestamp_sinceReboot(s),"
    head += ",".join(f"gyroRotation{axis}(rad/s)" for axis in "XYZ") + "\n"
    seconds = s.t_ns * 1e-9 + 5000
    stamps = [f"2024-11-26T10:00:{t:06.3f}+01:00" for t in (s.t_ns * 1e-9) % 60]
    return file("stream.csv", head, lines(stamps, range(len(s)), seconds, *g(s), seconds, *rps(s)))


def gyroflow(s):
    raw = registers(s)
    head = (
        f"GYROFLOW IMU LOG\nversion,1.3\nid,board\norientation,YxZ\ntscale,0.000001\ngscale,{DEG / LSB_DPS:.12g}\nascale,{1 / LSB_G:.12g}\n"
    )
    return file("log.gcsv", head, "t,gx,gy,gz,ax,ay,az\n", lines(us(s), *raw.T))


def key_value(s):
    raw = registers(s)
    rows = [f"t:{t} ax:{r[3]} ay:{r[4]} az:{r[5]} gx:{r[0]} gy:{r[1]} gz:{r[2]}\n" for t, r in zip(us(s), raw, strict=True)]
    return file("putty.log", "MPU6050 ok\n", *rows)


def adafruit(s):
    """The maker's example sketch: three lines a reading, with words and units, behind a serial monitor's clock."""
    stamps = clock(us(s), start_s=36_000)
    rows = []
    for t, w, f in zip(stamps, np.asarray(s.gyro), np.asarray(s.accel), strict=True):
        rows.append(f"{t} -> Acceleration X: {f[0]:.6f}, Y: {f[1]:.6f}, Z: {f[2]:.6f} m/s^2\n")
        rows.append(f"{t} -> Rotation X: {w[0]:.8f}, Y: {w[1]:.8f}, Z: {w[2]:.8f} rad/s\n{t} -> \n")
    return file("monitor.txt", f"{stamps[0]} -> MPU6050 Found!\n", *rows)


def json_lines(s):
    rows = [
        json.dumps({"t_us": int(t), "gyro_dps": [round(v, 9) for v in w], "accel_g": [round(v, 9) for v in f], "id": "imu"}) + "\n"
        for t, w, f in zip(us(s), np.column_stack(dps(s)).tolist(), np.column_stack(g(s)).tolist(), strict=True)
    ]
    return file("mqtt.jsonl", *rows)


def json_documents(s):
    """A document for each sensor, over many lines."""
    files: Files = []
    for name, values in (("rotations", s.gyro), ("accelerations", s.accel)):
        rows = zip(np.asarray(values).tolist(), us(s).tolist(), strict=True)
        document = {name: [{"x": x, "y": y, "z": z, "time_usec": t} for (x, y, z), t in rows]}
        files += file(f"{name}.json", json.dumps(document, indent=1))
    return files


def json_document(s):
    """One list of both sensors' records on one line, each with its sensor's name, and numbers in quotation marks."""
    rows = [
        {"sensor": name, "time": str(EPOCH_NS + int(t)), "z": repr(z), "y": repr(y), "x": repr(x)}
        for t, *both in zip(s.t_ns, np.asarray(s.gyro).tolist(), np.asarray(s.accel).tolist(), strict=True)
        for name, (x, y, z) in zip(("Gyroscope", "Accelerometer"), both, strict=True)
    ]
    return file("2024-11-26.json", json.dumps(rows))


def json_arrays(s):
    """Lists of one length under their names."""
    names = ("t_us", "gyro_x", "gyro_y", "gyro_z", "acc_x", "acc_y", "acc_z")
    columns = [us(s).tolist(), *(np.asarray(each).tolist() for each in (*dps(s), *g(s)))]
    return file("imu.json", json.dumps({"device": "imu", "data": dict(zip(names, columns, strict=True))}))


def vectornav(word, before, behind=0):
    """Sentences with a checksum, without stamps; before, behind: numbers before the magnetometer's, and behind the rates."""

    def write(s):
        rows = []
        for w, f in zip(np.asarray(s.gyro).tolist(), np.asarray(s.accel).tolist(), strict=True):
            values = [1.0] * before + [0.2, -0.1, 0.4] + f + w + [25.0] * behind
            body = ",".join([word, *(f"{value:+.9f}" for value in values)])
            rows.append(f"${body}*{np.bitwise_xor.reduce(np.frombuffer(body.encode(), np.uint8)):02X}\r\n")
        return file("vn.txt", "+0.1,+0.2*33\r\n", *rows)

    return write


def hexadecimal(s):
    raw = registers(s) & 0xFFFF
    return file("hex.csv", "millis,gx,gy,gz,ax,ay,az\n", lines(us(s) / 1e3, *[[f"0x{v:04X}" for v in c] for c in raw.T.tolist()], digits=3))


def packed(s):
    """The burst of an MPU-6050 from register 0x3B, big-endian: ax ay az temperature gx gy gz."""
    raw = registers(s)
    order = np.column_stack([raw[:, 3:], np.zeros(len(s), dtype=int), raw[:, :3]]) & 0xFFFF
    return file(
        "burst.txt", "".join(f"{t},{''.join(f'{v:04X}' for v in row)}\n" for t, row in zip(us(s).tolist(), order.tolist(), strict=True))
    )


def two_headers(s):
    head = "Time;Gyroscope;;;Accelerometer;;\n[s];x;y;z;x;y;z\n"
    return file("TStick.csv", head, lines(s.t_ns * 1e-9, *rps(s), *mps2(s), delimiter=";"))


def units_below(s):
    head = "time;gyroX;gyroY;gyroZ;accX;accY;accZ\nms;deg/s;deg/s;deg/s;g;g;g\n"
    return file("export.csv", head, lines(s.t_ns * 1e-6, *dps(s), *g(s), delimiter=";").replace(".", ","))


def usual_names(s):
    return file(
        "sketch.csv", "time_ms,accX,accY,accZ,gyroX,gyroY,gyroZ,temperature\n", lines(us(s) / 1e3, *g(s), *dps(s), ["25.1"] * len(s))
    )


def slower_accelerometer(s):
    """One table; the accelerometer comes at a third of the rate, its cells are empty between."""
    held = np.arange(len(s)) % 3 == 0
    held[-1] = True
    cells = [[f"{v:.10f}" if h else "" for v, h in zip(column, held, strict=True)] for column in mps2(s)]
    return file("imu.csv", "t_us,gx_dps,gy_dps,gz_dps,ax_mps2,ay_mps2,az_mps2\n", lines(us(s), *dps(s), *cells))


def a_row_a_sensor(s):
    """Each row holds the reading of one sensor, and nan for the other; the temperature comes once in a hundred."""
    none = [["nan"] * len(s)] * 3
    temp = [["25.0" if i % 100 == 0 else "" for i in range(len(s))], [""] * len(s)]
    parts = ((0, [*none, *g(s)], temp[0]), (1500, [*dps(s), *none], temp[1]))
    both = [lines(us(s) + after_us, *part, temps).splitlines(keepends=True) for after_us, part, temps in parts]
    rows = "".join(row for pair in zip(*both, strict=True) for row in pair)
    return file("merged.csv", "time_us,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z,temp_c\n", rows)


def bursts(s):
    """A FIFO that is read every seven samples: its samples 0.1 ms apart, and then nothing."""
    t_ns = s.t_ns[np.minimum(np.arange(len(s)) // 7 * 7 + 6, len(s) - 1)] - (6 - np.arange(len(s)) % 7) * 100_000
    return file(
        "fifo.csv",
        "time;wx (rad/s);wy (rad/s);wz (rad/s);ax (m/s2);ay (m/s2);az (m/s2)\n",
        lines(t_ns * 1e-9, *rps(s), *mps2(s), delimiter=";"),
    )


def whole_seconds(s):
    return file("rtc.csv", "unixtime_s,gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g\n", lines((EPOCH_NS + s.t_ns) // 10**9, *dps(s), *g(s)))


def sum_of_columns(s):
    return file(
        "clock.csv",
        "minute,second,ms,p,q,r,fx,fy,fz\n",
        lines(us(s) // 60_000_000, us(s) // 10**6 % 60, us(s) % 10**6 / 1e3, *dps(s), *g(s)),
    )


SUM = "t_ms=minute*60000+second*1000+ms,gx_dps=p,gy_dps=q,gz_dps=r,ax_g=fx,ay_g=fy,az_g=fz"
MPU = ("--sensor", "MPU-6050", "--gyro-fs", "500", "--accel-fs", "4")
STEPS = {"gyro_lsb": DEG / LSB_DPS, "accel_lsb": G / LSB_G}
BLACKBOX_STEPS = {"gyro_lsb": DEG / 16.4, "accel_lsb": G / 2048}
TEXTS = {
    "TinyGC's own": Text(own),
    "ST DataLog": Text(st_datalog),
    "ST HSDatalog, two files": Text(st_hsdatalog),
    "x-IMU3": Text(x_imu3),
    "EuRoC": Text(euroc),
    "OpenLog Artemis": Text(artemis),
    "PX4 ulog2csv": Text(px4),
    "Betaflight, Blackbox Explorer": Text(betaflight_explorer, **BLACKBOX_STEPS),
    "Betaflight of 2016": Text(betaflight_2016, **BLACKBOX_STEPS),
    "Betaflight, high resolution": Text(betaflight_fine, gyro_lsb=DEG / 10, accel_lsb=G / 2048),
    "Betaflight, blackbox_decode": Text(betaflight_bare, ("--gyro-unit", "dps/16.4", "--accel-unit", "g/2048"), **BLACKBOX_STEPS),
    "ArduPilot text": Text(ardupilot),
    "rostopic echo -p": Text(rostopic),
    "ROS table, secs and nsecs": Text(bagpy),
    "ros2 topic echo --csv": Text(ros2_echo, ("--columns", ROS2)),
    "Xsens MT Manager": Text(xsens, ("--time-unit", "us", "--gyro-unit", "rad/s")),
    "phyphox, two files": Text(phyphox, accel_lsb=0.05),
    "phyphox, zip": Text(phyphox_zip, accel_lsb=0.05),
    "phyphox, simple export": Text(phyphox_simple),
    "Kalibr": Text(kalibr),
    "GoPro, two files": Text(gopro),
    "spreadsheet, English, Windows": Text(spreadsheet("Time (ms);Acc {} (g);Gyr {} (°/s)", "cp1252")),
    "spreadsheet, German, Windows": Text(spreadsheet("Zeit [ms];Beschl. {} [g];Drehrate {} [°/s]", "cp1252")),
    "spreadsheet, German, DIN": Text(spreadsheet("t in ms;Beschleunigung {} in g;Winkelgeschwindigkeit {} in Grad/s")),
    "spreadsheet, French, UTF-16": Text(spreadsheet("Temps (ms);Accélération {} (g);Vitesse angulaire {} (°/s)", "utf-16")),
    "spreadsheet, Spanish": Text(spreadsheet("Tiempo (ms);Aceleración {} (g);Velocidad angular {} (º/s)")),
    "spreadsheet, Italian": Text(spreadsheet("Tempo (ms);Accelerazione {} (g);Velocità angolare {} (°/s)")),
    "spreadsheet, Chinese": Text(spreadsheet("时间(ms);加速度{}(g);角速度{}(°/s)")),
    "spreadsheet, Polish, by its units": Text(spreadsheet("Czas [ms];Przyspieszenie {} [g];Prędkość kątowa {} [°/s]")),
    "Sensor Logger, zip": Text(sensor_logger),
    "Physics Toolbox": Text(physics_toolbox),
    "AndroSensor": Text(androsensor),
    "SensorLog": Text(sensorlog),
    "Gyroflow": Text(gyroflow, **STEPS),
    "names and numbers": Text(key_value, MPU, **STEPS),
    "Adafruit's sketch in a serial monitor": Text(adafruit, gyro_lsb=1e-8, accel_lsb=1e-6),
    "JSON lines": Text(json_lines),
    "JSON documents, a sensor each": Text(json_documents, ("--gyro-unit", "rad/s", "--accel-unit", "m/s2")),
    "JSON document, records of both": Text(json_document, ("--gyro-unit", "rad/s", "--accel-unit", "m/s2")),
    "JSON document, arrays": Text(json_arrays, ("--gyro-unit", "dps", "--accel-unit", "g")),
    "VectorNav, $VNYMR": Text(vectornav("VNYMR", 3), ("--odr", "104"), exact_s=1e-5),
    "VectorNav, $VNIMU": Text(vectornav("VNIMU", 0, 2), ("--odr", "104"), exact_s=1e-5),
    "hexadecimal registers": Text(hexadecimal, MPU, **STEPS),
    "packed hexadecimal": Text(packed, ("--packed", "mpu", "--time-unit", "us", *MPU), **STEPS),
    "two lines of names": Text(two_headers, ("--gyro-unit", "rad/s", "--accel-unit", "m/s2")),
    "units below the names": Text(units_below),
    "usual names": Text(usual_names, ("--gyro-unit", "dps", "--accel-unit", "g")),
    "empty cells of a slower sensor": Text(slower_accelerometer, accel_lsb=0.05),
    "a row a sensor": Text(a_row_a_sensor, ("--gyro-unit", "dps", "--accel-unit", "g"), exact_s=2e-6, accel_lsb=0.2),
    "bursts of a FIFO": Text(bursts, exact_s=2e-3),
    "whole-second stamps": Text(whole_seconds, exact_s=1.0),
    "a sum of columns": Text(sum_of_columns, ("--columns", SUM)),
}
