"""Lines of a log into numbers and stamps, or what is wrong with which line."""

from __future__ import annotations

import re
from collections.abc import Callable
from itertools import repeat
from typing import Literal

import numpy as np
from numpy.typing import DTypeLike

from session.base.units import beyond_any_sensor, complaint
from session.log.layout import Layout
from session.log.stamps import ERA_NS, decimal_ns

#: whole numbers up to here survive a float64
EXACT = 2**53
#: stamps up to here, 13 days, are right to the nanosecond when a float64 of their unit is multiplied: the error stays below a quarter
CLOSE_NS = 2**50
#: whole numbers that a column can hold
INT64 = (-(2**63), 2**63 - 1)
#: what a line without a reading consists of, as a spreadsheet saves an empty row
EMPTY = ' \t\r,;"'
CORRECT = "correct or remove that line"


class RowFault(Exception):
    """A row, counted without blanks and comments, can be read but cannot be: what is wrong, and what to do."""

    def __init__(self, row: int, what: str, do: str = CORRECT):
        super().__init__(what)
        self.row, self.what, self.do = row, what, do


def has_rows(lines: list[str]) -> bool:
    """Whether any line is neither blank nor a comment."""
    return any(line.lstrip()[:1] not in ("", "#") for line in lines)


def parse(lines: list[str], layout: Layout, unsigned: set[str] | None = None) -> tuple[np.ndarray, np.ndarray | None]:
    """Numbers (N, ``layout.numbers``) as written, and stamps (N,) int64 ns as written, or None where there is no row.

    unsigned: kinds whose registers are known to be unsigned, to which those are added that are found to be; they become signed.
    Raises RowFault, and ValueError where a line cannot be read: ``fault`` states why.
    """
    if not has_rows(lines):
        return np.zeros((0, len(layout.numbers))), None
    whole = [layout.is_whole(column) for column in layout.used]
    if all(whole):
        rows = load(lines, layout.used, layout, np.int64)
        table, time = rows[:, 1:], rows[:, 0]
    elif layout.time_ns == 1:
        table, time = with_whole_time(lines, layout)
    else:
        rows = load(lines, layout.used, layout, np.float64)
        table, time = rows[:, 1:], rows[:, 0]
        if whole[0]:
            _require_whole(time)
    for place, is_whole in enumerate(whole[1:]):
        if is_whole:
            _require_whole(table[:, place])
    make_sound(table, time, layout, set() if unsigned is None else unsigned, "units belong in the header (gx_dps, ax_g)")
    if time.dtype == np.float64:
        require_era(np.abs(time) < ERA_NS // layout.time_ns, lambda row: time[row], layout)
    return table, stamps_of(time, lines, layout, decimal_ns)


def load(
    lines: list[str], columns: tuple[int, ...], layout: Layout, kind: DTypeLike, dimensions: Literal[1, 2] = 2, quote: str | None = None
) -> np.ndarray:
    """The columns of rows as numbers, (N, columns), or (N,) of a structured type in one dimension."""
    return np.loadtxt(lines, dtype=kind, delimiter=layout.delimiter, comments="#", quotechar=quote, usecols=columns, ndmin=dimensions)


def with_whole_time(lines: list[str], layout: Layout, quote: str | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (N, …), and times (N,) as int64, since those in ns do not fit a float64."""
    names = np.dtype([("time", np.int64), *((f"c{place}", np.float64) for place in range(len(layout.numbers)))])
    rows = load(lines, layout.used, layout, names, 1, quote)
    return rows.view(np.float64).reshape(len(rows), -1)[:, 1:], rows["time"]


def _require_whole(values: np.ndarray) -> None:
    if (np.rint(values) != values).any() or not (np.abs(values) < ERA_NS).all():
        raise ValueError("a fraction, or more than 64 bits, where a whole number belongs")


def stamps_of(
    time: np.ndarray | None, lines: list[str], layout: Layout, exact: Callable[[str, float], int], quote: str | None = None
) -> np.ndarray:
    """(N,) int64 ns of times (N,) in their unit; exact: ns of a time's text, where a float64 would round.  RowFault for what is no time
    of this era."""
    unit = layout.time_ns
    if time is not None and time.dtype == np.int64:
        last = ERA_NS // unit
        require_era((time > -last) & (time < last), lambda row: time[row], layout)
        return time * unit if isinstance(unit, int) else np.rint(time * unit).astype(np.int64)
    if time is not None:
        largest = np.abs(time).max()
        if largest < CLOSE_NS / unit:
            return np.rint(time * unit).astype(np.int64)
        if layout.is_whole(layout.time_column) and largest < EXACT:
            return np.asarray(time.astype(np.int64) * unit)
    texts = load(lines, (layout.time_column,), layout, "U48", quote=quote)[:, 0].tolist()
    values = np.array([exact(text, unit) for text in texts], dtype=object)
    require_era(np.abs(values) < ERA_NS, lambda row: texts[row][:20], layout)
    return values.astype(np.int64)


def require_era(fine: np.ndarray, value: Callable[[int], object], layout: Layout) -> None:
    """RowFault for the first row that is not fine (N,)."""
    if not fine.all():
        row = int(np.argmin(fine))
        raise RowFault(row, f"{layout.name(layout.time_column)} is {value(row)}, which is no time of this era")


#: counts of a register of 16 bits; times as far as other readings that a glitch jumps
SPAN, GLITCH = 1 << 16, 4


def make_sound(table: np.ndarray, time: np.ndarray | None, layout: Layout, unsigned: set[str], do: str) -> None:
    """Make unsigned registers signed, in place; RowFault for what is no number, no register, or nothing that a sensor measures; do: what
    to do where a number is no register."""
    _make_signed(table, layout, unsigned)
    columns = list(zip(layout.numbers, table.T, strict=True))
    for column, values in [*([] if time is None else [(layout.time_column, time)]), *columns]:
        if values.dtype == np.float64 and not (fine := np.isfinite(values)).all():
            row = int(np.argmin(fine))
            raise RowFault(row, f"{layout.name(column)} is {values[row]}, expected a finite number", "remove that line")
        if column != layout.time and layout.is_register(column) and not (fine := np.abs(values + 0.5) < 32768).all():
            row = int(np.argmin(fine))
            raise RowFault(row, f"{layout.name(column)} is {values[row]:.15g}, no 16-bit register value", do)
    table_of = dict(columns)
    for kind, places, unit in layout.kinds:
        if unit.si is None:
            continue
        for column in places:
            if (far := beyond_any_sensor(table_of[column], unit.si, kind)).any():
                row = int(np.argmax(far))
                raise RowFault(row, *complaint(layout.name(column), table_of[column][row], kind).rsplit("; ", 1))


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


def fault(line: str, layout: Layout, time_of: Callable[[str], object] = float) -> str | None:
    """What is wrong with a line, by itself; None where nothing is.  time_of: reads a time that may have a fraction."""
    cells = [cell.strip() for cell in line.split("#")[0].split(layout.delimiter)]
    if len(cells) <= max(layout.used):
        return f"{len(cells)} columns, expected {len(layout.names)}"
    return next(filter(None, (_cell_fault(cells[column], column, layout, time_of) for column in layout.used)), None)


def _cell_fault(cell: str, column: int, layout: Layout, time_of: Callable[[str], object]) -> str | None:
    whole, cell_text = layout.is_whole(column), f"{layout.name(column)} is {cell[:20]!r}"
    if whole and re.fullmatch(r"[-+]?[0-9]+", cell):
        if len(cell) > 1000 or not INT64[0] <= int(cell) <= INT64[1]:
            return f"{cell_text}{'…' if len(cell) > 20 else ''}, a number too long for any register or stamp"
        return None
    try:
        if whole or "_" in cell:  # Python reads 1_000, and numpy does not
            raise ValueError
        (time_of if column == layout.time else float)(cell)
    except (ValueError, OverflowError):
        return f"{cell_text}, expected {'a whole number' if whole else 'a number'}"
    return None


def wrong_width(lines: list[str], layout: Layout) -> int | None:
    """The first row that has more cells than the header has names, and something in them, or fewer; None where none has.

    numpy reads the columns that are wanted, and does not see that a cell is missing before them.
    """
    mark, names = layout.delimiter, layout.names
    while names and not names[-1]:
        names = names[:-1]
    if mark is None or not layout.header_line:
        return None
    if set(map(str.count, lines, repeat(mark))) == {len(names) - 1}:
        return None
    for number, line in enumerate(lines):
        count = line.count(mark) + 1
        if count == len(names) or not line.strip(EMPTY) or '"' in line or "#" in line or line.strip() == layout.header_line:
            continue
        if count < len(names) or any(cell.strip() for cell in line.split(mark)[len(layout.names) :]):
            return number
    return None


def unreadable(lines: list[str], parsed: Callable[[list[str]], object]) -> int | None:
    """The first line that ``parsed`` cannot take, whatever the reason; None where it takes all of them."""

    def readable(part: list[str]) -> bool:
        try:
            parsed(part)
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
