"""The clock of a log whose header names none of ours: which left-over column rises steadily, and in which unit.

A log whose samples are only counted has the nominal rate's error in every angle, so a clock that is there is never passed over: it is
taken where its name or its pace says the unit, and named where they do not.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal

import numpy as np

from session.io.errors import FormatError
from session.io.questions import Question, QuestionsError
from session.io.stamps import COUNTER, DAY_NS, ERA_NS, Unroll, bad_stamps
from session.io.units import NS, NS_PER_S, TIME, parse_unit

#: a time of day, behind a date or not, and its zone: Z, UTC, +01:00
CLOCK = re.compile(r"(?:.*[ T])?(\d+):(\d+):([\d.]+) ?(?:Z|UTC|GMT|([+-])(\d\d):?(\d\d))?")
#: no time, whatever its unit
BEYOND = Decimal(10) ** 40
#: minutes
DAY_MIN = 1440


def exact_ns(text: str, unit_ns: float) -> int:
    """A decimal number or a clock (hh:mm:ss.ss, a date before it or not) as integer nanoseconds.  Raises ValueError for anything else.

    A clock with a zone is the time of day in UTC, which goes on where the zone's summer time begins or ends.
    """
    text = text.strip().strip('"')
    if ":" in text:
        if (clock := CLOCK.fullmatch(text)) is None:
            raise ValueError(f"{text[:20]!r} is no time")
        hours, minutes, seconds, sign, zone_hours, zone_minutes = clock.groups()
        east_min = 0 if sign is None else (int(zone_hours) * 60 + int(zone_minutes)) * (-1 if sign == "-" else 1)
        minutes_utc = int(hours) * 60 + int(minutes) - east_min
        return (minutes_utc if sign is None else minutes_utc % DAY_MIN) * 60 * NS_PER_S + exact_ns(seconds, NS_PER_S)
    if isinstance(unit_ns, int):
        with suppress(ValueError):
            return int(text) * unit_ns
    try:
        scaled = Decimal(text) * Decimal(unit_ns)
        if not abs(scaled) < BEYOND:  # also of "nan", and before an exponent of six digits is written out
            raise ValueError
        return int(scaled.to_integral_value())
    except (ArithmeticError, ValueError):
        raise ValueError(f"{text[:20]!r} is no time") from None


# Which column is the clock.

#: words in names of columns that are clocks, and the unit that they state
UNITS = {
    **dict.fromkeys(("ns", "nsec", "nsecs", "nanos", "nanosec", "nanosecs", "nanosecond", "nanoseconds"), "ns"),
    **dict.fromkeys(("us", "µs", "μs", "usec", "usecs", "micros", "microsec", "microsecs", "microsecond", "microseconds"), "us"),
    **dict.fromkeys(("ms", "msec", "msecs", "millis", "millisec", "millisecs", "millisecond", "milliseconds"), "ms"),
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
}
CLOCKS = (
    "t",
    "ts",
    "time",
    "times",
    "timestamp",
    "timestamps",
    "stamp",
    "stamps",
    "clock",
    "datetime",
    "utc",
    "uptime",
    "epoch",
    "tick",
    "ticks",
)
COUNTERS = (
    "counter",
    "count",
    "index",
    "idx",
    "seq",
    "sequence",
    "sample",
    "samples",
    "frame",
    "packet",
    "row",
    "line",
    "id",
    "number",
    "no",
)
#: rows that a column without a clock's name must rise over: fewer may rise by chance, as a temperature's do
LEAST_ROWS = 16
#: of their median: by how much the steps of such a column may differ
STEADY_WITHIN = 0.5
#: a free choice of unit is taken within this factor of the rate that is declared; the next unit is a thousand away
RATE_WITHIN = 2.0
#: Hz, from the first to below the second: sensors' rates where none is declared, so far apart that one unit of a clock fits
SENSORS_HZ = (10.0, 10_000.0)


@dataclass(frozen=True)
class Clock:
    """column; unit, a word of ``TIME``, or a multiple; finer: a column of a second's fraction beside whole seconds, and its ns per unit;
    says: which column it is, and why in this unit."""

    column: int
    unit: str
    says: str
    finer: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A left-over column that rises: its name, whether that is a clock's, the unit that it states, and values in units of a second."""

    column: int
    name: str
    named: bool
    unit: str | None
    seconds: np.ndarray

    @property
    def step(self) -> float:
        """Mean step, in the column's own unit."""
        return float(self.seconds[-1] - self.seconds[0]) / (len(self.seconds) - 1)


def find_clock(
    rows: Sequence[Sequence[str]], names: Sequence[str], read: Collection[int], odr_hz: float | None, stated: str | None, where: str
) -> Clock | None:
    """The clock among the columns that are not ``read``, by the first rows' cells; None where no column rises as a clock does.

    odr_hz: the declared rate; stated: the unit, where the person gives it.  QuestionsError names the column where it cannot be told whether
    it is the clock, or in which unit; FormatError names several that may be it.
    """
    left = [column for column in range(max(map(len, rows), default=0)) if column not in read]
    if (pair := _pair(rows, names, left)) is not None:
        return pair
    found = [each for column in left if (each := _candidate(rows, column, names)) is not None]
    found = [each for each in found if each.named] or found
    if not found:
        return None
    found.sort(key=lambda each: (each.unit is None, -len(np.unique(each.seconds)), TIME.get(each.unit or "s", 0)))
    best = found[0]
    if stated is not None:
        if len(found) > 1 and best.unit is None:
            raise FormatError(
                f"{where}: {' and '.join(repr(each.name) for each in found[:4])} rise; name the clock, --columns t_{stated}=NAME,…"
            )
        return Clock(best.column, stated, f"{best.name!r} is taken for the clock, in {stated} as --time-unit says{_pace(best, stated)}")
    if best.unit is not None:
        return Clock(best.column, best.unit, f"{best.name!r} is taken for the clock, in {best.unit} by its name{_pace(best, best.unit)}")
    unit = _plausible_unit(best.step, odr_hz) if best.named else None
    if unit is None:
        what = f"whether the column {best.name!r}, which rises steadily by {best.step:.6g} a row, is its clock, and in which unit"
        raise QuestionsError(where, "", [Question(what, "--time-unit", "s, ms, us, ns or a multiple, or none with --odr HZ if it is none")])
    why = f"as {odr_hz:g} Hz are declared" if odr_hz else "the only unit that gives a sensor's rate"
    return Clock(best.column, unit, f"{best.name!r} is taken for the clock, in {unit}, {why}{_pace(best, unit)}")


def _pace(clock: _Candidate, unit: str) -> str:
    known = parse_unit("time", unit)
    if len(np.unique(clock.seconds)) < len(clock.seconds) // 2:
        return ""  # stamps that many samples share: what is counted along them says the rate
    return "" if known is None or not known.si else f": {1 / (clock.step * known.si * NS):.5g} Hz"


def _plausible_unit(step: float, odr_hz: float | None) -> str | None:
    """The unit in which a step makes the declared rate, or, where none is, any sensor's."""
    rates = {unit: 1 / (step * TIME[unit] * NS) for unit in ("s", "ms", "us", "ns")}
    if odr_hz:
        return next((unit for unit, hz in rates.items() if abs(math.log(hz / odr_hz)) <= math.log(RATE_WITHIN)), None)
    return next((unit for unit, hz in rates.items() if SENSORS_HZ[0] <= hz < SENSORS_HZ[1]), None)


def _words(name: str) -> list[str]:
    """``field.header.stampSecs [ns]``: its words, in small letters."""
    return re.findall(r"[a-zµμ]+", re.sub(r"([a-zµμ])([A-Z])", r"\1 \2", name).lower())


def _values(rows: Sequence[Sequence[str]], column: int, is_clock: bool) -> np.ndarray | None:
    """Cells as (N,) units of a second from the first, carried on where a counter comes round; None where they are no numbers and no times
    of day.  A row or two may be another program's words."""
    found, missing = [], 0
    for row in rows:
        try:
            cell = row[column]
            found.append(exact_ns(cell if "," not in cell else cell.replace(",", "."), NS_PER_S))
        except (IndexError, ValueError):
            missing += 1
    if len(found) < 2 or missing > len(rows) // LEAST_ROWS:
        return None
    if max(map(abs, found)) >= ERA_NS:  # no counter has so many digits
        return np.array([(value - found[0]) / NS_PER_S for value in found])
    stamps = np.array(found)
    bad = bad_stamps(stamps)
    stamps[bad] = (stamps[bad - 1] + stamps[bad + 1]) // 2
    usual_ns = DAY_NS if is_clock else COUNTER * NS_PER_S
    stamps = Unroll(usual_ns, None if is_clock else NS_PER_S)(stamps)
    return (stamps - stamps[0]) / NS_PER_S


def _candidate(rows: Sequence[Sequence[str]], column: int, names: Sequence[str]) -> _Candidate | None:
    name = names[column] if column < len(names) and names[column] else f"column {column + 1}"
    words = _words(name)
    stated = [UNITS[word] for word in words if word in UNITS]
    named = bool(stated or set(words) & set(CLOCKS))
    is_clock = any(":" in row[column] for row in rows[:1] if column < len(row))
    seconds = _values(rows, column, is_clock)
    if seconds is None or (not named and (set(words) & set(COUNTERS) or len(seconds) < LEAST_ROWS)):
        return None
    steps = np.diff(seconds)
    if steps.min() < 0 or seconds[-1] <= 0:
        return None
    usual = float(np.median(steps))
    if not named and (usual <= 0 or (steps == 1).all() or np.abs(np.percentile(steps, (5, 95)) - usual).max() > STEADY_WITHIN * usual):
        return None  # it numbers the rows, or it is no clock
    return _Candidate(column, name, named or is_clock, "s" if is_clock else stated[-1] if stated else None, seconds)


def _pair(rows: Sequence[Sequence[str]], names: Sequence[str], left: Sequence[int]) -> Clock | None:
    """Whole seconds in one column and their fraction in another, whose names differ in nothing but the unit."""
    split: dict[tuple[str, ...], dict[str, int]] = {}
    for column in left:
        words = _words(names[column]) if column < len(names) else []
        if words and words[-1] in UNITS:
            split.setdefault(tuple(words[:-1]), {})[UNITS[words[-1]]] = column
    for units in split.values():
        fine = next((unit for unit in ("ns", "us", "ms") if unit in units), None)
        if "s" not in units or fine is None:
            continue
        cells = [(row[units["s"]].strip(), row[units[fine]].strip()) for row in rows if max(units["s"], units[fine]) < len(row)]
        if not cells or not all(a.lstrip("-").isdigit() and b.isdigit() and int(b) < NS_PER_S // TIME[fine] for a, b in cells):
            continue
        whole = [int(a) * (NS_PER_S // TIME[fine]) + int(b) for a, b in cells]
        if whole != sorted(whole):
            continue
        pair = (names[units["s"]], names[units[fine]])
        return Clock(
            units["s"],
            "s",
            f"{pair[0]!r} and {pair[1]!r} are taken for the clock, in s and {fine} by their names",
            (units[fine], TIME[fine]),
        )
    return None
