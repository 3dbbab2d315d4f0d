"""``table.csv``: what a machine reported of its angles during a recording, and when (docs/formats/tables.md); and ``attitudes.csv`` from
it.

    log,t_us,table_s,moving,<axis>_deg,...

log: the log that was being written; t_us: the board's device time in the middle between question and answer, by the arrivals of its
samples, so it is off by an unknown latency of some milliseconds; table_s: the machine's own clock, empty where it has none; moving: 0 or
1.  It is appended to, row by row: nothing that was recorded is lost.
"""

from __future__ import annotations

import csv
import math
import os
from dataclasses import dataclass, replace
from io import TextIOWrapper
from pathlib import Path

import numpy as np

from session.base.errors import FormatError, StorageError
from session.base.files import open_written, read_bytes, read_text, refuse_link, replaced
from session.base.results import write_text_whole
from session.base.units import DEG, NS
from session.bench.rawfile import put_aside
from session.detect.check_references import with_own_accelerometer
from session.detect.stills import SessionStills
from session.log.folder import ATTITUDES, read_session
from session.log.logfile import rows_of
from session.log.samples import Samples
from session.log.written import attitudes_text
from tinygc.features.tables.machines.description import NAME as TABLE
from tinygc.features.tables.machines.description import Description, attitudes, read_description, roll_pitch_yaw
from tinygc.features.tables.machines.link import Where

NAME = "table.csv"
COLUMNS = ("log", "t_us", "table_s", "moving")
#: answers that show how a machine's clock goes; how far it may go from the board's, as a share
FEWEST_ANSWERS, MOST_DRIFT = 20, 0.05
#: 40 hours at 50 Hz
MOST_ROWS, MOST_BYTES = 8_000_000, 1 << 30
#: answers in a still that differ by more of an axis's sigma are none of one attitude
SIGMAS = 5.0
#: s at both ends of a still that an answer may be late
LATE_S = 0.2


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


class AngleFile:
    """``table.csv``, appended to row by row; a line that a crash has cut is taken off.  Raises StorageError."""

    def __init__(self, path: Path, table: Description):
        self._path, self._last = path, ("", -1)
        try:
            if path.exists() and path.stat().st_size:
                text = read_bytes(path, MOST_BYTES)
                refuse_link(path)
                os.truncate(path, text.rfind(b"\n") + 1)  # a row that was cut off
                if not text.startswith(header(table).encode() + b"\n"):
                    raise StorageError(f"{path}: is of a table with other axes; give another --out")
            else:
                path.parent.mkdir(parents=True, exist_ok=True)
                with replaced(path) as file:
                    file.write(f"{header(table)}\n".encode())
            self._file = self._opened()
        except OSError as error:
            raise StorageError(f"{path}: cannot be written ({error.strerror or error})") from None

    def _opened(self) -> TextIOWrapper:
        return os.fdopen(open_written(self._path, os.O_WRONLY | os.O_APPEND | os.O_CREAT), "a", buffering=1)

    def add(self, log: str, t_us: int, where: Where) -> None:
        """Append an answer; one without a log, or with a time before the last one of its log, has no place there."""
        if not log or (log == self._last[0] and t_us < self._last[1]) or not 0 <= t_us < 2**53:
            return
        self._last = log, t_us
        try:
            self._file.write(row(log, t_us, where.table_s, where.moving, where.angles) + "\n")
        except OSError as error:
            raise StorageError(f"{self._path}: cannot be written ({error.strerror or error})") from None

    def rename(self, old: str, new: str) -> None:
        """A log has another name now."""
        self._file.close()
        lines = read_bytes(self._path, MOST_BYTES).decode().splitlines(keepends=True)
        with replaced(self._path) as file:
            file.write("".join(new + line.removeprefix(old) if line.startswith(f"{old},") else line for line in lines).encode())
        self._file = self._opened()
        self._last = (new, self._last[1]) if self._last[0] == old else self._last

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def write_attitudes(folder: Path) -> int:
    """Write ``attitudes.csv``, a row for each still that the machine's angles give the attitude of; returns how many there are.

    Stills are counted as the core does, over all logs.  Raises the errors of reading the folder.
    """
    table = read_description(folder / TABLE)
    reported = read_angles(folder / NAME, table)
    session, _ = with_own_accelerometer(read_session(folder))
    known, rows = SessionStills(session), []
    spread = np.array([SIGMAS * axis.sigma_rad + axis.backlash_rad for axis in table.axes])
    for log in session.logs:
        of_log = reported.get(log.path.name.removesuffix(".gz"))
        for still in known.of(log).stills:
            at = None if of_log is None else _angles_in(of_log, log.samples, still.start, still.stop, spread)
            rows.append(np.full(3, np.nan) if at is None else roll_pitch_yaw(attitudes(table, at[None]))[0])
    found = np.array(rows).reshape(-1, 3)
    path, text = folder / ATTITUDES, attitudes_text(found)
    if path.exists():
        if text.startswith(read_text(path, MOST_BYTES)):  # of an earlier part of this recording
            path.unlink()
        else:
            put_aside(path)
    write_text_whole(path, text)
    return int(np.isfinite(found).all(axis=1).sum())


def _angles_in(reported: AngleLog, samples: Samples, start: int, stop: int, spread: np.ndarray) -> np.ndarray | None:
    """(K,) median of the answers at rest within a still; None where there are none, or where they differ."""
    late_ns = LATE_S / NS
    within = (reported.t_ns >= samples.t_ns[start] + late_ns) & (reported.t_ns <= samples.t_ns[stop - 1] - late_ns)
    among = reported.angles[within & ~reported.moving]  # a verb counts as motion a moment before the stage moves
    return None if not len(among) or (np.ptp(among, axis=0) > spread).any() else np.median(among, axis=0)
