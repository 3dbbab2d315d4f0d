"""Lines of a table into numbers and stamps, or what is wrong with which line."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from itertools import repeat
from typing import Literal

import numpy as np
from numpy.typing import DTypeLike

from session.base.units import beyond_any_sensor, complaint
from session.log.clock import exact_ns
from session.log.dialects import Layout
from session.log.stamps import ERA_NS

#: whole numbers up to here survive a float64
EXACT = 2**53
#: stamps up to here, 13 days, are right to the nanosecond when a float64 of their unit is multiplied: the error stays below a quarter
CLOSE_NS = 2**50
#: whole numbers that a column can hold
INT64 = (-(2**63), 2**63 - 1)
#: what a line without a reading consists of, as a spreadsheet saves an empty row
EMPTY = ' \t\r,;"'
OPEN = "a quotation mark that is not closed"
CORRECT = "correct or remove that line"


class RowFault(Exception):
    """A row, counted without blanks and comments, can be read but cannot be: what is wrong, and what to do."""

    def __init__(self, row: int, what: str, do: str = CORRECT):
        super().__init__(what)
        self.row, self.what, self.do = row, what, do


def parse(lines: list[str], layout: Layout, unsigned: set[str] | None = None) -> tuple[np.ndarray, np.ndarray | None]:
    """Numbers (N, ``layout.numbers``) as written, and stamps (N,) int64 ns as written, or None where there are none.

    unsigned: kinds whose registers are known to be unsigned, to which those are added that are found to be; they become signed.
    Raises RowFault, and ValueError where a line cannot be read: ``fault`` says why.
    """
    if not any(line.lstrip()[:1] not in ("", "#") for line in lines):
        return np.zeros((0, len(layout.numbers))), None
    if not layout.standard and '"' in "".join(lines) and any(map(_opens, lines)):
        raise ValueError(OPEN)  # NumPy would read on to the next quotation mark, over however many lines
    if layout.finer:
        table, time = _load(lines, layout.numbers, layout, np.float64), _summed(lines, layout)
    elif layout.time is None or layout.clock:
        table, time = _load(lines, layout.numbers, layout, np.float64), None
    else:
        table, time = _with_time(lines, layout)
    _make_signed(table, layout, set() if unsigned is None else unsigned)
    _refuse_impossible(table, time, layout)
    if layout.finer and time is not None:
        return table, time
    return table, None if layout.time is None else _stamps(time, lines, layout)


def _opens(line: str) -> bool:
    """Whether a cell begins with a quotation mark, and one is not closed in its line."""
    return '"' in line and (line := line.split("#")[0]).count('"') % 2 == 1 and re.search(r'(?:^|[,;\t ])"', line) is not None


def _load(lines: list[str], columns: tuple[int, ...], layout: Layout, kind: DTypeLike, dimensions: Literal[1, 2] = 2) -> np.ndarray:
    quote = None if layout.standard else '"'
    return np.loadtxt(lines, dtype=kind, delimiter=layout.delimiter, comments="#", quotechar=quote, usecols=columns, ndmin=dimensions)


def _with_time(lines: list[str], layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (N, …) and times (N,) in their unit.  One type for all columns is twice as fast as a type for each."""
    whole = [layout.is_whole(column) for column in layout.used]
    if all(whole):
        rows = _load(lines, layout.used, layout, np.int64)
        return rows[:, 1:], rows[:, 0]
    if not layout.standard and _looks_whole(lines, layout):
        with contextlib.suppress(ValueError):  # the others need not be
            return _with_whole_time(lines, layout)
    if layout.standard and layout.time_ns == 1:
        table, time = _with_whole_time(lines, layout)
    else:
        rows = _load(lines, layout.used, layout, np.float64)
        table, time = rows[:, 1:], rows[:, 0]
        if whole[0]:
            _require_whole(time)
    for place, is_whole in enumerate(whole[1:]):
        if is_whole:
            _require_whole(table[:, place])
    return table, time


def _summed(lines: list[str], layout: Layout) -> np.ndarray:
    """(N,) int64 ns of a time in several columns, whole seconds and their fraction.  RowFault where a fraction is more than the unit
    before it."""
    columns, units = (layout.time_column, *(column for column, _ in layout.finer)), (layout.time_ns, *(ns for _, ns in layout.finer))
    try:
        parts = _load(lines, columns, layout, np.int64)
    except ValueError:  # fractions: exactly, from their text
        texts = _load(lines, columns, layout, "U48").tolist()
        exact = np.array([sum(exact_ns(text, ns) for text, ns in zip(row, units, strict=True)) for row in texts], dtype=object)
        _require_era(np.abs(exact) < ERA_NS, lambda row: " + ".join(texts[row]), layout)
        return exact.astype(np.int64)
    for place, (column, unit_ns) in enumerate(layout.finer, start=1):
        most = units[place - 1] // unit_ns
        if most > 1 and not (fine := (parts[:, place] >= 0) & (parts[:, place] < most)).all():
            row = int(np.argmin(fine))
            raise RowFault(row, f"{layout.name(column)} is {parts[row, place]}, expected a second's fraction from 0 to {most - 1}")
    fine = np.all([np.abs(part) < ERA_NS // ns // len(units) for part, ns in zip(parts.T, units, strict=True)], axis=0)
    _require_era(fine, lambda row: " + ".join(map(str, parts[row])), layout)
    return np.asarray(parts @ np.array(units))


def _with_whole_time(lines: list[str], layout: Layout) -> tuple[np.ndarray, np.ndarray]:
    """Times as int64, since those in ns do not fit a float64."""
    names = np.dtype([("time", np.int64), *((f"c{place}", np.float64) for place in range(len(layout.numbers)))])
    rows = _load(lines, layout.used, layout, names, dimensions=1)
    return rows.view(np.float64).reshape(len(rows), -1)[:, 1:], rows["time"]


def _looks_whole(lines: list[str], layout: Layout) -> bool:
    """Whether the first row's time is a whole number."""
    row = next(line for line in lines if line.lstrip()[:1] not in ("", "#")).split(layout.delimiter)
    column = layout.time_column
    return column < len(row) and re.fullmatch(r"[-+]?[0-9]+", row[column].strip().strip('"')) is not None


def _require_whole(values: np.ndarray) -> None:
    if (np.rint(values) != values).any() or not (np.abs(values) < ERA_NS).all():
        raise ValueError("a fraction, or more than 64 bits, where a whole number belongs")


def _stamps(time: np.ndarray | None, lines: list[str], layout: Layout) -> np.ndarray:
    """(N,) int64 ns.  RowFault for what is no time of this era."""
    if time is not None and time.dtype == np.int64:
        last = ERA_NS // layout.time_ns
        _require_era((time > -last) & (time < last), lambda row: time[row], layout)
        unit = layout.time_ns
        return time * unit if isinstance(unit, int) else np.rint(time * unit).astype(np.int64)
    if time is not None:
        largest = np.abs(time).max()
        if largest < CLOSE_NS / layout.time_ns:
            return np.rint(time * layout.time_ns).astype(np.int64)
        if layout.standard:
            _require_era(np.abs(time) < ERA_NS // layout.time_ns, lambda row: time[row], layout)
        if layout.is_whole(layout.time_column) and largest < EXACT:
            return np.asarray(time.astype(np.int64) * layout.time_ns)
    # A float64 would round these: text to integers, exactly.
    texts = _load(lines, (layout.time_column,), layout, "U48")[:, 0].tolist()
    exact = np.array([exact_ns(text, layout.time_ns) for text in texts], dtype=object)
    _require_era(np.abs(exact) < ERA_NS, lambda row: texts[row][:20], layout)
    return exact.astype(np.int64)


def _require_era(fine: np.ndarray, value: Callable[[int], object], layout: Layout) -> None:
    if not fine.all():
        row = int(np.argmin(fine))
        raise RowFault(row, f"{layout.name(layout.time_column)} is {value(row)}, which is no time of this era")


#: counts of a register of 16 bits; times as far as other readings that a glitch jumps
SPAN, GLITCH = 1 << 16, 4


def _make_signed(table: np.ndarray, layout: Layout, unsigned: set[str]) -> None:
    """Registers of 16 bits that were written as 0 … 65535 become -32768 … 32767, in place."""
    for kind, places, unit in layout.kinds:
        own = [layout.numbers.index(column) for column in places]
        values = table[:, own]
        high = values >= SPAN // 2
        if unit.si is not None or not high.any() or not ((values >= 0) & (values < SPAN)).all():
            continue
        signed = np.where(high, values - SPAN, values)
        if kind in unsigned or _smoother(signed, values):  # by one reading already: of pieces, the first may hold no more
            unsigned.add(kind)
            table[:, own] = signed


def _smoother(signed: np.ndarray, values: np.ndarray) -> bool:
    """Whether readings (N, …) go on better, or are nearer to zero where both do alike, than as offset binary, whose zero is in the
    middle; none jumps through zero as a glitch does, several times as far as any other, and beyond the lower byte."""
    jumps, others = (np.abs(np.diff(each, axis=0)) for each in (signed, values))
    across = (signed[1:] < 0) != (signed[:-1] < 0)
    if jumps.max(initial=0, where=across) > max(GLITCH * jumps.max(initial=0, where=~across), 1 << 8):
        return False
    return bool(jumps.sum() < others.sum() or np.abs(signed).mean() < np.abs(values - SPAN // 2).mean())


def _refuse_impossible(table: np.ndarray, time: np.ndarray | None, layout: Layout) -> None:
    """RowFault for what is no number, no register, or nothing that a sensor measures."""
    columns = list(zip(layout.numbers, table.T, strict=True))
    for column, values in [*([] if time is None else [(layout.time_column, time)]), *columns]:
        if values.dtype == np.float64 and not (fine := np.isfinite(values)).all():
            row = int(np.argmin(fine))
            raise RowFault(row, f"{layout.name(column)} is {values[row]}, expected a finite number", "remove that line")
        if column != layout.time and layout.is_register(column) and not (fine := np.abs(values + 0.5) < 32768).all():
            row = int(np.argmin(fine))
            do = "units belong in the header (gx_dps, ax_g)" if layout.standard else "is its unit right?"
            raise RowFault(row, f"{layout.name(column)} is {values[row]:.15g}, no 16-bit register value", do)
    table_of = dict(columns)
    for kind, places, unit in layout.kinds:
        if unit.si is None:
            continue
        for column in places:
            if (far := beyond_any_sensor(table_of[column], unit.si, kind)).any():
                row = int(np.argmax(far))
                raise RowFault(row, *complaint(layout.name(column), table_of[column][row], kind).rsplit("; ", 1))


def fault(line: str, layout: Layout) -> str | None:
    """What is wrong with a line, by itself; None where nothing is."""
    cells = [cell.strip() for cell in line.split("#")[0].split(layout.delimiter)]
    if not layout.standard and _opens(line):
        return OPEN
    if not layout.standard:
        cells = [cell.strip('"') for cell in cells]
    if len(cells) <= max(layout.used):
        return f"{len(cells)} columns, expected {len(layout.names)}"
    return next(filter(None, (_cell_fault(cells[column], column, layout) for column in layout.used)), None)


def _cell_fault(cell: str, column: int, layout: Layout) -> str | None:
    whole, says = layout.is_whole(column), f"{layout.name(column)} is {cell[:20]!r}"
    if whole and re.fullmatch(r"[-+]?[0-9]+", cell):
        if len(cell) > 1000 or not INT64[0] <= int(cell) <= INT64[1]:
            return f"{says}{'…' if len(cell) > 20 else ''}, a number too long for any register or stamp"
        return None
    try:
        if whole or "_" in cell:  # Python reads 1_000, and numpy does not
            raise ValueError
        if column == layout.time and not layout.standard:
            exact_ns(cell, layout.time_ns)
        else:
            float(cell)
    except (ValueError, OverflowError):
        return f"{says}, expected {'a whole number' if whole else 'a number'}"
    return None


def wrong_width(lines: list[str], layout: Layout) -> int | None:
    """The first row that has more cells than the header has names, and something in them, or fewer; None where none has.

    numpy reads the columns that are wanted, and does not see that a cell is missing before them.
    """
    mark, names = layout.delimiter, layout.names
    while names and not names[-1]:
        names = names[:-1]
    if mark is None or not layout.header_line or (layout.standard and max(layout.used) == len(names) - 1):
        return None
    counts = [marks + 1 for marks in map(str.count, lines, repeat(mark))]
    if set(counts) == {len(names)}:
        return None
    for number, (line, count) in enumerate(zip(lines, counts, strict=True)):
        if count == len(names) or not line.strip(EMPTY) or '"' in line or "#" in line or line.strip() == layout.header_line:
            continue
        if count < len(names) or any(cell.strip() for cell in line.split(mark)[len(layout.names) :]):
            return number
    return None


def unreadable(lines: list[str], layout: Layout) -> int | None:
    """The first line that numpy cannot take, whatever the reason; None where it takes all of them."""

    def readable(part: list[str]) -> bool:
        try:
            parse(part, layout)
        except ValueError:
            return False
        except RowFault:
            pass
        return True

    if readable(lines):
        return None
    good, bad = 0, len(lines)
    while bad - good > 1:
        middle = (good + bad) // 2
        if readable(lines[good:middle]):
            good = middle
        else:
            bad = middle
    return good
