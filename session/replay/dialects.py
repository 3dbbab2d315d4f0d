"""Dialects of text logs: the layout of a file, and the table of known logs.  A new dialect is one row."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace

from session.log.layout import Layout

# The layout of a file.

#: what this tool's own log is called, and a table that no dialect knows
OWN, OTHER = "TinyGC", "other"


@dataclass(frozen=True)
class TableLayout(Layout):
    """Of any program's log.

    dialect's name; clock: the time is one of day; frame, as far as it is documented; finer: further terms of the time, as a second's
    fraction next to whole seconds, each a column and its ns per unit; sources: where the unit of ``time``, ``gyro``, ``accel`` is from;
    facts: what lines before the header state, as comments do; intervals: whether the time is that since the row before.
    """

    dialect: str = OTHER
    clock: bool = False
    frame: str = ""
    finer: tuple[tuple[int, int], ...] = ()
    sources: Mapping[str, str] = field(default_factory=dict)
    facts: Mapping[str, str] = field(default_factory=dict)
    intervals: bool = False

    @property
    def used(self) -> tuple[int, ...]:
        """Columns that are read, time first."""
        stamps = (() if self.time is None else (self.time,)) + tuple(column for column, _ in self.finer)
        return (*stamps, *self.numbers)

    def is_whole(self, column: int) -> bool:
        """Whether a column may hold nothing but whole numbers: programs write registers and stamps as they like."""
        return False

    def only(self, kind: str) -> TableLayout:
        """Of one quantity alone."""
        gyro, accel = (triad if kind == name else None for name, triad in (("gyro", self.gyro), ("accel", self.accel)))
        temp, unit = (self.temp, self.temp_unit) if kind == "temp" else (None, None)
        return replace(self, gyro=gyro, accel=accel, temp=temp, temp_unit=unit)


# What lines before a header state, in the words of comments: units, full scales.


def _betaflight(header: Mapping[str, str]) -> dict[str, str]:
    """Of ``gyro_scale`` (dps per count; often as the bits of a float; a tenth with ``blackbox_high_resolution``) and ``acc_1G``, which the
    recorder's header lines state."""
    facts: dict[str, str] = {}
    with suppress(KeyError, ValueError, struct.error, OverflowError):
        text = (header.get("gyro_scale") or header["gyro.scale"]).lower()  # with a point before 2017
        scale = struct.unpack(">f", bytes.fromhex(text[2:].zfill(8)))[0] if text.startswith("0x") else float(text)
        scale /= 10 if header.get("blackbox_high_resolution") == "1" else 1
        if 1e-4 < scale <= 1:
            facts |= {"gyro_unit": f"{scale:.9g}dps", "gyro_fs_dps": "2000"}
    with suppress(KeyError, ValueError, ZeroDivisionError):
        one_g = float(header["acc_1g"])
        if one_g >= 100:
            facts |= {"accel_unit": f"g/{one_g:g}", "accel_fs_g": f"{32768 / one_g:g}"}
    return facts


def _gyroflow(header: Mapping[str, str]) -> dict[str, str]:
    """``tscale`` in s, ``gscale`` in rad/s and ``ascale`` in g per count."""
    named = (("tscale", "time_unit", "s"), ("gscale", "gyro_unit", "rad/s"), ("ascale", "accel_unit", "g"))
    return {key: f"{header[scale]}{unit}" for scale, key, unit in named if scale in header}


# The dialects.  A new one is one entry.
#
# Names are those of the header without unit, in small letters; ``{}`` stands for the axis.  A unit in the header, in [] or (), always
# counts; the units here are those that the dialect is documented to use where its header states none.  Where neither states a unit, an
# option must.


@dataclass(frozen=True)
class Dialect:
    """name as the notes call it; signature: columns that must be there to recognise it; time: column, the first of these that is there
    (a clock is seen as one; ``a+b`` are whole seconds and nanoseconds); gyro and accel with {} for the axis (axes: its three names);
    temp; units where the header has none; frame: what is documented of its axes; both: a file of it holds both sensors; by_file: columns
    are the same for each sensor, and the file's name states which it is; begins: what its first line holds; facts: what lines before the
    header state."""

    name: str
    time: tuple[str, ...]
    gyro: str
    accel: str
    temp: str = ""
    axes: str = "xyz"
    signature: tuple[str, ...] = ()
    time_unit: str = ""
    gyro_unit: str = ""
    accel_unit: str = ""
    frame: str = ""
    both: bool = False
    by_file: bool = False
    begins: str = ""
    facts: Callable[[Mapping[str, str]], dict[str, str]] | None = None

    @property
    def example(self) -> str:
        """A header line, as ``import --list`` shows it."""
        triads = [pattern.format(axis) for pattern in dict.fromkeys((self.gyro, self.accel)) for axis in self.axes]
        return ",".join((*dict.fromkeys((*self.signature, self.time[0].replace("+", ","))), *triads))


PHONE = "a telephone's: x right, y up, z out of the screen"
DIALECTS = (
    Dialect(
        "Gyroflow",
        time=("t",),
        gyro="g{}",
        accel="a{}",
        begins="GYROFLOW IMU LOG",
        facts=_gyroflow,
        frame="as its line `orientation` states",
    ),
    Dialect("phyphox", time=("time",), gyro="gyroscope {}", accel="acceleration {}", time_unit="s", signature=("time",), frame=PHONE),
    Dialect(
        "x-IMU3",
        time=("timestamp", "time"),
        gyro="gyroscope {}",
        accel="accelerometer {}",
        temp="temperature",
        frame="x-io's axes, z up when level",
        both=True,
    ),
    Dialect(
        "Kalibr",
        time=("timestamp",),
        gyro="omega_{}",
        accel="alpha_{}",
        time_unit="ns",
        gyro_unit="rad/s",
        accel_unit="m/s2",
        both=True,
    ),
    # A file for each sensor; one name stands for three columns, and may state their order.
    Dialect("GoPro", time=("cts",), gyro="gyroscope {}", accel="accelerometer {}", time_unit="ms", frame="the camera's own axes"),
    Dialect(
        "EuRoC", time=("timestamp",), gyro="w_rs_s_{}", accel="a_rs_s_{}", time_unit="ns", frame="the sensor frame S of its sensor.yaml"
    ),
    Dialect(
        "ROS, rostopic echo -p",
        time=("field.header.stamp", "%time"),
        gyro="field.angular_velocity.{}",
        accel="field.linear_acceleration.{}",
        time_unit="ns",
        gyro_unit="rad/s",
        accel_unit="m/s2",
        frame="as the driver has them; REP 103 asks for x forward, y left, z up",
    ),
    Dialect(
        "ROS, a table of messages",
        time=(
            "header.stamp.secs+header.stamp.nsecs",
            "header.stamp.sec+header.stamp.nanosec",
            "header_stamp_sec+header_stamp_nanosec",
            "secs+nsecs",
            "sec+nanosec",
            "time",
        ),
        gyro="angular_velocity.{}",
        accel="linear_acceleration.{}",
        time_unit="s",
        gyro_unit="rad/s",
        accel_unit="m/s2",
        frame="as the driver has them; REP 103 asks for x forward, y left, z up",
    ),
    Dialect(
        "OpenLog Artemis",
        time=("micros", "rtctime"),
        gyro="g{}",
        accel="a{}",
        temp="imu_degc",
        signature=("rtctime",),
        time_unit="us",
        gyro_unit="dps",
        accel_unit="mg",
        frame="the ICM-20948's axes, z up when level",
    ),
    Dialect(
        "PX4 sensor_combined",
        time=("timestamp",),
        gyro="gyro_rad[{}]",
        accel="accelerometer_m_s2[{}]",
        axes="012",
        time_unit="us",
        gyro_unit="rad/s",
        accel_unit="m/s2",
        frame="forward, right, down",
    ),
    Dialect(
        "Betaflight blackbox",
        time=("time",),
        gyro="gyroadc[{}]",
        accel="accsmooth[{}]",
        axes="012",
        signature=("loopiteration",),
        time_unit="us",
        frame="forward, left, up",
        facts=_betaflight,
    ),
    # Of a text log, the rows of one kind: ``--rows IMU``.
    Dialect(
        "ArduPilot",
        time=("timeus",),
        gyro="gyr{}",
        accel="acc{}",
        temp="t",
        time_unit="us",
        gyro_unit="rad/s",
        accel_unit="m/s2",
        frame="forward, right, down",
    ),
    # MTi counts SampleTimeFine in 100 us and DOT in us, and rates are in rad/s or in deg/s: the same header.
    Dialect(
        "Xsens",
        time=("sampletimefine",),
        gyro="gyr_{}",
        accel="acc_{}",
        signature=("packetcounter",),
        accel_unit="m/s2",
        frame="the sensor's own axes, z up when level",
    ),
    # Two files, one for each sensor, or their like in one.
    Dialect("ST HSDatalog", time=("time",), gyro="g_{}", accel="a_{}", temp="temp", time_unit="s", frame="the sensor's own axes"),
    Dialect("ST DataLog", time=("timestamp",), gyro="g_{}", accel="a_{}", temp="t", frame="the sensor's own axes"),
    # Telephones.  What they call linear or user acceleration is without gravity: no reference.
    Dialect(
        "Sensor Logger",
        time=("time",),
        gyro="{}",
        accel="{}",
        signature=("seconds_elapsed",),
        time_unit="ns",
        gyro_unit="rad/s",
        accel_unit="m/s2",
        frame=PHONE,
        by_file=True,
    ),
    Dialect("Physics Toolbox", time=("time",), gyro="w{}", accel="gf{}", time_unit="s", gyro_unit="rad/s", accel_unit="g", frame=PHONE),
    Dialect("AndroSensor", time=("time since start",), gyro="gyroscope {}", accel="accelerometer {}", time_unit="ms", frame=PHONE),
    Dialect(
        "SensorLog",
        time=("gyrotimestamp_sincereboot", "accelerometertimestamp_sincereboot", "loggingtime"),
        gyro="gyrorotation{}",
        accel="accelerometeracceleration{}",
        time_unit="s",
        frame=PHONE,
    ),
)
