"""What the readers share: the streams that a file holds, the file as a library sees it, columns that grow, one line for what is wrong."""

from __future__ import annotations

import contextlib
import os
import warnings
from array import array
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from io import BufferedIOBase
from pathlib import Path
from typing import Any

import numpy as np

from session.base.budget import RECORD, current
from session.base.errors import CalibrationError, FormatError
from session.base.files import open_file
from session.base.texts import install_line


@dataclass(frozen=True, eq=False)
class Part:
    """Readings of one quantity.

    values (N, 3), of a temperature (N,), float64 as written; unit: a word of ``session.base.units`` (``rad/s``, ``dps``, ``lsb``,
    ``0.061dps``), ``""`` where the file has none; names of x, y and z in the file, none where it calls them otherwise; full_scale, dps
    or g, where the file states it.
    """

    values: np.ndarray
    unit: str = ""
    names: tuple[str, ...] = ()
    full_scale: float | None = None


@dataclass(frozen=True, eq=False)
class Stream:
    """One sensor's readings out of a file.

    name: topic, message and instance, or dataset: ``sensor_combined[0]``, ``/imu/data_raw``, ``IMU[0]``, ``gyro``.  t_ns (N,) int64, or
    None where nothing stamps them.  parts: what is there, of ``gyro``, ``accel``, ``temp``.  odr_hz where the file states it.  frame: what
    is documented of its axes.  notes: what was repaired, where a damaged file stops, what an assumption rests on.  columns as the file
    calls them; stamps: that of the stamps, where it has a name.
    """

    name: str
    t_ns: np.ndarray | None
    parts: Mapping[str, Part]
    odr_hz: float | None = None
    frame: str = ""
    notes: tuple[str, ...] = ()
    columns: tuple[str, ...] = ()
    stamps: str = ""

    @property
    def topic(self) -> Topic:
        """What is there to choose."""
        return Topic(self.name, len(self), tuple(self.parts), self.columns)

    def __len__(self) -> int:
        """Rows."""
        return next((len(part.values) for part in self.parts.values()), 0)


@dataclass(frozen=True)
class Topic:
    """One stream of a file, before it is read: name, rows; holds: of ``gyro``, ``accel``, ``temp``; columns as the file calls them."""

    name: str
    rows: int
    holds: tuple[str, ...]
    columns: tuple[str, ...]


def library(path: Path, what: str, module: str, package: str, extra: str = "logs") -> Any:
    """A foreign module, imported when it is needed.  FormatError names the package where it is not installed.

    what: the file in words, ``a ULog``; package: the name by which pip knows it.
    """
    try:
        return import_module(module)
    except ImportError:
        raise FormatError(f"{path}: {what}; reading it needs {package}: {install_line(extra, package)}") from None


@contextlib.contextmanager
def one_line(path: Path, what: str) -> Iterator[None]:
    """Whatever a library raises on damaged bytes becomes one FormatError; its warnings are not shown."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except CalibrationError:
        raise
    except Exception as error:
        raise FormatError(
            f"{path}: {what} that cannot be read ({reason(error)}); is it whole? copy it again from where it was recorded"
        ) from None


def reason(error: Exception) -> str:
    """What a library reports of a fault, on one line."""
    return " ".join(f"{type(error).__name__}: {error}".split())[:120].removesuffix(": ")


@dataclass(frozen=True)
class Format:
    """One format of binary logs.

    name: how people call it; what: a file of it, in words; package: what pip installs, or ``""``, its extra of this project, and its
    licence; example: one line that shows such a file; is_mine: whether a file is of this format, by its first bytes.
    """

    name: str
    what: str
    package: str
    extra: str
    licence: str
    example: str
    is_mine: Callable[[Path, bytes], bool]


def begins(*magic: bytes) -> Callable[[Path, bytes], bool]:
    """``is_mine`` of a format whose files begin with one of these."""
    return lambda path, head: head.startswith(magic)


def require_names(path: Path, names: Sequence[str], there: Collection[str]) -> None:
    """FormatError for the name of a stream that is not there."""
    if missing := [name for name in names if name not in there]:
        raise FormatError(f"{path}: no stream {missing[0]!r}; it holds {', '.join(there) or 'no gyroscope and no accelerometer'}")


@dataclass(frozen=True)
class Messages(Format):
    """A format whose messages name their own columns; streams: those of these names, or more; all of them for no name."""

    streams: Callable[[Path, Sequence[str]], list[Stream]]

    def topics(self, path: Path, columns: str | None) -> list[Topic]:
        """The streams that hold a gyroscope or an accelerometer.  FormatError, in one line, for what cannot be read."""
        return [stream.topic for stream in self.read(path, (), columns)]

    def read(self, path: Path, names: Sequence[str], columns: str | None) -> list[Stream]:
        """The streams of these names in this order, all of them for no name; columns: the text of ``--columns``, which is refused."""
        if columns is not None:
            raise FormatError(f"{path}: {self.what} names its own columns; leave --columns out")
        streams = self.streams(path, names)
        there = {stream.name: stream for stream in streams}
        require_names(path, names, there)
        return [there[name] for name in names] or streams


#: bytes that one read counts at least where a parser's reads are counted: it makes two of a message
LEAST_READ = RECORD // 2


class Cut(Exception):
    """A read beyond the end of a file."""


class Source(BufferedIOBase):
    """A file's bytes for a parser of a foreign format.  A length that damaged bytes state never becomes a read beyond the file's end, and
    what is read counts in the budget.

    strict: a read that the file cannot fill raises Cut; else it returns what is there.  budget: bytes that may be read in all, after
    which the file seems to end: a parser that goes back and forth in damaged bytes, or by three bytes at once, comes to an end.
    """

    def __init__(self, path: Path, strict: bool = True, budget: int | None = None) -> None:
        self.path = path
        self._file = open_file(path)
        self.size = os.fstat(self._file.fileno()).st_size
        self.strict, self.budget = strict, budget
        self._allowed = current()
        #: whether the last read found fewer bytes than it requested, and some
        self.short = False

    def read(self, size: int | None = -1, /) -> bytes:
        """As of a file."""
        left = self.size - self._file.tell()
        wanted = left if size is None or size < 0 else size
        if self.budget is not None:
            if self.budget <= 0:
                return b""
            self.budget -= max(min(wanted, left), LEAST_READ)
        if self.strict and wanted > left:
            raise Cut(f"the file ends {wanted - left} bytes too early")
        self._allowed.need(self.path, 3 * min(wanted, left))  # what is made of it is as large
        self._allowed.unpack(self.path, max(min(wanted, left), LEAST_READ if self.budget is not None else 0))
        data = self._file.read(max(min(wanted, left), 0))
        self.short = 0 < len(data) < wanted or (not data and wanted > 3)
        return data

    def tell(self) -> int:
        """As of a file."""
        return self._file.tell()

    def seek(self, offset: int, whence: int = 0, /) -> int:
        """As of a file; beyond its end with strict: Cut."""
        where = offset + (0, self._file.tell(), self.size)[whence]
        if self.strict and not 0 <= where <= self.size:
            raise Cut(f"byte {where} of {self.size}")
        return self._file.seek(where)

    def readable(self) -> bool:
        """As of a file."""
        return True

    def seekable(self) -> bool:
        """As of a file."""
        return True

    def close(self) -> None:
        """As of a file."""
        self._file.close()
        super().close()


class DamagedChunks:
    """Chunks that cannot be read, counted: a log may have thousands."""

    def __init__(self) -> None:
        self._count, self._first = 0, ""

    def add(self, at: int, error: Exception) -> None:
        """One at this byte."""
        self._first = self._first or f"at byte {at} ({reason(error)})"
        self._count += 1

    @property
    def notes(self) -> list[str]:
        """What to report of them."""
        if self._count == 0:
            return []
        each = "a damaged chunk is" if self._count == 1 else f"{self._count} damaged chunks are"
        return [f"{each} left out from where the damage begins, the first {self._first}"]


class Rows:
    """Columns that grow by a row: 8 bytes for a stamp, 8 for a number; so many rows at a time count in the budget."""

    AT_ONCE = 1 << 12

    def __init__(self, path: Path, width: int) -> None:
        self._path, self._width, self._budget = path, width, current()
        self._t, self._values = array("q"), array("d")

    def add(self, t_ns: int, values: Sequence[float]) -> None:
        """One row; values has the width's length.  FormatError beyond the budget; OverflowError for no stamp."""
        if len(self._t) % self.AT_ONCE == 0:
            self._budget.numbers(self._path, self.AT_ONCE * (1 + self._width))
        self._t.append(t_ns)
        self._values.extend(values)

    def __len__(self) -> int:
        """Rows."""
        return len(self._t)

    @property
    def t_ns(self) -> np.ndarray:
        """(N,) int64."""
        return np.frombuffer(self._t, np.int64) if self._t else np.zeros(0, np.int64)

    @property
    def values(self) -> np.ndarray:
        """(N, width) float64."""
        flat = np.frombuffer(self._values) if self._values else np.zeros(0)
        return flat.reshape(-1, self._width)


def microseconds(stamps: np.ndarray, notes: list[str]) -> tuple[np.ndarray, np.ndarray]:
    """Stamps (N,) in whole us as t_ns (M,) int64, and which rows (N,) they are of; rows without a possible stamp are left out."""
    possible = stamps < np.uint64(2**53) if stamps.dtype.kind == "u" else (stamps >= 0) & (stamps < 2**53)
    if lost := np.count_nonzero(~possible):
        notes.append(f"{lost} rows with stamps that are no time are left out: the file is damaged there")
    return stamps[possible].astype(np.int64) * 1000, possible
