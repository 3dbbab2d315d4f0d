"""The rows of one file, in pieces: constant memory, whatever its length."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.common.errors import FormatError
from session.common.plausible import beyond_any_sensor, complaint
from session.dialects.layout import Answers, Layout, recognise
from session.dialects.lines import Lines
from session.dialects.stamps import COUNTER, DAY_NS, Unroll, exact_ns
from session.dialects.units import Unit
from session.log.logfile import LAST_NS

#: of text that is looked through for a header
HEAD_LINES, HEAD_BYTES = 400, 1 << 16
#: whole numbers up to here survive a float64
EXACT = 2**53


@dataclass(frozen=True, eq=False)
class Piece:
    """Consecutive rows: t_ns (N,) int64, or None where nothing stamps them; gyro, accel (N, 3) as written, None where the file has
    none; temp (N,) as written."""

    t_ns: np.ndarray | None
    gyro: np.ndarray | None
    accel: np.ndarray | None
    temp: np.ndarray | None


class Reader:
    """One file: ``layout`` at once, ``pieces()`` once, ``notes`` and ``comments`` as they are met."""

    def __init__(self, path: Path, answers: Answers):
        """Raises FormatError: what cannot be read or told."""
        self.path, self.notes = path, []
        self._stream: Lines | None = None  # what can be read but once: a pipe, standard input
        head = self._head()
        self.comments = dict(pair for line in head if line.lstrip().startswith("#") for pair in re.findall(r"(\w+)=(\S+)", line))
        if not any(line.strip() for line in head):
            raise FormatError(f"{path.name}: empty; expected a header line and samples; was the recording stopped before it began?")
        self.layout: Layout = recognise(head, path.name, answers)
        self._unroll = self._file = None
        self._commas = False  # in the place of decimal points; whole numbers at the beginning do not show it

    @property
    def position(self) -> int:
        """Bytes of the file that were read so far."""
        return 0 if self._file is None else self._file.position

    def pieces(self) -> Iterator[Piece]:
        """All rows, a few ten thousand at a time.  Raises FormatError with the line that is at fault."""
        with self._stream or Lines(self.path) as file:
            self._file, number, skip, lines = file, 1, self.layout.first, file.take()
            while lines:
                following = file.take()
                piece = self._piece(lines[skip:], number + skip, last=not following)
                if piece is not None:
                    yield piece
                number, skip, lines = number + len(lines), max(skip - len(lines), 0), following
            if file.note:
                self.notes.append(file.note)

    def _head(self) -> list[str]:
        file = Lines(self.path)
        try:
            lines = file.take(HEAD_BYTES)
        finally:
            if self.path.is_file():
                file.close()
        if not self.path.is_file():
            file.give_back(lines)
            self._stream = file
        lines = lines[:HEAD_LINES]
        if any("\0" in line for line in lines[:20]):
            raise FormatError(f"{self.path.name}: not a text log (UTF-16 or binary); expected CSV in UTF-8")
        return lines

    def _piece(self, lines: list[str], number: int, last: bool) -> Piece | None:
        if self._commas:
            lines = _with_points(lines)
        try:
            table, time = self._load(lines)
        except ValueError:
            if not self._commas and self._has_decimal_commas(lines):
                self._commas = True
                lines = _with_points(lines)
            lines = self._mended(lines, number, last)
            try:
                table, time = self._load(lines)
            except ValueError as error:
                raise FormatError(f"{self.path.name} after line {number}: cannot be read as numbers ({str(error)[:80]})") from None
        if not len(table):
            return None
        if not np.isfinite(table).all():
            self._refuse_row(lines, number, int(np.argmin(np.isfinite(table).all(axis=1))), "a value that is not finite")
        self._require_possible(table, lines, number)
        gyro, accel = (self._triad(table, triad) for triad in (self.layout.gyro, self.layout.accel))
        temp = None if self.layout.temp is None else table[:, self._used.index(self.layout.temp)]
        return Piece(None if time is None else self._stamps(time, lines, number), gyro, accel, temp)

    def _has_decimal_commas(self, lines: list[str]) -> bool:
        """Whether numbers of these rows have commas in them, and none has a point: 1,234 beside 0.5 may be a thousand."""
        if self.layout.delimiter not in (";", "\t"):
            return False
        wanted = self._used if self.layout.time is None else (self.layout.time, *self._used)
        rows = (line.split("#")[0].split(self.layout.delimiter) for line in lines if line.strip() != self.layout.header_line)
        cells = [row[column].strip().split(" ")[-1] for row in rows for column in wanted if column < len(row)]  # of a date, the time
        return any("," in cell for cell in cells) and not any("." in cell for cell in cells)

    def _require_possible(self, table: np.ndarray, lines: list[str], number: int) -> None:
        """Refuse what no sensor measures."""
        layout = self.layout
        kinds = [("gyro", layout.gyro.columns, layout.gyro.unit)] if layout.gyro else []
        kinds += [("accel", layout.accel.columns, layout.accel.unit)] if layout.accel else []
        kinds += [("temp", (layout.temp,), layout.temp_unit)] if layout.temp is not None else []
        for kind, columns, unit in kinds:
            for column in columns if unit.si is not None else ():
                values = table[:, self._used.index(column)]
                if (far := beyond_any_sensor(values, unit.si, kind)).any():
                    row = int(np.argmax(far))
                    what, do = complaint(layout.names[column], values[row], kind).rsplit("; ", 1)
                    self._refuse_row(lines, number, row, what, do)

    @property
    def _used(self) -> tuple[int, ...]:
        """Columns of numbers, apart from the time."""
        layout = self.layout
        triads = (triad.columns for triad in (layout.gyro, layout.accel) if triad is not None)
        return tuple(dict.fromkeys(column for columns in triads for column in columns)) + (() if layout.temp is None else (layout.temp,))

    def _triad(self, table: np.ndarray, triad) -> np.ndarray | None:
        if triad is None:
            return None
        return table[:, [self._used.index(column) for column in triad.columns]] * np.array(triad.signs, dtype=float)

    def _load(self, lines: list[str]) -> tuple[np.ndarray, np.ndarray | None]:
        """Numbers (N, columns) and the time as integers of its unit or ns; ValueError where a line is at fault."""
        settings = {"delimiter": self.layout.delimiter, "comments": "#", "quotechar": '"', "ndmin": 2}
        used, time = self._used, self.layout.time
        if not any(line.lstrip()[:1] not in ("", "#") for line in lines):
            return np.zeros((0, len(used))), None
        if time is None:
            return np.loadtxt(lines, usecols=used, **settings), None
        if not self.layout.clock:
            table = np.loadtxt(lines, usecols=(time, *used), **settings)
            stamps = table[:, 0]
            if (
                np.isfinite(stamps).all()
                and not (stamps % 1).any()
                and np.abs(stamps).max(initial=0) < min(EXACT, LAST_NS // self.layout.time_ns)
            ):
                return table[:, 1:], stamps.astype(np.int64) * self.layout.time_ns
            table = table[:, 1:]
        else:
            table = np.loadtxt(lines, usecols=used, **settings)
        # A float64 would round these: text to integers, exactly.
        texts = np.loadtxt(lines, usecols=(time,), dtype="U48", **settings)[:, 0]
        return table, np.array([exact_ns(text, self.layout.time_ns) for text in texts.tolist()], dtype=object)

    def _stamps(self, time: np.ndarray, lines: list[str], number: int) -> np.ndarray:
        if (far := np.abs(time) >= LAST_NS).any():
            self._refuse_row(lines, number, int(np.argmax(far)), "a time of no era")
        t_ns = time.astype(np.int64)
        if self._unroll is None:
            self._unroll = Unroll(DAY_NS if self.layout.clock else COUNTER * self.layout.time_ns)
            self._before = t_ns[:1]
        t_ns = self._unroll(t_ns)
        back = np.diff(t_ns, prepend=self._before) < 0
        if back.any():
            row = int(np.argmax(back))
            by = int(self._before[0] if row == 0 else t_ns[row - 1]) - int(t_ns[row])
            self._refuse_row(
                lines,
                number,
                row,
                f"time goes backward by {by * 1e-9:g} s",
                "split the log there, or count samples: --time-unit none --odr HZ",
            )
        self._before = t_ns[-1:]
        return t_ns

    def _mended(self, lines: list[str], number: int, last: bool) -> list[str]:
        """Without a header that comes again, and without a last line that was cut off; blanks in their place keep the numbers."""
        kept = list(lines)
        for i, line in enumerate(lines):
            if not line.strip() or line.lstrip().startswith("#"):
                continue
            if line.strip() == self.layout.header_line:
                self._note("the header comes again (the logger was restarted?): left out")
                kept[i] = ""
            elif problem := self._fault(line):
                if not (last and not any(rest.strip() for rest in lines[i + 1 :])):
                    raise FormatError(f"{self.path.name} line {number + i}: {problem}; mend or remove that line")
                self.notes.append(f"line {number + i}, the last, is cut off ({problem}): left out")
                kept[i] = ""
        return kept

    def _fault(self, line: str) -> str | None:
        cells = [cell.strip().strip('"') for cell in line.split("#")[0].split(self.layout.delimiter)]
        wanted = self._used if self.layout.time is None else (self.layout.time, *self._used)
        if len(cells) <= max(wanted):
            return f"{len(cells)} columns, expected {len(self.layout.names)}"
        for column in wanted:
            try:
                if "_" in cells[column]:  # Python reads 1_000, and numpy does not
                    raise ValueError
                exact_ns(cells[column], self.layout.time_ns) if column == self.layout.time else float(cells[column])
            except (ValueError, OverflowError):
                name = self.layout.names[column] if column < len(self.layout.names) else f"column {column + 1}"
                return f"{name} is {cells[column][:20]!r}, expected a number"
        return None

    def _refuse_row(self, lines: list[str], number: int, row: int, what: str, do: str = "mend or remove that line"):
        rows = [i for i, line in enumerate(lines) if line.split("#")[0].strip()]
        raise FormatError(f"{self.path.name} line {number + rows[row]}: {what}; {do}")

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


def _with_points(lines: list[str]) -> list[str]:
    return [line.replace(",", ".") for line in lines]


def temperature_c(values: np.ndarray, unit: Unit) -> np.ndarray:
    """degC from what is written."""
    from session.common.registers import temperature_c as of_register

    return of_register(values) if unit.si is None else values * unit.si
