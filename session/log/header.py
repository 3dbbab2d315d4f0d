"""The header line of a log: which column is what, in which unit (FORMATS: raw registers, or units said in the names)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from difflib import get_close_matches

from session.common.errors import FormatError
from session.common.units import DEG, G

#: time column -> nanoseconds per unit
TIME_NS = {"t_ns": 1, "t_us": 1_000, "t_s": 1_000_000_000}
#: unit suffix -> SI per unit; None: raw registers, the sensitivity decides
GYRO_UNITS = {"": None, "_dps": DEG, "_rps": 1.0}
ACCEL_UNITS = {"": None, "_g": G, "_mps2": 1.0}
TEMP_UNITS = {"temp": None, "temp_c": 1.0}
KNOWN = {
    "time": tuple(TIME_NS),
    "gyroscope": tuple(f"g{axis}{unit}" for unit in GYRO_UNITS for axis in "xyz"),
    "accelerometer": tuple(f"a{axis}{unit}" for unit in ACCEL_UNITS for axis in "xyz"),
}
SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}


@dataclass(frozen=True)
class Header:
    """Columns by position.  A scale of None means raw registers."""

    width: int
    time: int
    time_name: str
    gyro: tuple[int, int, int]
    gyro_scale: float | None
    accel: tuple[int, int, int]
    accel_scale: float | None
    temp: int | None
    temp_scale: float | None
    names: tuple[str, ...]

    @property
    def used(self) -> tuple[int, ...]:
        """Positions of the columns that are read, time first."""
        return (self.time, *self.gyro, *self.accel) + (() if self.temp is None else (self.temp,))

    def is_integer(self, column: int) -> bool:
        """Whether a column holds whole numbers: registers, and stamps in us or ns, which float64 must not round."""
        if column == self.time:
            return self.time_name != "t_s"
        scale = self.gyro_scale if column in self.gyro else self.accel_scale if column in self.accel else self.temp_scale
        return scale is None


def parse_header(line: str, where: str) -> Header:
    """Read the header line; FormatError (with ``where``) says which column is missing, doubled or in an unknown unit."""
    names = tuple(name.strip() for name in line.rstrip(",\r\n").split(","))
    expected = "expected t_us,gx,gy,gz,ax,ay,az,temp or units in the names (t_s, gx_dps, gx_rps, ax_g, ax_mps2, temp_c)"
    for separator, called in SEPARATORS.items():
        if len(names) < 7 and line.count(separator) >= 6:
            raise FormatError(f"{where}: separated by {called}; expected commas")
    if len(names) < 7 or all(re.fullmatch(r"[-+.\deE]*", name) for name in names):
        raise FormatError(f"{where}: no header line but {line.strip()[:60]!r}; {expected}")
    times = [name for name in names if name in TIME_NS]
    if len(times) != 1:
        raise FormatError(f"{where}: {_problem('time', names, times)}; {expected}")
    gyro, gyro_scale = _triad(names, "g", GYRO_UNITS, where, expected)
    accel, accel_scale = _triad(names, "a", ACCEL_UNITS, where, expected)
    temps = [name for name in names if name in TEMP_UNITS]
    if len(temps) > 1:
        raise FormatError(f"{where}: two temperature columns ({', '.join(temps)}); keep one")
    return Header(
        width=len(names),
        time=names.index(times[0]),
        time_name=times[0],
        gyro=gyro,
        gyro_scale=gyro_scale,
        accel=accel,
        accel_scale=accel_scale,
        temp=names.index(temps[0]) if temps else None,
        temp_scale=TEMP_UNITS[temps[0]] if temps else None,
        names=names,
    )


def _triad(names, letter, units, where, expected):
    """Positions and scale of the three columns of one sensor, all in one unit."""
    found = {suffix: [names.index(f"{letter}{axis}{suffix}") for axis in "xyz" if f"{letter}{axis}{suffix}" in names] for suffix in units}
    whole = [suffix for suffix, columns in found.items() if len(columns) == 3]
    if len(whole) == 1 and sum(map(len, found.values())) == 3:
        return tuple(found[whole[0]]), units[whole[0]]
    sensor = {"g": "gyroscope", "a": "accelerometer"}[letter]
    strangers = [name for name in names if re.fullmatch(rf"{letter}[xyz]_\w+", name) and name[2:] not in units]
    if strangers:
        known = ", ".join(f"{letter}x{suffix}" for suffix in units)
        raise FormatError(f"{where}: unknown unit in {strangers[0]!r}; known are {known}")
    raise FormatError(f"{where}: {_problem(sensor, names, [names[i] for columns in found.values() for i in columns])}; {expected}")


def _problem(what: str, names: tuple[str, ...], found: list[str]) -> str:
    near = "" if len(found) > 1 and what == "time" else _near(what, names, found)
    if not found:
        return f"no {what} column among {', '.join(names)[:80]}{near}"
    return f"the {what} columns are {', '.join(found)}{near}"


def _near(what: str, names: tuple[str, ...], found: list[str]) -> str:
    """The first name that is a known one in other letters, or nearly one: `` (is 'GX' meant as 'gx'?)``."""
    taken = {*found, *TEMP_UNITS, *(name for known in KNOWN.values() for name in known)}
    for name in names:
        close = [] if name in taken else get_close_matches(name.lower(), KNOWN[what], n=1, cutoff=0.75)
        if close:
            return f" (is {name[:40]!r} meant as {close[0]!r}?)"
    return ""
