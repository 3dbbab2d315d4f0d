"""The text form of a stream: lines of numbers, comments and headers (docs/formats.md).

A line carries no check.  It is protected by its form: it stands between two line ends, it has as many columns as the others, its numbers
are written as a program writes them (no sign without a digit, no leading zero), and registers fit 16 bits.  ``continuity`` examines its
stamp.  Whole blocks of lines are classified and parsed at once; single lines are parsed only where they may hold something else.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from unicodedata import category

import numpy as np

from session.base.texts import printable
from session.bench.events import CHANGES, COLUMNS, REGISTERS, REMARKS, Allowance, Event, Info, SampleChunk, StreamFormat, parse_header

LONGEST_LINE = 512
SHAPING = "Cf"  #: Unicode's category of characters that only shape, join or reverse others
_NUMBER = re.compile(rb"-?[1-9][0-9]{0,17}|0")
#: at most 18 digits before the point, no leading zero
_DECIMAL_TEXT = rb"[-+]?(?:(?:0|[1-9][0-9]{0,17})(?:\.[0-9]{0,17})?|\.[0-9]{1,17})(?:[eE][-+]?[0-9]{1,2})?"
_DECIMAL = re.compile(_DECIMAL_TEXT)
_DECIMALS = re.compile(_DECIMAL_TEXT + rb"(?:," + _DECIMAL_TEXT + rb")*")
_FURTHER = re.compile(rb"[-+.\w ]*")
_PAIR = re.compile(r"\b(\w++)=(\S+)")
_LONGEST_NUMBER = 19
_LATEST_US = 2**60

# Classes of bytes in a line of whole numbers.
_DIGIT, _ZERO, _MINUS, _COMMA, _END = 1, 2, 3, 4, 5
_CLASS = np.zeros(256, np.uint8)
_CLASS[list(b"123456789")] = _DIGIT
_CLASS[ord("0")], _CLASS[ord("-")], _CLASS[ord(",")], _CLASS[ord("\n")] = _ZERO, _MINUS, _COMMA, _END

_BLANK = np.zeros(256, bool)
_BLANK[list(b" \t\n\r\x0b\x0c")] = True

#: a line of numbers has at least so many columns, and so many digits
_FEWEST = 7
#: lines of another width that must follow each other before the width changes
WIDTH_CHANGE = 3


def classify_lines(codes: np.ndarray, starts: np.ndarray, ends: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Classify the k lines of codes (n,) uint8 from starts up to ends, all at once.

    Returns blank (k,) bool, and worth (k,) bool: whether a line may be a comment, a header or numbers, and is worth parsing.
    """

    def count(mask: np.ndarray) -> np.ndarray:
        total = np.concatenate([[0], np.cumsum(mask, dtype=np.int32)])
        return total[ends] - total[starts]

    cells = count(codes == ord(",")) + 1 >= _FEWEST
    lengths, kind = ends - starts, _CLASS[codes]
    numbers = cells & (count((kind == _DIGIT) | (kind == _ZERO)) >= _FEWEST)
    header = cells & (count(codes == ord("g")) >= 3) & (count(codes == ord("a")) >= 3)
    comment = (lengths > 0) & (codes[np.minimum(starts, len(codes) - 1)] == ord("#"))
    return count(_BLANK[codes]) == lengths, numbers | header | comment


def _parse_lines(block: bytes, columns: int, order: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    r"""Parse many lines: block ends with ``\n``, a line has ``columns`` whole numbers, of which ``order`` are the log's eight.

    Returns good (lines,) bool and values (good lines, 8) int64.  ``parse_line`` may still read a line that is not good.
    """
    text = np.frombuffer(block, np.uint8)
    kind = _CLASS[text]
    ends = np.flatnonzero(kind == _END)
    before, after = np.empty_like(kind), np.empty_like(kind)
    before[0], before[1:] = _END, kind[:-1]
    after[-1], after[:-1] = _END, kind[1:]
    parts, parted, parts_next = kind >= _COMMA, before >= _COMMA, after >= _COMMA
    wrong = (kind == 0) | ((kind == _MINUS) & ~parted) | (parts & (parted | (before == _MINUS)))
    wrong |= (kind == _ZERO) & ((parted & ~parts_next) | (before == _MINUS))
    cuts = np.flatnonzero(parts)
    commas = np.diff(np.searchsorted(cuts, ends), prepend=-1) - 1
    good = commas == columns - 1
    good[np.searchsorted(ends, np.flatnonzero(wrong))] = False
    good[np.searchsorted(ends, cuts[np.diff(cuts, prepend=-1) > _LONGEST_NUMBER])] = False
    if not good.all():
        text = text[np.repeat(good, np.diff(ends, prepend=-1))]
    if not len(text):
        return good, np.zeros((0, len(COLUMNS)), np.int64)
    values = np.fromstring(text.tobytes().replace(b"\n", b",")[:-1], dtype=np.int64, sep=",").reshape(-1, columns)[:, order]
    fits = ((values[:, 1:] >= -32768) & (values[:, 1:] <= 32767)).all(axis=1) & (values[:, 0] >= 0)
    if not fits.all():
        good[np.flatnonzero(good)[~fits]] = False
        values = values[fits]
    return good, values


def _cells(line: bytes, order: tuple[int, ...], number: re.Pattern[bytes]) -> list[bytes] | None:
    """The cells of a line without blanks; None where one of ``order`` is no such number, or a further one holds other characters."""
    cells = [cell.strip(b" \t") for cell in line.split(b",")]
    right = len(cells) > max(order) and all(number.fullmatch(cells[i]) for i in order) and all(map(_FURTHER.fullmatch, cells))
    return cells if right else None


def parse_line(line: bytes, order: tuple[int, ...] = tuple(range(8))) -> tuple[int, list[int]] | None:
    """The number of columns of a line of registers, and the log's eight; None for another line."""
    cells = _cells(line, order, _NUMBER)
    if cells is None:
        return None
    values = [int(cells[i]) for i in order]
    return (len(cells), values) if values[0] >= 0 and all(-32768 <= value <= 32767 for value in values[1:]) else None


def _parse_decimals(line: bytes, order: tuple[int, ...], form: StreamFormat) -> tuple[int, list] | None:
    """The number of columns of a line in physical units, and the stamp in whole us with the values; None for another line, and for
    values that no sensor measures."""
    # Nearly all lines match at once.
    cells = line.split(b",") if _DECIMALS.fullmatch(line) else _cells(line, order, _DECIMAL)
    if cells is None or len(cells) <= max(order):
        return None
    stamp, *values = (cells[i] for i in order)
    if form.time_us <= 1.0 and not stamp.isdigit():
        return None  # us and ns are whole numbers
    t_us = int(stamp) // 1000 if form.names[0] == "t_ns" else round(float(stamp) * form.time_us)
    numbers = [float(value) for value in values]
    if not 0 <= t_us < _LATEST_US or any(abs(number) > limit for number, limit in zip(numbers, form.limits, strict=True)):
        return None
    return len(cells), [t_us, *numbers]


def parse_comment(line: bytes) -> str | None:
    r"""The text behind the ``#`` of a comment; None for another line, and for one with unprintable characters.

    Characters that only shape others, such as the joiner within an emoji, are kept as escapes (``\u200d``).
    """
    if not line.startswith(b"#"):
        return None
    comment = line[1:].decode("utf-8", errors="replace").strip()
    if "\ufffd" in comment:
        return None
    if comment.replace("\t", " ").isprintable():
        return comment
    shown = "".join(printable(c) if category(c) == SHAPING else c for c in comment)
    return shown if shown.replace("\t", " ").isprintable() else None


def parse_info(comment: str) -> Info | None:
    """The board's ranges and identity in a comment, or None where it is about something else."""
    pairs = dict(_PAIR.findall(comment))
    try:
        gyro, accel, odr = numbers = [float(pairs[name]) for name in ("gyro_fs_dps", "accel_fs_g", "odr_hz")]
    except (KeyError, ValueError):
        return None
    return Info(gyro, accel, odr, pairs.get("serial", ""), pairs.get("sensor", "")) if all(0 < number < 1e6 for number in numbers) else None


@dataclass(frozen=True)
class Garbage:
    """Bytes of unreadable lines; behind: whether the last of them came behind all rows so far."""

    count: int
    behind: bool


Item = SampleChunk | Event | Info | Garbage | StreamFormat


class LineReader:
    """Reads blocks of whole lines.  form: the format of the columns, registers until a header states another.

    header: the header of a stream that does not send it; remarks: the budget for other lines than numbers.
    """

    def __init__(self, header: str | None = None, remarks: Allowance | None = None):
        known = None if header is None else parse_header(header.encode())
        self.width, self._order, self.form = known or (0, tuple(range(len(REGISTERS.names))), REGISTERS)
        self._other_width, self.other_count = 0, 0
        self.remarks, self._changes = remarks or Allowance(*REMARKS), Allowance(*CHANGES)
        self.place = 0  # bytes of lines so far
        self.deaf = False  # whether lines of numbers are ignored, since their columns are not known

    def is_line(self, line: bytes) -> bool:
        """Whether a line proves that the stream is text."""
        return bool(parse_comment(line) is not None or self.parse(line) or parse_header(line))

    def take(self, block: bytes, torn: np.ndarray | None = None) -> list[Item]:
        """What the lines hold, in order; a ``StreamFormat`` where a header changes the columns.  torn (lines,) bool: incomplete lines."""
        good = None
        values = np.zeros((0, 1 + len(self.form.names)), np.int64)
        if self.width and not self.form.physical and not self.deaf:
            good, values = _parse_lines(block, self.width, self._order)
            if torn is not None:
                values, good = values[~torn[good]], good & ~torn
            if good.all():
                self.remarks.at += len(values)
                self.place += len(block)
                self.other_count = 0
                return [self.rows(*_registers(values), np.zeros(len(values), bool))]
        items = _Block(self, block, good, values, torn).items()
        self.place += len(block)
        return items

    def rows(self, t_us: np.ndarray, values: np.ndarray, damaged: np.ndarray) -> SampleChunk:
        """Consecutive lines of numbers; t_us (n,) int64 as sent."""
        return SampleChunk(t_us, values, self.form, damaged)

    def parse(self, line: bytes) -> tuple[int, list] | None:
        """How many columns a line of numbers has, and the log's; None where it is none."""
        return _parse_decimals(line, self._order, self.form) if self.form.physical else parse_line(line, self._order)

    def obey(self, header: tuple[int, tuple[int, ...], StreamFormat], place: int) -> StreamFormat | None:
        """Apply a header; returns the format if it changes.

        A header that changes the format too soon after others is not applied, and lines of numbers are ignored (``deaf``) until one is.
        """
        form = header[2] if self.changes_form(header, place) else None
        self.deaf = form is None and header[2] != self.form
        if form is not None:
            self._changes.spend(place)
        if not self.deaf:
            self.width, self._order, self.form = header
        return form

    def changes_form(self, header: tuple[int, tuple[int, ...], StreamFormat], place: int) -> bool:
        """Whether a header states another format, and is allowed to."""
        return header[2] != self.form and place >= self._changes.earliest

    def is_news(self, header: tuple[int, tuple[int, ...], StreamFormat]) -> bool:
        """Whether a header states anything new."""
        return self.deaf or header != (self.width, self._order, self.form)

    def has_width(self, width: int) -> bool:
        """Whether a line is as wide as the others: a line made of two halves may look whole, but hardly three times in a row."""
        if width == self.width or not self.width:
            self.width, self.other_count = width, 0
            return True
        self.other_count = self.other_count + 1 if width == self._other_width else 1
        self._other_width = width
        if self.other_count >= WIDTH_CHANGE and not self.form.physical:
            self.width, self._order = width, tuple(range(len(REGISTERS.names)))
        return False


class _Block:
    """The lines of one block: good ones were parsed at once, those worth it are parsed here, the others are unreadable."""

    def __init__(self, reader: LineReader, block: bytes, good: np.ndarray | None, values: np.ndarray, torn: np.ndarray | None):
        """good: the lines that were parsed at once, with their values; torn: incomplete lines."""
        codes = np.frombuffer(block, np.uint8)
        ends = np.flatnonzero(codes == 10)
        starts = np.concatenate([[0], ends[:-1] + 1])
        blank, worth = classify_lines(codes, starts, ends)
        torn, good = (np.zeros(len(ends), bool) if lines is None else lines for lines in (torn, good))
        worth &= ~torn
        self._reader, self._block, self._starts, self._ends = reader, block, starts, ends
        self._good_lines, self._values = np.flatnonzero(good), values
        self._worth, self._none = worth & ~good, ~worth & (~blank | (torn & (ends > starts))) & ~good
        self._passed = self._earned = self._last_good = 0  # good lines that are among the rows, that were counted, that were seen
        self._parts: list[tuple[np.ndarray, np.ndarray]] = []  # times and values of the next rows, and the numbers of their lines
        self._lines: list[np.ndarray] = []
        self._fresh: list[list] = []  # rows that were parsed here, behind those
        self._fresh_lines: list[int] = []
        self._begun = 0  # the first line that is in no item yet
        self._items: list[Item] = []

    def items(self) -> list[Item]:
        """Their content, in order."""
        todo, place = self._todo(0), 0
        while place < len(todo):
            number, start, stop, good_before = todo[place]
            place += 1
            line = self._block[start:stop]
            self._earn(good_before)
            if line.startswith(b"#"):
                comment = parse_comment(line) if self._reader.remarks.spend() else None
                if comment is not None:
                    self._close(number, good_before)
                    self._items.append(Event("comment", text=comment))
                    if info := parse_info(comment):
                        self._items.append(info)
                    continue
            elif not self._reader.deaf and (found := self._reader.parse(line)):
                if good_before > self._last_good:
                    self._reader.other_count = 0
                    self._last_good = good_before
                width = self._reader.width
                if self._reader.has_width(found[0]):
                    self._good_up_to(good_before)
                    self._fresh.append(found[1])
                    self._fresh_lines.append(number)
                    self._reader.remarks.at += 1
                    continue
                if self._reader.width != width:
                    todo, place = self._reparse(number, good_before) or (todo, place)
            elif header := parse_header(line):
                if self._reader.is_news(header):
                    if self._reader.changes_form(header, self._reader.place + start):
                        self._close(number, good_before)
                    if (form := self._reader.obey(header, self._reader.place + start)) is not None:
                        self._items.append(form)
                    todo, place = self._reparse(number, good_before) or (todo, place)
                continue
            self._none[number] = True
        self._earn(len(self._good_lines))
        if len(self._good_lines) > self._last_good:
            self._reader.other_count = 0
        self._close(len(self._ends), len(self._good_lines))
        return self._items

    def _reparse(self, number: int, good_before: int) -> tuple[list[tuple[int, int, int, int]], int] | None:
        """The columns change behind this line: parse the good lines there one by one.  Returns what is to do then, and the place in it;
        None where nothing changes."""
        if len(self._good_lines) == good_before:
            return None
        self._worth[self._good_lines[good_before:]] = True
        self._good_lines = self._good_lines[:good_before]
        return self._todo(number + 1), 0

    def _todo(self, first: int) -> list[tuple[int, int, int, int]]:
        """The lines from the first on that are parsed one by one: number, beginning, end, good lines before it."""
        numbers = np.flatnonzero(self._worth[first:]) + first
        before = np.searchsorted(self._good_lines, numbers)
        return list(zip(*(each.tolist() for each in (numbers, self._starts[numbers], self._ends[numbers], before)), strict=True))

    def _earn(self, good_before: int) -> None:
        self._reader.remarks.at += good_before - self._earned
        self._earned = good_before

    def _good_up_to(self, stop: int) -> None:
        """Make rows of the good lines up to stop."""
        if stop > self._passed:
            self._settle()
            self._parts.append(_registers(self._values[self._passed : stop]))
            self._lines.append(self._good_lines[self._passed : stop])
            self._passed = stop

    def _settle(self) -> None:
        if self._fresh:
            if self._reader.form.physical:
                t_us, values = np.array([row[0] for row in self._fresh], np.int64), np.array([row[1:] for row in self._fresh], float)
                self._parts.append((t_us, values))
            else:
                self._parts.append(_registers(np.array(self._fresh, np.int64)))
            self._lines.append(np.array(self._fresh_lines))
            self._fresh, self._fresh_lines = [], []

    def _close(self, number: int, good_before: int) -> None:
        """Make items of the rows and the garbage before this line."""
        self._good_up_to(good_before)
        self._settle()
        none = self._none[self._begun : number]
        bad = np.flatnonzero(none) + self._begun
        lines = np.concatenate(self._lines) if self._lines else np.zeros(0, np.int64)
        if self._parts:
            before = np.searchsorted(bad, lines)
            t_us, values = (np.concatenate(each) for each in zip(*self._parts, strict=True))
            self._items.append(self._reader.rows(t_us, values, np.diff(before, prepend=0) > 0))
        if len(bad):
            count = int((self._ends[bad] - self._starts[bad] + 1).sum())
            self._items.append(Garbage(count, not len(lines) or bool(bad[-1] > lines[-1])))
        self._parts, self._lines, self._begun = [], [], number


def _registers(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return values[:, 0], values[:, 1:].astype(np.int16)
