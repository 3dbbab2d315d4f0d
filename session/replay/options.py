"""What a log may not state, as options: the same wherever one is read.  Imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass

from session.base.options import Record, documented, option

#: the order of the axes as they are
AXES = "x,y,z"
GROUP = "what a log may not state"


@documented
@dataclass(frozen=True)
class Answers(Record):
    """Options that state what a log does not: the sensor, units, full scales, rate, columns, mounting, and which rows are meant."""

    sensor: str | None = option(None, "what the sensor is, such as MPU-9250 (the command sensors lists those known)", group=GROUP)
    odr_hz: float | None = option(None, "data rate", unit="Hz", above=0, flags=("--odr",), group=GROUP)
    gyro_fs_dps: float | None = option(None, "full scale of the gyroscope", unit="dps", above=0, flags=("--gyro-fs",), group=GROUP)
    accel_fs_g: float | None = option(None, "full scale of the accelerometer", unit="g", above=0, flags=("--accel-fs",), group=GROUP)
    time_unit: str | None = option(None, "s, ms, us, ns, 25us; none: count samples at --odr", metavar="UNIT", example="'us'", group=GROUP)
    gyro_unit: str | None = option(None, "dps, mdps, rad/s, lsb, or one count: 0.061dps", metavar="UNIT", example="'dps'", group=GROUP)
    accel_unit: str | None = option(None, "g, mg, m/s2, lsb, or one count: g/2048", metavar="UNIT", example="'g'", group=GROUP)
    columns: str | None = option(
        None,
        "of any other table: t_us=NAME,gx_dps=NAME and so on to temp_c=NAME",
        metavar="LIST",
        example="'t_us=time,gx_dps=wx,…'",
        group=GROUP,
    )
    lines: str | None = option(
        None, "the rows that are meant, by their lines: 1-2991", metavar="FIRST-LAST", example="'1-2991'", group=GROUP, rare=True
    )
    packed: str | None = option(
        None,
        "of registers in one hexadecimal word: st, mpu, or big:ax,ay,az,temp,gx,gy,gz",
        metavar="ORDER",
        example="'st'",
        group=GROUP,
        rare=True,
    )
    topic: str | None = option(None, "of a binary log that holds several; or two, GYROSCOPE,ACCELEROMETER", group=GROUP, rare=True)
    like: str | None = option(None, "take it for this program's log (`import --list` names them)", metavar="PROGRAM", group=GROUP)
    rows: str | None = option(
        None,
        "of several kinds of rows: those that begin with this word, or have so many columns",
        metavar="WORD",
        example="'IMU' or '7'",
        group=GROUP,
        rare=True,
    )
    where: str | None = option(
        None,
        "of several sensors' rows: those with this value in a column: I=0",
        metavar="NAME=VALUE",
        example="'id=0'",
        group=GROUP,
        rare=True,
    )
    gyro_axes: str = option(AXES, "the log's axes that become x,y,z: y,-x,z", metavar="X,Y,Z", example="'y,-x,z'", group=GROUP, rare=True)
    accel_axes: str = option(
        AXES, "the same for the accelerometer; -x,-y,-z if it shows gravity", metavar="X,Y,Z", example="'y,-x,z'", group=GROUP, rare=True
    )
    even: bool = option(
        False,
        "count the samples along their stamps, which scatter or are rounded: at one rate, on straight lines between gaps",
        cli=False,
        group=GROUP,
    )


@documented
@dataclass(frozen=True)
class Place(Record):
    """Where a log was recorded."""

    latitude_deg: float | None = option(
        None, "your latitude, north positive: kept in session.toml", least=-90, most=90, flags=("--latitude",), metavar="DEG"
    )


@dataclass(frozen=True)
class Into(Record):
    """What a log becomes a part of."""

    add: str | None = option(None, "add to the session that is there, as a further log or a closure run", choices=("log", "closure"))
    serial: str = option("", "which one it is", metavar="TEXT", read=str, rare=True)
