"""Lines of any program's table into numbers and stamps: cells in quotes, clocks, seconds in several columns."""

from __future__ import annotations

import contextlib
import re

import numpy as np

from session.log import numbers
from session.log.numbers import RowFault, has_rows, load, make_sound, require_era, stamps_of, with_whole_time
from session.log.stamps import ERA_NS
from session.replay.clock import exact_ns
from session.replay.dialects import TableLayout

QUOTE = '"'
OPEN = "a quotation mark that is not closed"


def parse(lines: list[str], layout: TableLayout, unsigned: set[str] | None = None) -> tuple[np.ndarray, np.ndarray | None]:
    """As ``session.log.numbers.parse``; no stamps where nothing stamps the rows."""
    if not has_rows(lines):
        return np.zeros((0, len(layout.numbers))), None
    if QUOTE in "".join(lines) and any(map(_opens, lines)):
        raise ValueError(OPEN)  # NumPy would read on to the next quotation mark, over however many lines
    if layout.finer:
        table, time = load(lines, layout.numbers, layout, np.float64, quote=QUOTE), _summed(lines, layout)
    elif layout.time is None or layout.clock:
        table, time = load(lines, layout.numbers, layout, np.float64, quote=QUOTE), None
    else:
        table, time = _with_time(lines, layout)
    make_sound(table, time, layout, set() if unsigned is None else unsigned, "is its unit right?")
    if layout.time is None or layout.finer:
        return table, time
    return table, stamps_of(time, lines, layout, exact_ns, QUOTE)


def _opens(line: str) -> bool:
    """Whether a cell begins with a quotation mark, and one is not closed in its line."""
    return QUOTE in line and (line := line.split("#")[0]).count(QUOTE) % 2 == 1 and re.search(r'(?:^|[,;\t ])"', line) is not None


def _with_time(lines: list[str], layout: TableLayout) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (N, …) and times (N,) in their unit, whole where the first row's is."""
    row = next(line for line in lines if line.lstrip()[:1] not in ("", "#")).split(layout.delimiter)
    column = layout.time_column
    if column < len(row) and re.fullmatch(r"[-+]?[0-9]+", row[column].strip().strip(QUOTE)):
        with contextlib.suppress(ValueError):  # the others need not be
            return with_whole_time(lines, layout, QUOTE)
    rows = load(lines, layout.used, layout, np.float64, quote=QUOTE)
    return rows[:, 1:], rows[:, 0]


def _summed(lines: list[str], layout: TableLayout) -> np.ndarray:
    """(N,) int64 ns of a time in several columns, whole seconds and their fraction.  RowFault where a fraction is more than the unit
    before it."""
    columns, units = (layout.time_column, *(column for column, _ in layout.finer)), (layout.time_ns, *(ns for _, ns in layout.finer))
    try:
        parts = load(lines, columns, layout, np.int64, quote=QUOTE)
    except ValueError:  # fractions: exactly, from their text
        texts = load(lines, columns, layout, "U48", quote=QUOTE).tolist()
        exact = np.array([sum(exact_ns(text, ns) for text, ns in zip(row, units, strict=True)) for row in texts], dtype=object)
        require_era(np.abs(exact) < ERA_NS, lambda row: " + ".join(texts[row]), layout)
        return exact.astype(np.int64)
    for place, (column, unit_ns) in enumerate(layout.finer, start=1):
        most = units[place - 1] // unit_ns
        if most > 1 and not (fine := (parts[:, place] >= 0) & (parts[:, place] < most)).all():
            row = int(np.argmin(fine))
            raise RowFault(row, f"{layout.name(column)} is {parts[row, place]}, expected a second's fraction from 0 to {most - 1}")
    fine = np.all([np.abs(part) < ERA_NS // ns // len(units) for part, ns in zip(parts.T, units, strict=True)], axis=0)
    require_era(fine, lambda row: " + ".join(map(str, parts[row])), layout)
    return np.asarray(parts @ np.array(units))


def fault(line: str, layout: TableLayout) -> str | None:
    """What is wrong with a line, by itself; None where nothing is."""
    if _opens(line):
        return OPEN
    return numbers.fault(line.replace(QUOTE, " "), layout, lambda cell: exact_ns(cell, layout.time_ns))
