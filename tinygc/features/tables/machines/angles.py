"""``table.csv``: what a machine said of its angles during a recording, and when (docs/formats/tables.md).

    log,t_us,table_s,moving,<axis>_deg,...

log: the log that was being written; t_us: the board's device time in the middle between question and answer, by the arrivals of its
samples, so it is off by an unknown latency of some milliseconds; table_s: the machine's own clock, empty where it has none; moving: 0 or
1.  It is appended to, row by row: nothing that was recorded is lost.
"""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.units import DEG, NS
from session.log.logfile import rows_of
from tinygc.features.tables.machines.description import Description

NAME = "table.csv"
COLUMNS = ("log", "t_us", "table_s", "moving")
#: answers that show how a machine's clock goes; how far it may go from the board's, as a share
FEWEST_ANSWERS, MOST_DRIFT = 20, 0.05
#: 40 hours at 50 Hz
MOST_ROWS = 8_000_000


@dataclass(frozen=True, eq=False)
class AngleLog:
    """Answers during one log: t_ns (N,) int64 device time, never decreasing; table_s (N,), NaN where the machine has no clock; moving
    (N,) bool; angles (N, K) rad."""

    log: str
    t_ns: np.ndarray
    table_s: np.ndarray
    moving: np.ndarray
    angles: np.ndarray


def header(table: Description) -> str:
    """The first line of ``table.csv``."""
    return ",".join((*COLUMNS, *(f"{axis.name}_deg" for axis in table.axes)))


def row(log: str, t_us: int, table_s: float | None, moving: bool, angles: np.ndarray) -> str:
    """One line, without its end."""
    clock = "" if table_s is None else f"{table_s:.6f}"
    return f"{log},{t_us},{clock},{int(moving)}," + ",".join(f"{angle:.6f}" for angle in (np.asarray(angles) / DEG).tolist())


def read_angles(path: Path, table: Description) -> dict[str, AngleLog]:
    """Answers of each log, by its name.  Raises FormatError, which names the line."""
    lines = rows_of(path)
    expected = header(table)
    if next(lines, (0, ""))[1].strip() != expected:
        raise FormatError(f"{path.name}: the header must be {expected}, the axes of table.toml in their order")
    found: dict[str, list[tuple[float, ...]]] = {}
    for number, line in lines:
        if number > MOST_ROWS:
            raise FormatError(f"{path.name} line {number}: more than {MOST_ROWS} rows; is it the right file?")
        cells = next(csv.reader([line]))
        try:
            t_us, clock, moving = int(cells[1]), float(cells[2] or "nan"), {"0": 0.0, "1": 1.0}[cells[3]]
            angles = [float(cell) for cell in cells[4:]]
        except (ValueError, IndexError, KeyError, OverflowError):
            angles = []
        if len(angles) != len(table.axes) or not all(map(math.isfinite, angles)) or not 0 <= t_us < 2**53:
            raise FormatError(f"{path.name} line {number}: {line[:60]!r}, expected {expected}")
        found.setdefault(cells[0], []).append((t_us, clock, moving, *angles))
    return {log: _log(path.name, log, rows) for log, rows in found.items()}


def on_its_clock(word: AngleLog) -> AngleLog:
    """The same answers, at the times of the machine's own clock where it has one: a line through the stamps takes out their jitter.

    A stamp is that of the last sample before the answer, so it is early by half a sample on average, and the line with it.
    """
    known = np.isfinite(word.table_s)
    if known.sum() < FEWEST_ANSWERS or not known.all() or np.ptp(word.table_s) <= 0:
        return word
    t_s = (word.t_ns - word.t_ns[0]) * NS
    slope, offset = np.polyfit(word.table_s, t_s, 1)
    if abs(slope - 1) > MOST_DRIFT:  # no clock in seconds
        return word
    times = word.t_ns[0] + np.rint((slope * word.table_s + offset) / NS).astype(np.int64)
    return replace(word, t_ns=np.maximum.accumulate(times))


def _log(name: str, log: str, rows: list[tuple[float, ...]]) -> AngleLog:
    table = np.array(rows)
    t_ns = table[:, 0].astype(np.int64) * 1000
    if (np.diff(t_ns) < 0).any():
        raise FormatError(f"{name}: t_us of {log} goes backward at {int(table[int(np.argmax(np.diff(t_ns) < 0)) + 1, 0])}")
    return AngleLog(log, t_ns, table[:, 1], table[:, 2] > 0, table[:, 3:] * DEG)
