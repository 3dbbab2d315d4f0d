"""Log dialects: the layout of a file, the ``--columns`` option, and the table of known logs.  A new dialect is one row."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from session.io.errors import FormatError
from session.io.registers import RegisterUnits
from session.io.units import NS_PER_S, Unit

# A file's layout: which column is what, in which unit; and the options that state what the file does not.

#: the order of the axes as they are
AXES = "x,y,z"


@dataclass(frozen=True)
class Answers:
    """Options that state what a log does not: the sensor, units as words of ``units``, full scales, rate, columns, mounting.

    gyro_axes, accel_axes: the log's axes that become x, y, z, such as ``y,-x,z``.  rows, where: the rows that are meant, as in
    ``session.io.rows.Wanted``.
    """

    odr_hz: float | None = None
    gyro_fs_dps: float | None = None
    accel_fs_g: float | None = None
    time_unit: str | None = None
    gyro_unit: str | None = None
    accel_unit: str | None = None
    columns: str | None = None
    gyro_axes: str = AXES
    accel_axes: str = AXES
    sensor: str | None = None
    rows: str | None = None
    where: str | None = None


@dataclass(frozen=True)
class Triad:
    """columns of x, y, z by position, after signs and order of the axes; unit."""

    columns: tuple[int, int, int]
    signs: tuple[int, int, int]
    unit: Unit


def three(values: Iterable[int]) -> tuple[int, int, int]:
    """One value each for x, y, z; ValueError for another number of them."""
    x, y, z = values
    return x, y, z


@dataclass(frozen=True)
class Layout:
    """dialect's name; delimiter (None: white space); first: number of lines before the rows; time: column, or None where rows are only
    counted; time_ns per unit of it; clock: it is a time of day; gyro, accel: what is there; temp: column; names of all columns;
    frame, as far as it is documented; header_line as it stands in the file; standard: held to the letter of docs/formats.md, as a session's
    logs are: commas, no quotes, whole numbers for registers and for stamps in ns or us, a counter only in us; finer: the column of a
    second's fraction beside whole seconds, and its ns per unit; remark: what was chosen without being told."""

    dialect: str
    delimiter: str | None
    first: int
    time: int | None
    time_ns: int
    clock: bool
    gyro: Triad | None
    accel: Triad | None
    temp: int | None
    temp_unit: Unit | None
    names: tuple[str, ...]
    frame: str = ""
    header_line: str = ""
    standard: bool = False
    finer: tuple[int, int] | None = None
    remark: str = ""

    @property
    def numbers(self) -> tuple[int, ...]:
        """Columns of numbers, apart from the time: each once, the gyroscope's first."""
        triads = (triad.columns for triad in (self.gyro, self.accel) if triad is not None)
        return tuple(dict.fromkeys(column for columns in triads for column in columns)) + (() if self.temp is None else (self.temp,))

    @property
    def used(self) -> tuple[int, ...]:
        """Columns that are read, time first."""
        stamps = (() if self.time is None else (self.time,)) + (() if self.finer is None else (self.finer[0],))
        return (*stamps, *self.numbers)

    @property
    def kinds(self) -> list[tuple[str, tuple[int, ...], Unit]]:
        """Each quantity that is there: ``gyro``, ``accel`` or ``temp``, its columns, its unit."""
        triads = (("gyro", self.gyro), ("accel", self.accel))
        found: list[tuple[str, tuple[int, ...], Unit]] = [(kind, triad.columns, triad.unit) for kind, triad in triads if triad is not None]
        return found + ([] if self.temp is None or self.temp_unit is None else [("temp", (self.temp,), self.temp_unit)])

    @property
    def time_column(self) -> int:
        """``time`` of a log that has stamps."""
        assert self.time is not None  # the log has stamps
        return self.time

    def is_register(self, column: int) -> bool:
        """Whether a column holds a sensor's registers."""
        return any(column in columns and unit.si is None for _, columns, unit in self.kinds)

    def is_whole(self, column: int) -> bool:
        """Whether a column may hold nothing but whole numbers."""
        return self.standard and (self.time_ns < NS_PER_S if column == self.time else self.is_register(column))

    def name(self, column: int) -> str:
        """A column's name, as a complaint says it."""
        return self.names[column] if column < len(self.names) else f"column {column + 1}"

    def gyro_si(self, units: RegisterUnits) -> float:
        """rad/s per written unit; units: of registers.  FormatError where it holds registers whose meaning is not known."""
        assert self.gyro is not None  # the caller has checked that it is there
        if self.gyro.unit.si is not None:
            return self.gyro.unit.si
        return units.gyro_rps

    def accel_si(self, units: RegisterUnits) -> float:
        """m/s^2 per written unit; FormatError as for the gyroscope."""
        assert self.accel is not None
        if self.accel.unit.si is not None:
            return self.accel.unit.si
        return units.accel_mps2

    def temperature_c(self, values: np.ndarray, units: RegisterUnits) -> np.ndarray | None:
        """degC (N,) of temperatures as written; None of registers whose meaning is not known."""
        assert self.temp_unit is not None
        return units.temperature_c(values) if self.temp_unit.si is None else values * self.temp_unit.si


# ``--columns t_us=NAME,gx_dps=NAME,…``: any CSV at all, in the words of the headers of docs/formats.md.

EXPECTED = (
    "expected t_us=NAME,gx_dps=NAME,…,az_g=NAME,temp_c=NAME; NAME is the header's, or the column's number from 1, with - for a wrong sign"
)
KEY = re.compile(r"(t|g[xyz]|a[xyz]|temp)(?:_(\S+))?")
#: one column of a log: its position, its unit as text, its sign
Column = tuple[int, str, int]
#: None: any run of white space
DELIMITERS = (",", ";", "\t", None)
NEEDED = tuple(f"{letter}{axis}" for letter in "ga" for axis in "xyz")


def from_columns(text: str, lines: list[str], name: str) -> tuple[str | None, int, tuple[str, ...], dict[str, Column]]:
    """``(delimiter, lines before the rows, names, {t, gx, …: (column, unit, sign)})``."""
    wanted = parse_columns(text, KEY, EXPECTED)
    if missing := [key for key in NEEDED if key not in wanted]:
        raise FormatError(f"--columns: {', '.join(missing)} missing; {EXPECTED}")
    for number, line in enumerate(lines):
        for delimiter in DELIMITERS:
            names = split(line, delimiter)
            looked_up = {key: _place(what, names) for key, (what, _, _) in wanted.items()}
            places = {key: place for key, place in looked_up.items() if place is not None}
            if len(places) < len(wanted) or (all(what.isdigit() for what, _, _ in wanted.values()) and not _numeric(names, places)):
                continue
            if twice := [what for what, _, _ in wanted.values() if not what.isdigit() and names.count(what) > 1]:
                raise FormatError(
                    f"{name}: {twice[0]!r} stands {names.count(twice[0])} times in the header; give --columns its number, from 1"
                )
            headless = all(what.isdigit() for what, _, _ in wanted.values())
            columns = {key: (places[key], unit, sign) for key, (_, unit, sign) in wanted.items()}
            if headless:
                return delimiter, number, tuple(f"column {place + 1}" for place in range(len(names))), columns
            return delimiter, number + 1, names, columns
    unknown = [what for what, _, _ in wanted.values() if not any(what in line for line in lines) and not what.isdigit()]
    problem = f"no column {unknown[0]!r}" if unknown else "no line with all of these columns"
    first = next((line.strip()[:60] for line in lines if line.strip()), "")
    raise FormatError(f"{name}: {problem} (--columns); it begins {first!r}")


def split(line: str, delimiter: str | None) -> tuple[str, ...]:
    """A header's names, whatever stands around them."""
    line = line.strip().lstrip("\ufeff#").strip()
    if delimiter is None:
        line = re.sub(r"(?<!\s)\s++(?=[\[(])", "", line)
    return tuple(part.strip().strip('"').strip() for part in line.split(delimiter))


def parse_columns(text: str, pattern: re.Pattern[str], expected: str) -> dict[str, tuple[str, str, int]]:
    """{gx: (name or number, unit, sign)} of the text of ``--columns``; pattern: of its keys, with the quantity and the unit as groups.

    FormatError, which says what is expected, for another key and for one that is given twice.
    """
    wanted = {}
    for entry in text.split(","):
        key, equals, what = entry.strip().partition("=")
        match = pattern.fullmatch(key.strip())
        if not match or not equals or not what.strip().lstrip("-"):
            raise FormatError(f"--columns: {entry.strip()!r} is no column; {expected}")
        kind, unit = match[1], match[2] or ""
        if kind in wanted:
            raise FormatError(f"--columns: {kind} is given twice; {expected}")
        what, sign = what.strip(), 1
        if what.startswith("-"):
            what, sign = what[1:].strip(), -1
        if not unit and kind[0] in "ga":
            unit = "lsb"
        wanted[kind] = what, unit or ("lsb" if kind == "temp" else ""), sign
    return wanted


def _place(what: str, names: tuple[str, ...]) -> int | None:
    if what in names:
        return names.index(what)
    if what.isdigit() and 1 <= int(what) <= len(names):
        return int(what) - 1
    lower = [name.lower() for name in names]
    return lower.index(what.lower()) if what.lower() in lower else None


def _numeric(names: tuple[str, ...], places: dict[str, int]) -> bool:
    """Whether a line is a row, not a header."""
    return all(re.fullmatch(r"[-+]?[\d.,:eE+-]+", names[place]) for place in places.values())


# The dialects.  A new one is one entry.
#
# Names are those of the header without unit, in small letters; ``{}`` stands for the axis.  A unit in the header, in [] or (), always
# counts; the units here are those that the dialect is documented to use where its header says none.  Where neither states a unit, an
# option must.


@dataclass(frozen=True)
class Dialect:
    """name as the notes call it; signature: columns that must be there to recognise it; time: column, the first of these that is there
    (a clock is seen as one); gyro and accel with {} for the axis (axes: its three names); temp; units where the header has none;
    frame: what is documented of its axes."""

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


DIALECTS = (
    Dialect(
        "x-IMU3",
        time=("timestamp", "time"),
        gyro="gyroscope {}",
        accel="accelerometer {}",
        temp="temperature",
        frame="x-io's axes, z up when level",
    ),
    Dialect(
        "EuRoC", time=("timestamp",), gyro="w_rs_s_{}", accel="a_rs_s_{}", time_unit="ns", frame="the sensor frame S of its sensor.yaml"
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
    # Two files, one for each sensor, or their like in one.
    Dialect("ST HSDatalog", time=("time",), gyro="g_{}", accel="a_{}", temp="temp", time_unit="s", frame="the sensor's own axes"),
    Dialect("ST DataLog", time=("timestamp",), gyro="g_{}", accel="a_{}", temp="t", frame="the sensor's own axes"),
)
