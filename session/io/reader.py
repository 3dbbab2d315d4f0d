"""The one reader of logs: stamps, rows and whole files, in pieces and in constant memory."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import DTypeLike

from session.io.clock import exact_ns
from session.io.dialects import Answers, Layout, Triad
from session.io.errors import DataError, FormatError
from session.io.files import MB
from session.io.lines import PIECE_BYTES, Lines
from session.io.recognise import flagged, recognise, standard_layout
from session.io.rows import Form, Rows, Wanted, Watch
from session.io.units import NS, NS_PER_S, beyond_any_sensor, complaint

# A counter that comes round: where its stamps may be carried on, and where time only goes backward.

#: of a counter's span: what may lie between the last stamp before it comes round and the first after; at 32 bits of us, 9 minutes
NEAR_ENDS = 1 / 8


def comes_round(steps: np.ndarray, lowest: int, highest: int, span: int) -> np.ndarray:
    """Which of the steps (N,) of integer stamps are a counter of ``span`` that has come round.

    Such a step falls by nearly the whole span, and no stamp, lowest to highest, lies outside the counter: nanoseconds of an epoch, of
    which some are lost, are no counter.  A counter may be written with a sign.
    """
    counter = any(first <= lowest and highest < first + span for first in (0, -span // 2))
    return steps <= -span * (1 - NEAR_ENDS) if counter else np.zeros(len(steps), dtype=bool)


# Stamps as integers: decimal text, clocks, counters that wrap, and stamps that are coarser than the samples.

#: a counter of 32 bits, and a clock
COUNTER = 2**32
DAY_NS = 86_400 * NS_PER_S
#: stamps up to here, 146 years, can be told apart in ns without overflow
ERA_NS = 2**62
#: share of rows that repeat the stamp before them, from which on stamps are coarse and not merely stuttering
COARSE = 0.02
#: of the stamps' own step: how far counted samples may lie from coarse stamps before samples must be missing
OFF = 2.0


class Unroll:
    """Carries a wrapping counter or clock on, piece after piece; span_ns: None for stamps that count on for ever."""

    def __init__(self, span_ns: int | None):
        self._span, self._offset = span_ns, 0
        self._last: np.ndarray | None = None  # (1,) ns as written
        self._lowest = self._highest = 0
        self.wraps = 0

    def __call__(self, t_ns: np.ndarray) -> np.ndarray:
        """(N,) ns that go on from those before, from stamps (N,) ns as written."""
        if self._span is None:
            return t_ns
        steps = np.diff(t_ns, prepend=t_ns[:1] if self._last is None else self._last)
        self._lowest, self._highest = min(self._lowest, int(t_ns.min())), max(self._highest, int(t_ns.max()))
        self._last = t_ns[-1:]
        if steps.min() >= 0:
            return t_ns + self._offset
        wrapped = comes_round(steps, self._lowest, self._highest, self._span)
        offset = self._offset + self._span * np.cumsum(wrapped)
        self._offset, self.wraps = int(offset[-1]), self.wraps + int(wrapped.sum())
        return t_ns + offset


def fresh(t_ns: np.ndarray) -> np.ndarray:
    """(N,) bool: stamps that are later than the one before; the first is."""
    return np.diff(t_ns, prepend=t_ns[:1] - 1) > 0


def evenly(t_ns: np.ndarray, odr_hz: float | None, name: str) -> tuple[np.ndarray, str | None]:
    """Stamps as they are, and None; or, where many samples share one, the samples counted along the stamps, and a note.

    Raises DataError where samples must be missing, which coarse stamps cannot place.
    """
    steps = np.diff(t_ns)
    shared = np.count_nonzero(steps == 0)
    if len(steps) < 10 or shared <= COARSE * len(steps):
        return t_ns, None
    count = np.arange(len(t_ns))
    step_ns = float(np.median(steps[steps > 0])) if shared < len(steps) else 0.0
    shares = f"{shared} of {len(t_ns)} samples share a stamp with the one before"
    if step_ns:
        slope, start = np.polyfit(count, (t_ns - t_ns[0]).astype(float), 1)
        if np.abs(t_ns - t_ns[0] - start - slope * count).max() <= OFF * step_ns:
            even = t_ns[0] + np.rint(start + slope * count).astype(np.int64)
            return even, f"{shares} (stamps of {step_ns * 1e-6:g} ms): samples were counted along them, {NS_PER_S / slope:.3f} Hz"
    if odr_hz is None:
        raise DataError(f"{name}: {shares}, and counting along them misses them: samples are missing; log finer stamps, or give --odr HZ")
    return counted(len(t_ns), odr_hz), f"{shares}, and counting along them misses them: samples were counted at {odr_hz:g} Hz instead"


def counted(rows: int, odr_hz: float) -> np.ndarray:
    """Stamps (N,) ns of samples that are only counted."""
    return np.rint(np.arange(rows) * (NS_PER_S / odr_hz)).astype(np.int64)


# Lines into numbers and stamps, or what is wrong with which line.

#: whole numbers up to here survive a float64
EXACT = 2**53
#: stamps up to here, 13 days, are right to the nanosecond when a float64 of their unit is multiplied: the error stays below a quarter
CLOSE_NS = 2**50
#: whole numbers that a column can hold
INT64 = (-(2**63), 2**63 - 1)
OPEN = "a quotation mark that is not closed"
CORRECT = "correct or remove that line"


class RowFault(Exception):
    """A row, counted without blanks and comments, can be read but cannot be: what is wrong, and what to do."""

    def __init__(self, row: int, what: str, do: str = CORRECT):
        super().__init__(what)
        self.row, self.what, self.do = row, what, do


def parse(lines: list[str], layout: Layout) -> tuple[np.ndarray, np.ndarray | None]:
    """Numbers (N, ``layout.numbers``) as written, and stamps (N,) int64 ns as written, or None where there are none.

    Raises RowFault, and ValueError where a line cannot be read: ``fault`` says why.
    """
    if not any(line.lstrip()[:1] not in ("", "#") for line in lines):
        return np.zeros((0, len(layout.numbers))), None
    if not layout.standard and any(map(_opens, lines)):
        raise ValueError(OPEN)  # NumPy would read on to the next quotation mark, over however many lines
    if layout.finer is not None:
        table, time = _load(lines, layout.numbers, layout, np.float64), _in_two_columns(lines, layout)
    elif layout.time is None or layout.clock:
        table, time = _load(lines, layout.numbers, layout, np.float64), None
    else:
        table, time = _with_time(lines, layout)
    _refuse_impossible(table, time, layout)
    if layout.finer is not None and time is not None:
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


def _in_two_columns(lines: list[str], layout: Layout) -> np.ndarray:
    """(N,) int64 ns of whole seconds and their fraction.  RowFault where the fraction is none."""
    assert layout.finer is not None
    column, unit_ns = layout.finer
    parts = _load(lines, (layout.time_column, column), layout, np.int64)
    most = NS_PER_S // unit_ns
    if not (fine := (parts[:, 1] >= 0) & (parts[:, 1] < most)).all():
        row = int(np.argmin(fine))
        raise RowFault(row, f"{layout.name(column)} is {parts[row, 1]}, expected a second's fraction from 0 to {most - 1}")
    _require_era(np.abs(parts[:, 0]) < ERA_NS // NS_PER_S, lambda row: parts[row, 0], layout)
    return np.asarray(parts[:, 0] * NS_PER_S + parts[:, 1] * unit_ns)


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
    if (values % 1).any() or not (np.abs(values) < ERA_NS).all():
        raise ValueError("a fraction, or more than 64 bits, where a whole number belongs")


def _stamps(time: np.ndarray | None, lines: list[str], layout: Layout) -> np.ndarray:
    """(N,) int64 ns.  RowFault for what is no time of this era."""
    if time is not None and time.dtype == np.int64:
        last = ERA_NS // layout.time_ns
        _require_era((time > -last) & (time < last), lambda row: time[row], layout)
        return time * layout.time_ns
    if time is not None:
        largest = np.abs(time).max()
        if largest < CLOSE_NS / layout.time_ns:
            return np.rint(time * layout.time_ns).astype(np.int64)
        if layout.standard:
            _require_era(np.abs(time) < ERA_NS // layout.time_ns, lambda row: time[row], layout)
        if layout.is_whole(layout.time_column) and largest < EXACT:
            return time.astype(np.int64) * layout.time_ns
    # A float64 would round these: text to integers, exactly.
    texts = _load(lines, (layout.time_column,), layout, "U48")[:, 0].tolist()
    exact = np.array([exact_ns(text, layout.time_ns) for text in texts], dtype=object)
    _require_era(np.abs(exact) < ERA_NS, lambda row: texts[row][:20], layout)
    return exact.astype(np.int64)


def _require_era(fine: np.ndarray, value: Callable[[int], object], layout: Layout) -> None:
    if not fine.all():
        row = int(np.argmin(fine))
        raise RowFault(row, f"{layout.name(layout.time_column)} is {value(row)}, which is no time of this era")


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


# The one reader of logs: the rows of one file, in pieces, in constant memory whatever its length, or all at once.

#: of text that is looked through for a header, from the first line that is neither blank nor a comment
HEAD_LINES, HEAD_BYTES = 400, 1 << 16
#: characters that are looked through for the first rows of one kind: a flight controller writes its formats and parameters first
MOST_HEAD = 16 * MB
#: characters in which a zero byte says that this is no text; further on it is a line that broke
TEXT_BEGINS = 1000
#: rows of one stamp, many times as many as the coarsest stamps, whole seconds, share at any sensor's rate
MOST_STANDING = 1_000_000


@dataclass(frozen=True, eq=False)
class Piece:
    """Consecutive rows: t_ns (N,) int64, or None where nothing stamps them; gyro, accel (N, 3) as written, None where the file has
    none; temp (N,) as written."""

    t_ns: np.ndarray | None
    gyro: np.ndarray | None
    accel: np.ndarray | None
    temp: np.ndarray | None


class Reader:
    """One file: ``layout`` at once, ``pieces()`` or ``whole()`` once, ``notes`` and ``comments`` as they are met."""

    def __init__(self, path: Path, answers: Answers | None, wanted: Wanted | None = None, gyro_alone: bool = False):
        """answers: options for a log of any dialect; None: it must be a standard log, to the letter of docs/formats.md.
        wanted: its rows that are meant, where that is not among the answers; gyro_alone: whether a standard log may lack an accelerometer.

        Raises FormatError for what cannot be read or recognised, and for rows of several sensors of which none are picked.
        """
        self.path = path
        self.notes: list[str] = []
        self.comments: dict[str, str] = {}
        self._stream: Lines | None = None  # what can be read but once: a pipe, standard input
        wanted = wanted or (Wanted() if answers is None else Wanted(answers.rows, answers.where))
        head = self._head(wanted)
        if not any(line.strip() for line in head) or (answers is None and _first_of_content(head) is None):
            raise FormatError(f"{path.name}: empty; expected a header line and samples; was the recording stopped before it began?")
        self.layout: Layout = standard_layout(head, path.name, gyro_alone) if answers is None else recognise(head, path.name, answers)
        self.comments |= flagged(self.layout.names)
        self.notes += [self.layout.remark] if self.layout.remark else []
        layout = self.layout
        form = Form(path.name, layout.delimiter, layout.names, layout.used, layout.header_line, layout.standard)
        self._wanted, self._watch = Rows(wanted, form), Watch(Rows(wanted, form)(head[layout.first :]), form)
        self._file: Lines | None = None
        self._unroll = Unroll(self._counter_ns())
        self._before: int | None = None
        self._stood_at, self._standing = 0, 0  # the last stamp, and rows of the pieces that held no other
        self._as_written = False
        self._rows, self._begins = 0, [(0, 1)]  # rows so far; of each piece, its first row, and its first line from 1
        self._commas = False  # in the place of decimal points; whole numbers at the beginning do not show it

    @property
    def position(self) -> int:
        """Bytes of the file that were read so far."""
        return 0 if self._file is None else self._file.position

    @property
    def wraps(self) -> int:
        """How often the counter of the stamps has come round so far."""
        return self._unroll.wraps

    def pieces(self, size: int = PIECE_BYTES, *, as_written: bool = False) -> Iterator[Piece]:
        """All rows, a few ten thousand at a time.  Raises FormatError with the line that is at fault.

        as_written: stamps as the file has them, for ``unrolled`` when all of them are there.
        """
        self._as_written = as_written
        with self._stream or Lines(self.path) as file:
            self._file, number, skip, lines = file, 1, self.layout.first, file.take(size)
            while lines:
                following = file.take(size)
                self.comments |= file.comments
                if file.note and file.note not in self.notes:
                    self.notes.append(file.note)
                piece = self._piece(self._mine(lines[skip:]), number + skip, last=not following)
                if piece is not None:
                    self._require_time(piece, number + skip)
                    yield piece
                number, skip, lines = number + len(lines), max(skip - len(lines), 0), following
        if self._wanted.left_out:
            self._note(f"{self._wanted.left_out} rows of other kinds or sensors: left out")

    def unrolled(self, stamps: np.ndarray) -> np.ndarray:
        """(N,) ns that go on, of all stamps (N,) ns as they were written: all of them together tell a counter from an epoch.

        Raises FormatError with the line from which they go back.
        """
        try:
            return self._unrolled(stamps)
        except RowFault as wrong:
            raise FormatError(f"{self.path.name} line {self._line_of(wrong.row)}: {wrong.what}; {wrong.do}") from None

    def _head(self, wanted: Wanted) -> list[str]:
        file = Lines(self.path)
        try:
            lines = file.take(HEAD_BYTES)
            while (first := _first_of_content(lines)) is None and (more := file.take(HEAD_BYTES)):
                lines += more
            found = wanted.count(lines) if wanted.word else HEAD_LINES
            while found < HEAD_LINES and sum(map(len, lines)) < MOST_HEAD and (more := file.take(HEAD_BYTES)):
                lines, found = lines + more, found + wanted.count(more)
        finally:
            if not file.once:
                file.close()
        self.comments |= file.comments
        if file.once:
            file.give_back(lines)
            self._stream = file
        if "\0" in "\n".join(lines[:TEXT_BEGINS])[:TEXT_BEGINS]:
            raise FormatError(f"{self.path.name}: not a text log (UTF-16 or binary); expected CSV in UTF-8")
        if wanted.word is None:
            return lines if first is None else lines[: first + HEAD_LINES]
        if not found:
            raise FormatError(
                f"{self.path.name}: no row begins with {wanted.word!r} (rows); give the word that the sensor's rows begin with"
            )
        return wanted.in_head(lines)

    def _counter_ns(self) -> int | None:
        """The period of the stamps' counter, ns; None where it does not wrap."""
        layout = self.layout
        if layout.standard:
            return COUNTER * layout.time_ns if layout.name(layout.time_column) == "t_us" else None
        return DAY_NS if layout.clock else COUNTER * layout.time_ns

    def _mine(self, lines: list[str]) -> list[str]:
        """The lines, with blanks in the place of rows that are not wanted.  FormatError for rows of another kind or sensor."""
        kept = self._wanted(lines)
        self._watch(kept)
        return kept

    def _piece(self, lines: list[str], number: int, last: bool) -> Piece | None:
        if self._commas:
            lines = _with_points(lines)
        try:
            try:
                table, stamps = parse(lines, self.layout)
            except ValueError:
                # Only now, since it is slow: look for the line that is at fault.
                if not self._commas and self._has_decimal_commas(lines):
                    self._commas = True
                    lines = _with_points(lines)
                lines = self._repaired(lines, number, last)
                table, stamps = parse(lines, self.layout)
            if not len(table):
                return None
            self._begins.append((self._rows, number))
            self._rows += len(table)
            t_ns = stamps if stamps is None or self._as_written else self._unrolled(stamps)
        except RowFault as wrong:
            rows = [i for i, line in enumerate(lines) if line.split("#")[0].strip()]
            raise FormatError(f"{self.path.name} line {number + rows[wrong.row]}: {wrong.what}; {wrong.do}") from None
        gyro, accel = (self._triad(table, triad) for triad in (self.layout.gyro, self.layout.accel))
        temp = None if self.layout.temp is None else table[:, self.layout.numbers.index(self.layout.temp)]
        return Piece(t_ns, gyro, accel, temp)

    def _require_time(self, piece: Piece, number: int) -> None:
        """FormatError for rows without end that all have one stamp: repeated ones are left out, so that no later check would see them."""
        if piece.t_ns is None:
            return
        self._standing = self._standing + len(piece.t_ns) if (piece.t_ns == self._stood_at).all() else 0
        self._stood_at = int(piece.t_ns[-1])
        if self._standing > MOST_STANDING:
            name = self.layout.name(self.layout.time_column)
            raise FormatError(f"{self.path.name} line {number}: {name} has not gone on for {self._standing} rows; cut the log before them")

    def _line_of(self, row: int) -> int:
        """The line, from 1, of a row that was read; the file is looked at once more."""
        first, number = next(begin for begin in reversed(self._begins) if begin[0] <= row)
        with Lines(self.path) as file:
            at, lines = 1, file.take()
            while lines:
                for line in self._wanted(lines):
                    if at >= number and at > self.layout.first and line.split("#")[0].strip():
                        if first == row:
                            return at
                        first += 1
                    at += 1
                lines = file.take()
        return number

    def _has_decimal_commas(self, lines: list[str]) -> bool:
        """Whether numbers of these rows have commas in them, and none has a point: 1,234 next to 0.5 may be a thousand."""
        if self.layout.delimiter not in (";", "\t"):
            return False
        rows = (line.split("#")[0].split(self.layout.delimiter) for line in lines if line.strip() != self.layout.header_line)
        # Of a date, the time.
        cells = [row[column].strip().split(" ")[-1] for row in rows for column in self.layout.used if column < len(row)]
        return any("," in cell for cell in cells) and not any("." in cell for cell in cells)

    def _triad(self, table: np.ndarray, triad: Triad | None) -> np.ndarray | None:
        if triad is None:
            return None
        places = [self.layout.numbers.index(column) for column in triad.columns]
        first = places[0]
        columns = table[:, first : first + 3] if places == [first, first + 1, first + 2] else table[:, places]
        return columns if triad.signs == (1, 1, 1) else columns * np.array(triad.signs, dtype=float)

    def _unrolled(self, stamps: np.ndarray) -> np.ndarray:
        """(N,) ns that go on from those before.  RowFault where they go back."""
        t_ns = self._unroll(stamps)
        before = int(t_ns[0]) if self._before is None else self._before
        back = np.diff(t_ns, prepend=before) < 0
        if back.any():
            row = int(np.argmax(back))
            by_s = ((before if row == 0 else int(t_ns[row - 1])) - int(t_ns[row])) * NS
            do = " or correct the stamps" if self.layout.standard else ", or count samples: --time-unit none --odr HZ"
            raise RowFault(row, f"{self.layout.name(self.layout.time_column)} goes backward by {by_s:g} s", f"split the log there{do}")
        self._before = int(t_ns[-1])
        return t_ns

    def _repaired(self, lines: list[str], number: int, last: bool) -> list[str]:
        """Without a header that comes again, and without a last line that was cut off; blanks in their place keep the numbers."""
        kept = list(lines)

        def leave_out(i: int, problem: str) -> None:
            if not (last and not any(rest.strip() for rest in lines[i + 1 :])):
                raise FormatError(f"{self.path.name} line {number + i}: {problem}; {CORRECT}")
            self.notes.append(f"line {number + i}, the last, is cut off ({problem}): left out")
            kept[i] = ""

        for i, line in enumerate(lines):
            if not line.split("#")[0].strip():
                continue
            if line.strip() == self.layout.header_line and not self.layout.standard:
                self._note("the header comes again (the logger was restarted?): left out")
                kept[i] = ""
            elif problem := fault(line, self.layout):
                leave_out(i, problem)
        # No rule of ours: numpy itself says which is the first line that it cannot take.
        if (row := unreadable(kept, self.layout)) is not None:
            leave_out(row, f"{kept[row][:40]!r} cannot be read as numbers")
        return kept

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


def _first_of_content(lines: list[str]) -> int | None:
    """The first line that is neither blank nor a comment."""
    return next((i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), None)


def _with_points(lines: list[str]) -> list[str]:
    return [line.replace(",", ".") for line in lines]
