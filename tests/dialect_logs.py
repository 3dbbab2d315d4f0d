"""Logs of other programs, written from their documented headers, and the samples that they hold."""

import numpy as np
from conftest import DEG, Table

from session.io.dialects import Answers
from session.io.units import G
from session.replay.convert import convert
from tinygc import read_session

FULL_SCALES = {"gyro_fs_dps": 500.0, "accel_fs_g": 4.0}
SAMPLES = Table().tumble(2, rest_s=2.0).samples(odr_hz=104)
T_US = SAMPLES.t_ns // 1000
GYRO = {"dps": SAMPLES.gyro / DEG, "mdps": SAMPLES.gyro / DEG * 1e3, "rps": SAMPLES.gyro}
ACCEL = {"g": SAMPLES.accel / G, "mg": SAMPLES.accel / G * 1e3, "mps2": SAMPLES.accel}
TEMP = SAMPLES.temp_c
EPOCH_NS = 1_403_636_579_763_555_584


def rows(*columns, delimiter=",", end="\n"):
    """Text of rows; a column is a list of texts, or numbers written with 12 decimals."""
    texts = [c if isinstance(c[0], str) else [str(v) if isinstance(v, (int, np.integer)) else f"{v:.12f}" for v in c] for c in columns]
    return end.join(delimiter.join(row) for row in zip(*texts, strict=True)) + end


def triads(gyro, accel):
    return [*GYRO[gyro].T, *ACCEL[accel].T]


def clock(us, decimals=6):
    """hh:mm:ss.ss, a little before midnight at first."""
    seconds = (86_390 + us / 1e6) % 86_400
    return [f"{int(s // 3600):02d}:{int(s // 60 % 60):02d}:{s % 60:0{3 + decimals}.{decimals}f}" for s in seconds]


def inertial():
    gyro, accel = (
        ", ".join(f"{what} {axis} ({unit})" for axis in "XYZ") for what, unit in (("Gyroscope", "deg/s"), ("Accelerometer", "g"))
    )
    return f"Timestamp (us),{gyro},{accel}\n".replace(", ", ",") + rows(T_US, *triads("dps", "g"))


def px4():
    head = "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],gyro_integral_dt,accelerometer_timestamp_relative,"
    head += "accelerometer_m_s2[0],accelerometer_m_s2[1],accelerometer_m_s2[2],accelerometer_integral_dt"
    some = ["4000"] * len(T_US)
    return head + "\n" + rows(T_US + 10**9, *GYRO["rps"].T, some, some, *ACCEL["mps2"].T, some)


def betaflight(gyro="deg/s", accel="g"):
    head = "loopIteration, time (us), axisP[0], axisP[1], axisP[2], "
    head += ", ".join(f"gyroADC[{i}] ({gyro})" if gyro else f"gyroADC[{i}]" for i in range(3)) + ", "
    head += ", ".join(f"accSmooth[{i}] ({accel})" if accel else f"accSmooth[{i}]" for i in range(3)) + ", motor[0]"
    none = ["0"] * len(T_US)
    return (
        head
        + "\n"
        + rows(range(len(T_US)), T_US, none, none, none, *triads("dps", {"": "g", "g": "g", "m/s/s": "mps2"}[accel]), none, delimiter=", ")
    )


EUROC = (
    "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
)
ARTEMIS = "rtcDate,rtcTime,aX,aY,aZ,gX,gY,gZ,mX,mY,mZ,imu_degC,output_Hz,\n"
DATALOG = "Timestamp[ms] A_X [mg] A_Y [mg] A_Z [mg] G_X [mdps] G_Y [mdps] G_Z [mdps]\n"
NONE = ["0.00"] * len(T_US)
DIALECTS = {
    "ST DataLog": lambda: (
        "LSM6DSO ready\n" + DATALOG + rows([f"{t / 1000:.3f}" for t in T_US], *ACCEL["mg"].T, *GYRO["mdps"].T, delimiter=" ")
    ),
    "x-IMU3": inertial,
    "EuRoC": lambda: EUROC + rows(EPOCH_NS + SAMPLES.t_ns, *triads("rps", "mps2")),
    "OpenLog Artemis": lambda: (
        ARTEMIS
        + rows(["12/31/2023"] * len(T_US), clock(T_US), *ACCEL["mg"].T, *GYRO["dps"].T, NONE, NONE, NONE, TEMP, NONE, [""] * len(T_US))
    ),
    "PX4 sensor_combined": px4,
    "Betaflight blackbox": betaflight,
}


def make(tmp_path, *texts, name="LOG.CSV", out="session", **answers):
    paths = []
    for number, text in enumerate(texts):
        paths.append(tmp_path / (name if number == 0 else f"{number}{name}"))
        paths[-1].write_bytes(text if isinstance(text, bytes) else text.encode())
    return convert(paths, tmp_path / out, Answers(**{**FULL_SCALES, **answers}))


def same(made, gyro_atol=1e-8 * DEG, accel_atol=1e-8 * G, temp=False, exact_time=True):
    """The session that was made holds the samples of our own format."""
    session = read_session(made.folder)
    (log,) = session.logs
    assert not any(note for note in log.notes), log.notes
    assert len(log.samples) == len(SAMPLES)
    steps = log.samples.t_ns - log.samples.t_ns[0]
    if exact_time:
        np.testing.assert_array_equal(steps, SAMPLES.t_ns)
    np.testing.assert_allclose(log.samples.gyro, SAMPLES.gyro, rtol=1e-12, atol=gyro_atol)
    np.testing.assert_allclose(log.samples.accel, SAMPLES.accel, rtol=1e-12, atol=accel_atol)
    if temp:
        np.testing.assert_allclose(log.samples.temp_c, TEMP, atol=1e-8)
    return session
