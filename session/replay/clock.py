"""The clock of a log whose header names none of ours: which left-over column rises steadily, and in which unit.

A log whose samples are only counted has the nominal rate's error in every angle, so a clock that is there is never passed over: it is
taken where something states its unit, and a question where two units are plausible.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import accumulate, pairwise

import numpy as np

from session.base.errors import FormatError
from session.base.questions import Question, QuestionsError
from session.base.texts import measured
from session.base.units import NS, NS_PER_S, TIME, parse_unit
from session.log.stamps import COUNTER, DAY_NS, ERA_NS, Unroll, bad_stamps, decimal_ns

#: a time of day, behind a date or not, and its zone: Z, UTC, +01:00
CLOCK = re.compile(r"(?:.*[ T])?(\d+):(\d+):([\d.]+) ?(?:Z|UTC|GMT|([+-])(\d\d):?(\d\d))?")
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
    return decimal_ns(text, unit_ns)


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
#: of columns that hold the time since the row before
INTERVALS = ("dt", "δt", "delta", "interval", "intervals", "diff")
#: rows that a column without a clock's name must rise over: fewer may rise by chance, as a temperature's do
LEAST_ROWS = 16
#: of their median: by how much the steps of such a column may differ
STEADY_WITHIN = 0.5
#: a free choice of unit is taken within this factor of the rate that is declared; the next unit is a thousand away
RATE_WITHIN = 2.0
#: Hz: sensors' and loggers' rates where none is declared; from 10 Hz to 1 kHz one unit of a clock fits alone
SENSORS_HZ = (1.0, 10_000.0)
#: a data rate in words, of a line that has Hz in it
RATE = re.compile(r"(?:rate|freq|odr)\D{0,20}(\d+(?:\.\d+)?)", re.I)
#: s of an epoch, 2001 to 2100: stamps that are such a date in one unit are in that unit
DATES_S = (1e9, 4.1e9)
#: values among the first rows: a clock has more, but for one of whole seconds or so
FEW_STAMPS = 3
#: of the rows: steps of 1 in a column that numbers them, among some that are lost
NUMBERS_ROWS = 0.9
#: a stamp of so many units that stands still, or goes on by so many of them at once, has lost its last digits: whole units do not
LARGE, SEVERAL = 1e5, 2.0
#: how a unit is known, in words
GIVEN, BY_NAME, BY_RATE, BY_DATE = "as given", "by its name", "by the sensors' rates", "by its date"


@dataclass(frozen=True)
class Clock:
    """column; unit, a word of ``TIME``, or a multiple; known: how the unit is; description: which column it is, and why in this unit;
    finer: a column of a second's fraction next to whole seconds, and its ns per unit."""

    column: int
    unit: str
    known: str
    description: str
    finer: tuple[int, int] | None = None


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A left-over column that rises: its name, whether that is a clock's, the unit that it states, and values in its own unit, from the
    first; is_clock: whether these are times of day; intervals: whether they are sums of it."""

    column: int
    name: str
    named: bool
    unit: str | None
    begins: float
    values: np.ndarray
    is_clock: bool = False
    intervals: bool = False

    @property
    def step(self) -> float:
        """Mean step, in the column's own unit."""
        return float(self.values[-1]) / (len(self.values) - 1)

    @property
    def numbers_rows(self) -> bool:
        """Whether it rises by exactly 1 a row, but for rows that are lost."""
        steps = np.diff(self.values)
        return bool((steps >= 1).all() and (steps % 1 == 0).all() and np.mean(steps == 1) >= NUMBERS_ROWS)

    def taken(self, unit: str, known: str) -> Clock:
        """It as the clock, in this unit."""
        rate, si = "", getattr(parse_unit("time", unit), "si", None)
        if si and len(np.unique(self.values)) >= len(self.values) // 2:  # else what is counted along them gives the rate
            rate = f": {1 / (self.step * si * NS):.5g} Hz"
        what = f"is taken for {'intervals, which are added up' if self.intervals else 'the clock'}"
        in_unit = "as a time of day" if self.is_clock else f"in {unit} {known}"
        return Clock(self.column, unit, known, f"{self.name!r} {what}, {in_unit}{rate}")


def find_clock(
    rows: Sequence[Sequence[str]],
    names: Sequence[str],
    read: Collection[int],
    odr_hz: float | None,
    stated: str | None,
    where: str,
    before: Sequence[str] = (),
) -> Clock | None:
    """The clock among the columns that are not ``read``, by the first rows' cells; None where no column rises as a clock does.

    odr_hz: the declared rate; stated: the unit, where the person gives it; before: lines before the rows.  QuestionsError names the column
    where it is open whether it is the clock, or in which unit; FormatError names several that may be it, and one whose stamps have
    too few digits.
    """
    left = [column for column in range(max(map(len, rows), default=0)) if column not in read]
    if (pair := _pair(rows, names, left)) is not None:
        return pair
    found = [each for column in left if (each := _candidate(rows, column, names)) is not None]
    found = [each for each in found if each.named] or found
    if any(not each.intervals for each in found):
        found = [each for each in found if not each.intervals]
    if odr_hz is None and (not found or len(np.unique(found[0].values)) <= FEW_STAMPS):
        _refuse_few_digits(rows, names, left, where)
    if not found:
        return None
    found.sort(key=lambda each: (each.unit is None, -len(np.unique(each.values)), TIME.get(each.unit or "s", 0)))
    best = found[0]
    if stated is not None:
        if len(found) > 1 and best.unit is None:
            raise FormatError(
                f"{where}: {' and '.join(repr(each.name) for each in found[:4])} rise; name the clock, --columns t_{stated}=NAME,…"
            )
        return best.taken(stated, GIVEN)
    if best.unit is not None:
        return best.taken(best.unit, BY_NAME)
    rates = {unit: 1 / (best.step * TIME[unit] * NS) for unit in ("s", "ms", "us", "ns")} if best.named else {}
    if odr_hz:
        declared = next((unit for unit, hz in rates.items() if abs(math.log(hz / odr_hz)) <= math.log(RATE_WITHIN)), None)
        if declared is not None:
            return best.taken(declared, f"as {odr_hz:g} Hz are declared")
        if best.numbers_rows:
            return None
        units: list[str] = []
    else:
        units = [unit for unit, hz in rates.items() if SENSORS_HZ[0] <= hz <= SENSORS_HZ[1]]
        dated = [unit for unit in units if DATES_S[0] <= best.begins * TIME[unit] * NS <= DATES_S[1]]
        if len(dated) == 1 and not best.intervals:
            return best.taken(dated[0], BY_DATE)
        header_hz = rate_in(before)
        near = [unit for unit in units if header_hz and abs(math.log(rates[unit] / header_hz)) <= math.log(RATE_WITHIN)]
        if len(near) == 1 < len(units):
            return best.taken(near[0], f"as {header_hz:g} Hz stand before its rows")
    if best.numbers_rows:
        what = f"whether its column {best.name!r}, which rises by 1 a row, numbers the rows or is the clock"
        question = Question(what, "--odr HZ", "the true data rate, if it numbers them; else --time-unit ms, us, …")
    elif len(units) == 1:
        return best.taken(units[0], BY_RATE)
    elif units:
        listed = " or ".join(f"{measured(rates[unit])} Hz in {unit}" for unit in units)
        pace = f"holds intervals of {measured(best.step)}" if best.intervals else f"rises by {measured(best.step)} a row"
        what = f"the unit of its clock {best.name!r}, which {pace}: {listed}"
        question = Question(what, "--time-unit", f"{' or '.join(units)}; or --odr HZ, about the rate", tuple(units))
    else:
        what = f"whether the column {best.name!r}, which rises steadily by {measured(best.step)} a row, is its clock, and in which unit"
        question = Question(what, "--time-unit", "s, ms, us, ns or a multiple, or none with --odr HZ if it is none")
    raise QuestionsError(where, "", [question])


def rate_in(lines: Sequence[str]) -> float | None:
    """The one data rate that lines before a log's rows state: ``Update Rate: 100.0Hz``, ``odr_hz=104``; None for none and for several."""
    found = {float(match[1]) for line in lines if "hz" in line.lower() and (match := RATE.search(line))}
    return next(iter(found)) or None if len(found) == 1 else None


def _refuse_few_digits(rows: Sequence[Sequence[str]], names: Sequence[str], left: Sequence[int], where: str) -> None:
    """FormatError where a column with a clock's name stands still, or nearly, at a large number."""
    for column in left:
        name = names[column] if column < len(names) else ""
        cells = [row[column].strip() for row in rows if column < len(row)]
        unit, named, _ = _states(name)
        if len(cells) < LEAST_ROWS or not named or ":" in cells[0]:
            continue
        with suppress(ValueError):
            values = np.unique(np.array([float(cell) for cell in cells]))
            step = float(np.diff(values).min()) if len(values) > 1 else float(np.spacing(np.float32(values[0])))
            if len(values) > FEW_STAMPS or abs(values[0]) < LARGE or (len(values) > 1 and step < SEVERAL):
                continue
            of_float = len(values) > 1 or (step >= SEVERAL and np.float32(values[0]) == values[0] and "e" not in cells[0].lower())
            in_s = unit is None and DATES_S[0] <= values[0] <= DATES_S[1]
            steps = f" (steps of {step:g} {'s' if in_s else unit or 'units'})" if of_float else ""
            raise FormatError(
                f"{where}: the stamps {name!r} have too few digits: {cells[0]} stands for {cells.count(cells[0])} rows{steps}; write at "
                "least milliseconds, or count samples: --odr HZ"
            )


def _words(name: str) -> list[str]:
    """``field.header.stampSecs [ns]``: its words, in small letters."""
    return re.findall(r"[a-zµμδ]+", re.sub(r"([a-zµμ])([A-Z])", r"\1 \2", name).lower())


def _states(name: str) -> tuple[str | None, bool, bool]:
    """The unit that a column's name states, whether it is a clock's name, and whether one of intervals."""
    words = _words(name)
    stated = [UNITS[word] for word in words if word in UNITS]
    intervals = bool(set(words) & set(INTERVALS)) or {"d", "t"} <= set(words)
    return stated[-1] if stated else None, bool(stated or set(words) & set(CLOCKS)), intervals


def is_named_clock(name: str) -> bool:
    """Whether a column's name is a clock's, or a date's."""
    return _states(name)[1] or "date" in _words(name)


def _exact(rows: Sequence[Sequence[str]], column: int) -> list[int] | None:
    """Cells in billionths of their unit, or of a second of times of day; None where they are no numbers and no times.  A row or two may be
    another program's words."""
    found, missing = [], 0
    for row in rows:
        try:
            cell = row[column]
            found.append(exact_ns(cell if "," not in cell else cell.replace(",", "."), NS_PER_S))
        except (IndexError, ValueError):
            missing += 1
    return None if len(found) < 2 or missing > len(rows) // LEAST_ROWS else found


def holds_intervals(rows: Sequence[Sequence[str]], column: int, names: Sequence[str]) -> bool:
    """Whether a column holds the time since the row before: by its name, and as it does not rise."""
    exact = _exact(rows, column) if column < len(names) and _states(names[column])[2] else None
    return exact is not None and min(exact) >= 0 and any(b <= a for a, b in pairwise(exact))


def _candidate(rows: Sequence[Sequence[str]], column: int, names: Sequence[str]) -> _Candidate | None:
    name = names[column] if column < len(names) and names[column] else f"column {column + 1}"
    unit, named, of_intervals = _states(name)
    exact = _exact(rows, column)
    if exact is None or (not named and not of_intervals and (set(_words(name)) & set(COUNTERS) or len(exact) < LEAST_ROWS)):
        return None
    is_clock = any(":" in row[column] for row in rows[:1] if column < len(row))
    if holds_intervals(rows, column, names):
        total = list(accumulate(exact))
        values = np.array([(value - total[0]) / NS_PER_S for value in total])
        return _Candidate(column, name, True, unit, 0.0, values, intervals=True) if values[-1] > 0 else None
    if max(map(abs, exact)) >= ERA_NS:  # no counter has so many digits
        values = np.array([(value - exact[0]) / NS_PER_S for value in exact])
    else:  # put right and carried on as the reader does
        stamps = np.array(exact)
        bad = bad_stamps(stamps)
        stamps[bad] = (stamps[bad - 1] + stamps[bad + 1]) // 2
        stamps = Unroll(DAY_NS if is_clock else COUNTER * NS_PER_S, None if is_clock else NS_PER_S)(stamps)
        values = (stamps - stamps[0]) / NS_PER_S
    steps = np.diff(values)
    if steps.min() < 0 or values[-1] <= 0:
        return None
    usual = float(np.median(steps))
    if not named and (usual <= 0 or (steps == 1).all() or np.abs(np.percentile(steps, (5, 95)) - usual).max() > STEADY_WITHIN * usual):
        return None  # it numbers the rows, or it is no clock
    return _Candidate(column, name, named or is_clock, "s" if is_clock else unit, exact[0] / NS_PER_S, values, is_clock)


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
            BY_NAME,
            f"{pair[0]!r} and {pair[1]!r} are taken for the clock, in s and {fine} by their names",
            (units[fine], TIME[fine]),
        )
    return None
