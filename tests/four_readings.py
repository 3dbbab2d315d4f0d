"""A log of four readings, in every unit that docs/formats.md allows."""

import gzip

import numpy as np

from session.io.config import Sensor
from session.io.logfile import read_log

SENSOR = Sensor("ASM330LHH", "42", 208.0, 500.0, 4.0)
HEADER = "t_us,gx,gy,gz,ax,ay,az,temp"
G = 9.80665

#: six readings: rates in dps, specific force in g, as exact multiples of the registers' steps
GYRO_LSB = np.array([[100, -200, 300], [101, -201, 301], [-32768, 32767, 0], [4, 5, 6]])
ACCEL_LSB = np.array([[-10, 20, -8197], [-11, 21, -8198], [0, 0, -8197], [1, 2, 3]])
TEMP_LSB = np.array([0, 256, -128, 64])
T_NS = np.array([1_000_000_000, 1_004_808_000, 1_009_615_000, 1_014_423_000])

GYRO_DPS = GYRO_LSB * 0.0175
ACCEL_G = ACCEL_LSB * 0.122e-3
TIMES = {"t_us": T_NS // 1000, "t_ns": T_NS, "t_s": T_NS * 1e-9}
GYROS = {"": GYRO_LSB, "_dps": GYRO_DPS, "_rps": np.deg2rad(GYRO_DPS)}
ACCELS = {"": ACCEL_LSB, "_g": ACCEL_G, "_mps2": ACCEL_G * G}
TEMPS = {"temp": TEMP_LSB, "temp_c": 25 + TEMP_LSB / 256, None: None}


def text_of(time="t_us", gyro="", accel="", temp="temp", end="\n", extra=""):
    """A log of the four readings in the given units."""
    names = [time, *(f"g{axis}{gyro}" for axis in "xyz"), *(f"a{axis}{accel}" for axis in "xyz")] + ([temp] if temp else [])
    columns = [TIMES[time], *GYROS[gyro].T, *ACCELS[accel].T] + ([TEMPS[temp]] if temp else [])
    lines = [",".join(names) + extra]
    lines += [",".join(repr(value.item()) for value in row) + extra for row in zip(*columns, strict=True)]
    return end.join(lines) + end


def read(tmp_path, text, name="log0001.csv"):
    path = tmp_path / name
    data = text if isinstance(text, bytes) else text.encode()
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return read_log(path, SENSOR)


def assert_the_four_readings(log, temp=True):
    np.testing.assert_array_equal(log.samples.t_ns, T_NS)
    np.testing.assert_allclose(log.samples.gyro, np.deg2rad(GYRO_DPS), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(log.samples.accel, ACCEL_G * G, rtol=1e-12, atol=1e-15)
    if temp:
        np.testing.assert_allclose(log.samples.temp_c, [25, 26, 24.5, 25.25])
    else:
        assert log.samples.temp_c is None
