"""Rows of several sensors in one log, which read as one sensor's would be false: found by a column that names the sensor a row is of."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise

from session.base.errors import FormatError
from session.base.texts import listed

#: names of columns that name the sensor a row is of, without what is no letter
SENSORS = (
    *("i", "inst", "instance", "imu", "imuid", "imuno", "sensor", "sensorid", "sensorno", "device", "deviceid", "dev", "unit", "id"),
    *("node", "addr", "address", "chip", "board", "bus", "side", "source", "mac", "macaddress", "name", "devicename", "sensorname"),
    *("serial", "serialno"),
)
#: more are no sensors of one log: the column counts something
MOST_SENSORS = 16
#: rows that are looked through for another sensor's
LEAST_ROWS = 8
#: of the mean step between rows: rows of one moment are closer, and rows of the next one further apart
CLOSE = 0.3


@dataclass(frozen=True)
class Form:
    """A log's columns: the file's name, delimiter (None: white space), names, columns that are read, the header's line."""

    file: str
    delimiter: str | None
    names: tuple[str, ...]
    read: Collection[int]
    header_line: str = ""

    def rows(self, lines: Sequence[str]) -> list[str]:
        """The lines that are neither blank, nor a comment, nor the header."""
        return [line for line in lines if line.split("#")[0].strip() and line.strip() != self.header_line]

    def refuse(self, column: int, values: Sequence[str], how: str = "") -> None:
        """FormatError for a column with several of these values."""
        if len(values) > 1:
            called, some = self.names[column], listed(values, 4)
            raise FormatError(
                f"{self.file}: the column {called!r} holds {some}{how}: rows of several sensors; "
                f"give --where {called}={values[0]} to import"
            )


class Watch:
    """Refuses rows of several sensors, by a log's first rows and then piece by piece."""

    def __init__(self, lines: Sequence[str], form: Form):
        """lines: the first rows that are wanted.  Raises FormatError, which names the sensors there are and how to pick one."""
        self.form = form
        rows = form.rows(lines)
        cells = [row.split(form.delimiter) for row in rows]
        self._sensors: dict[int, str] = {}
        for column, called in enumerate(form.names):
            if column in form.read or re.sub(r"[^a-z]", "", called.lower()) not in SENSORS:
                continue
            values = list(dict.fromkeys(bare(row[column]) for row in cells if column < len(row)))
            if len(values) <= min(MOST_SENSORS, len(rows) // 2):
                form.refuse(column, values)
                self._sensors |= {column: values[0]} if values else {}

    def __call__(self, lines: list[str]) -> None:
        """Raises FormatError for rows of another sensor than the first."""
        for column, first in self._sensors.items():
            rows = (line.split(self.form.delimiter) for line in self.form.rows(lines))
            self.form.refuse(column, list(dict.fromkeys([first, *(bare(row[column]) for row in rows if column < len(row))])))


def refuse_turns(lines: Sequence[str], time: int, form: Form) -> None:
    """FormatError where rows of one moment come from several sensors in turn, distinguished by a column of any name.

    lines: a log's first; time: the column of the stamps.  The column's values come round in each group of rows that share a stamp, or
    nearly.
    """
    cells = [row.split(form.delimiter) for row in lines if row.split("#")[0].strip()]
    stamps = [_number(row[time]) if time < len(row) else None for row in cells]
    known = [stamp for stamp in stamps if stamp is not None]
    if len(known) < 2 * LEAST_ROWS or len(known) < len(cells):
        return
    steps = [b - a for a, b in pairwise(known)]
    mean = sum(steps) / len(steps)
    for column in range(len(form.names)):
        if column in form.read or column == time:
            continue
        values = [bare(row[column]) if column < len(row) else "" for row in cells]
        count = len(set(values))
        if not 2 <= count <= MOST_SENSORS or any(a != b for a, b in zip(values, values[count:], strict=False)):
            continue
        within = [step for i, step in enumerate(steps) if (i + 1) % count]
        if mean > 0 and all(step < CLOSE * mean for step in within):
            form.refuse(column, list(dict.fromkeys(values)), " in turn, at one time each")


def bare(cell: str) -> str:
    """A cell without a comment behind it and quotes around it."""
    return cell.split("#")[0].strip().strip('"').strip()


def _number(cell: str) -> float | None:
    try:
        return float(bare(cell).replace(",", "."))
    except ValueError:
        return None
