"""Logs from text: of this project's own, in every unit that docs/formats.md allows, and of other programs; and what they must hold."""

import gzip
from functools import cache

import numpy as np
from conftest import DEG, Table
from written_texts import TEXTS
from written_texts import lines as rows

from session.base.units import G
from session.log.config import Sensor
from session.log.logfile import read_log
from session.replay.convert import convert
from session.replay.options import Answers
from tinygc import read_session

# Four readings: rates and forces as exact multiples of the registers' steps

SENSOR = Sensor("ASM330LHH", "42", 208.0, 500.0, 4.0)
HEADER = "t_us,gx,gy,gz,ax,ay,az,temp"
GYRO_LSB = np.array([[100, -200, 300], [101, -201, 301], [-32768, 32767, 0], [4, 5, 6]])
ACCEL_LSB = np.array([[-10, 20, -8197], [-11, 21, -8198], [0, 0, -8197], [1, 2, 3]])
TEMP_LSB = np.array([0, 256, -128, 64])
T_NS = np.array([1_000_000_000, 1_004_808_000, 1_009_615_000, 1_014_423_000])
GYRO_DPS, ACCEL_G = GYRO_LSB * 0.0175, ACCEL_LSB * 0.122e-3
TIMES = {"t_us": T_NS // 1000, "t_ns": T_NS, "t_s": T_NS * 1e-9}
GYROS = {"": GYRO_LSB, "_dps": GYRO_DPS, "_rps": np.deg2rad(GYRO_DPS)}
ACCELS = {"": ACCEL_LSB, "_g": ACCEL_G, "_mps2": ACCEL_G * G}
TEMPS = {"temp": TEMP_LSB, "temp_c": 25 + TEMP_LSB / 256, None: None}


def text_of(time="t_us", gyro="", accel="", temp="temp", end="\n", extra=""):
    """A log of the four readings in the given units."""
    names = [time, *(f"g{axis}{gyro}" for axis in "xyz"), *(f"a{axis}{accel}" for axis in "xyz")] + ([temp] if temp else [])
    columns = [TIMES[time], *GYROS[gyro].T, *ACCELS[accel].T] + ([TEMPS[temp]] if temp else [])
    lines = [",".join(names) + extra, *(",".join(repr(value.item()) for value in row) + extra for row in zip(*columns, strict=True))]
    return end.join(lines) + end


def read(tmp_path, text, name="log0001.csv", sensor=SENSOR):
    path = tmp_path / name
    data = text if isinstance(text, bytes) else text.encode()
    path.write_bytes(gzip.compress(data) if name.endswith(".gz") else data)
    return read_log(path, sensor)


def assert_the_four_readings(log, temp=True):
    np.testing.assert_array_equal(log.samples.t_ns, T_NS)
    np.testing.assert_allclose(log.samples.gyro, np.deg2rad(GYRO_DPS), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(log.samples.accel, ACCEL_G * G, rtol=1e-12, atol=1e-15)
    if temp:
        np.testing.assert_allclose(log.samples.temp_c, [25, 26, 24.5, 25.25])
    else:
        assert log.samples.temp_c is None


# A rest and two turns, which no check has to judge, in the columns of any program

SAMPLES = Table().rest(2).turn(140, (1, 2, 0.5), 2.0).turn(-80, (0, 1, 1), 1.7).samples(odr_hz=104)
T_US = SAMPLES.t_ns // 1000
GYRO = {"dps": SAMPLES.gyro / DEG, "mdps": SAMPLES.gyro / DEG * 1e3, "rps": SAMPLES.gyro}
ACCEL = {"g": SAMPLES.accel / G, "mg": SAMPLES.accel / G * 1e3, "mps2": SAMPLES.accel}
TEMP = SAMPLES.temp_c
EPOCH_NS = 1_403_636_579_763_555_584
OWN = "gx_dps,gy_dps,gz_dps,ax_g,ay_g,az_g"


def triads(gyro, accel):
    return [*GYRO[gyro].T, *ACCEL[accel].T]


def table(stamps, name="t_us"):
    """A log in the project's own names."""
    return f"{name},{OWN}\n" + rows(stamps, *triads("dps", "g"))


HEAD = "time_ms,accX,accY,accZ,gyroX,gyroY,gyroZ\n"
USUAL = HEAD + rows(T_US / 1e3, *triads("dps", "g")[3:], *triads("dps", "g")[:3])
#: what a log of usual names does not say
TOLD = {"gyro_unit": "dps", "accel_unit": "g"}


@cache
def of_program(name):
    """The text of the first file that a program writes."""
    return TEXTS[name].write(SAMPLES)[0][1].decode()


PLAIN = table(T_US)


def inertial():
    return of_program("x-IMU3")


def make(tmp_path, *texts, name="LOG.CSV", out="session", **answers):
    """The session folder that a log, or several files of one, become."""
    paths = []
    for number, text in enumerate(texts):
        paths.append(tmp_path / (name if number == 0 else f"{number}{name}"))
        paths[-1].write_bytes(text if isinstance(text, bytes) else text.encode())
    return convert(paths, tmp_path / out, Answers(**{"gyro_fs_dps": 500.0, "accel_fs_g": 4.0, **answers}))


def same(made, temp=False):
    """The session that was made holds the samples of our own format."""
    session = read_session(made.folder)
    (log,) = session.logs
    assert not any(note for note in log.notes), log.notes
    np.testing.assert_array_equal(log.samples.t_ns - log.samples.t_ns[0], SAMPLES.t_ns)
    np.testing.assert_allclose(log.samples.gyro, SAMPLES.gyro, rtol=1e-12, atol=1e-8 * DEG)
    np.testing.assert_allclose(log.samples.accel, SAMPLES.accel, rtol=1e-12, atol=1e-8 * G)
    if temp:
        np.testing.assert_allclose(log.samples.temp_c, TEMP, atol=1e-8)
    return session
