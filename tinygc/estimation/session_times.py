"""When sessions were recorded, as far as they state it: for a drift, a file's time of last writing is no date."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from session.base.errors import CalibrationError
from session.base.files import open_file
from session.base.names import log_paths
from session.base.texts import printable
from session.log.config import Config
from session.log.reader import Reader

FIRST_BYTES = 4096  #: of raw.times, for the port's first opening
#: s of a mean year
YEAR_S = 365.25 * 86400.0
#: ns since 1970 that a stamp may be, from 2000 on: smaller ones are a board's own
FIRST_NS, LAST_NS = 946_684_800 * 10**9, 4_102_444_800 * 10**9
#: a date within a folder's name: 2026-11-05, 2026_11_05, 20261105
IN_NAME = re.compile(r"(?<!\d)(20\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)(?!\d)")
#: where a date is from, in words
SOURCES = {
    "port": "the port's first opening",
    "notes": "notes.date",
    "stamps": "the log's stamps",
    "name": "the folder's name",
    "given": "--dates",
}


@dataclass(frozen=True)
class Moment:
    """When a session was recorded (UTC; midnight where only the day is known), and where that is from: a key of ``SOURCES``."""

    when: datetime
    source: str

    @property
    def day(self) -> str:
        """``2026-11-05``."""
        return self.when.date().isoformat()


def date_of(folder: Path, config: Config, logs: Sequence[Path] = ()) -> tuple[str | None, str | None]:
    """Return the date of a session and its source: the first opening of the port, else the notes, else the time at which the oldest of
    these logs was last written."""
    times = folder / "raw.times"
    if times.exists():
        with open_file(times) as file:
            for line in file.read(FIRST_BYTES).decode("utf-8", "replace").splitlines():
                words = line.split(",", 2)[-1].split()
                if len(words) > 1 and words[0] == "open":
                    with contextlib.suppress(ValueError):
                        return datetime.fromisoformat(words[1]).astimezone(UTC).isoformat(timespec="seconds"), "port"
    if (noted := config.notes.get("date")) is not None:
        return printable(str(noted)), "notes"
    if not logs:
        return None, None
    oldest = min(path.stat().st_mtime for path in logs)
    return datetime.fromtimestamp(oldest, UTC).isoformat(timespec="seconds"), "file"


def moment_of(folder: Path, config: Config | None) -> Moment | None:
    """The first of: the port's first opening, ``notes.date``, absolute stamps of the first log, a date in the folder's name; else None."""
    if config is not None:
        text, source = date_of(folder, config)
        if source is not None and (when := parsed(text or "")) is not None:
            return Moment(when, source)
        if (stamped := _stamped(folder, config)) is not None:
            return Moment(stamped, "stamps")
    named = IN_NAME.search(folder.resolve().name[:255])
    when = parsed("-".join(named.groups())) if named else None
    return None if when is None else Moment(when, "name")


def parsed(text: str) -> datetime | None:
    """ISO 8601 as UTC; None for other text."""
    try:
        found = datetime.fromisoformat(text.strip())
    except ValueError:
        return None
    try:
        return found.replace(tzinfo=UTC) if found.tzinfo is None else found.astimezone(UTC)
    except OverflowError:  # the first or last day of the calendar, in another zone
        return None


def times_of(moments: Sequence[Moment | None]) -> tuple[np.ndarray, np.ndarray]:
    """Order (n,) of sessions and their times (n,) in years since the first; by their places in the sequence, one a unit, where a date is
    missing, or all are the same."""
    dated = [moment.when.timestamp() for moment in moments if moment is not None]
    if len(dated) < len(moments) or len(set(dated)) < 2:
        return np.arange(len(moments)), np.arange(len(moments), dtype=float)
    order = np.argsort(dated, kind="stable")
    return order, (np.array(dated)[order] - min(dated)) / YEAR_S


def _stamped(folder: Path, config: Config) -> datetime | None:
    """When the first log began, where its stamps are nanoseconds since 1970."""
    try:
        paths = log_paths(folder, "log")
        piece = next(Reader(paths[0]).pieces(as_written=True), None) if paths else None
    except CalibrationError:
        return None
    if piece is None or piece.t_ns is None or not FIRST_NS <= int(piece.t_ns[0]) <= LAST_NS:
        return None
    return datetime.fromtimestamp(int(piece.t_ns[0]) // 10**9, UTC)
