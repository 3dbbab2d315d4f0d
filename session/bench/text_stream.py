"""The text form of a stream: lines of numbers, comments and headers (docs/formats.md).

A line carries no check.  It is protected by its form: it stands between two line ends, it has as many columns as the others, its numbers
are written as a program writes them (no sign without a digit, no leading zero), and registers fit 16 bits.  ``continuity`` examines its
stamp.  Lines that follow each other are parsed at once; single lines are parsed where they may hold something else.
"""

from __future__ import annotations

import re
from functools import cache
from typing import NamedTuple
from unicodedata import category

import numpy as np

from session.base.texts import printable
from session.bench.events import (
    CHANGES,
    REGISTERS,
    REMARKS,
    Allowance,
    Event,
    Info,
    SampleChunk,
    StreamFormat,
    joined_chunk,
    parse_header,
)

LONGEST_LINE = 512
SHAPING = "Cf"  #: Unicode's category of characters that only shape, join or reverse others
_WHOLE = rb"(?:-?[1-9][0-9]{0,17}|0)"
#: at most 18 digits before the point, no leading zero
_DECIMAL = rb"[-+]?(?:(?:0|[1-9][0-9]{0,17})(?:\.[0-9]{0,17})?|\.[0-9]{1,17})(?:[eE][-+]?[0-9]{1,2})?"
_FURTHER = re.compile(rb"[-+.\w ]*")
_PAIR = re.compile(r"\b(\w++)=(\S+)")
_LATEST_US, _EXACT = 2**60, 2**53
FEWEST_COMMAS = 6  #: of a line of numbers, and of a header
#: lines of another width that must follow each other before the width changes
WIDTH_CHANGE = 3


@cache
def _run(width: int, form: StreamFormat) -> re.Pattern[bytes]:
    """Whole lines of so many numbers, as many as follow each other, and empty ones behind them."""
    number = _DECIMAL if form.physical else _WHOLE
    stamp = _DECIMAL if form.time_us > 1.0 else rb"(?:[1-9][0-9]{0,17}|0)"
    text = rb"(?:%s(?:,%s){%d}+\n++)++" % (stamp, number, width - 1)
    return re.compile(text)


def _parse_run(lines: bytes, width: int, order: tuple[int, ...], form: StreamFormat) -> tuple[np.ndarray, np.ndarray] | None:
    """Stamps (n,) int64, whole us, and values of lines of a run; None where one of them is to be parsed for itself."""
    table = np.fromstring(b",".join(lines.split()), float if form.physical else np.int64, sep=",").reshape(-1, width)[:, order]
    stamps, values = table[:, 0], table[:, 1:]
    if not form.physical:
        return (stamps, values.astype(np.int16)) if ((values >= -32768) & (values <= 32767)).all() else None
    exact = form.time_us >= 1.0 and stamps.min() >= 0 and stamps.max() * form.time_us < _EXACT
    return (np.rint(stamps * form.time_us).astype(np.int64), values) if exact and (np.abs(values) <= form.limits).all() else None


def parse_line(line: bytes, order: tuple[int, ...] = tuple(range(8)), form: StreamFormat = REGISTERS) -> tuple[int, list] | None:
    """The number of columns of a line of numbers, and the log's: the stamp in whole us, and the values; None for another line, and for
    values that no sensor measures."""
    number = _DECIMAL if form.physical else _WHOLE
    cells = [cell.strip(b" \t") for cell in line.split(b",")]
    numbers = len(cells) > max(order) and all(re.fullmatch(number, cells[i]) for i in order)
    if not numbers or not all(map(_FURTHER.fullmatch, cells)):  # a further one holds other characters
        return None
    stamp, *values = [cells[i] for i in order]
    if not form.physical:
        t_us, registers = int(stamp), [int(value) for value in values]
        return (len(cells), [t_us, *registers]) if t_us >= 0 and min(registers) >= -32768 and max(registers) <= 32767 else None
    if form.time_us <= 1.0 and not stamp.isdigit():
        return None  # us and ns are whole numbers
    t_us = int(stamp) // 1000 if form.names[0] == "t_ns" else round(float(stamp) * form.time_us)
    read = [float(value) for value in values]
    if not 0 <= t_us < _LATEST_US or any(abs(value) > limit for value, limit in zip(read, form.limits, strict=True)):
        return None
    return len(cells), [t_us, *read]


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
        latitude = float(pairs["latitude_deg"]) if "latitude_deg" in pairs else None
    except (KeyError, ValueError):
        return None
    sound = all(0 < number < 1e6 for number in numbers)
    return Info(gyro, accel, odr, pairs.get("serial", ""), pairs.get("sensor", ""), latitude) if sound else None


class Garbage(NamedTuple):
    """Unreadable lines: length in bytes; behind: whether some came behind all rows so far."""

    length: int
    behind: bool


Item = SampleChunk | Event | Garbage | Info | StreamFormat


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
        self._items: list[Item] = []
        self._begin()

    def _begin(self) -> None:
        """The next rows, and the unreadable lines among them."""
        self._rows: list[SampleChunk] = []
        self._unreadable, self._behind = 0, False  # bytes; whether some came behind the last row

    def is_line(self, line: bytes) -> bool:
        """Whether a line proves that the stream is text."""
        if line.count(b",") < FEWEST_COMMAS:
            return parse_comment(line) is not None
        return bool(parse_comment(line) is not None or self.parse(line) or parse_header(line))

    def take(self, block: bytes, torn: np.ndarray | None = None) -> list[Item]:
        """What the lines hold, in order; a ``StreamFormat`` where a header changes the columns.  torn (lines,) bool: incomplete lines."""
        torn = torn if torn is not None and torn.any() else None
        number = at = 0
        while at < len(block):
            run = _run(self.width, self.form).match(block, at) if self.width and not self.deaf and torn is None else None
            stop = run.end() if run else block.index(b"\n", at) + 1
            if run and (rows := _parse_run(run[0], self.width, self._order, self.form)) is not None:
                self._add(*rows)
                self.other_count = 0
                self.place += stop - at
            else:
                for line in block[at:stop].split(b"\n")[:-1]:
                    if line if torn is not None and torn[number] else line.strip() and not self._read(line):
                        self._unreadable, self._behind = self._unreadable + len(line) + 1, True
                    self.place += len(line) + 1
                    number += 1
            at = stop
        self._close()
        items, self._items = self._items, []
        return items

    def _read(self, line: bytes) -> bool:
        """Whether a line is a comment that may come now, numbers as wide as the others, or a header."""
        if line.startswith(b"#"):
            comment = parse_comment(line) if self.remarks.spend() else None
            if comment is None:
                return False
            self._close()
            self._items.append(Event("comment", text=comment))
            if info := parse_info(comment):
                self._items.append(info)
            return True
        if line.count(b",") < FEWEST_COMMAS:
            return False
        if not self.deaf and (found := self.parse(line)):
            if not self._has_width(found[0]):
                return False
            t_us, *values = found[1]
            self._add(np.array([t_us]), np.array([values], float if self.form.physical else np.int16))
            return True
        header = parse_header(line)
        if header is not None and (self.deaf or header != (self.width, self._order, self.form)):
            self._obey(header)
        return header is not None

    def _add(self, t_us: np.ndarray, values: np.ndarray) -> None:
        damaged = np.zeros(len(t_us), bool)
        damaged[0], self._behind = self._behind, False
        self._rows.append(SampleChunk(t_us, values, self.form, damaged))
        self.remarks.at += len(t_us)

    def _close(self) -> None:
        """Make items of the rows and of the unreadable lines so far."""
        if self._rows:
            self._items.append(joined_chunk(self._rows))
        if self._unreadable:
            self._items.append(Garbage(self._unreadable, self._behind))
        self._begin()

    def parse(self, line: bytes) -> tuple[int, list] | None:
        """How many columns a line of numbers has, and the log's; None where it is none."""
        return parse_line(line, self._order, self.form)

    def _obey(self, header: tuple[int, tuple[int, ...], StreamFormat]) -> None:
        """Apply a header.

        One that changes the format too soon after others is not applied, and lines of numbers are ignored (``deaf``) until one is.
        """
        changes = header[2] != self.form
        self.deaf = changes and self.place < self._changes.earliest
        if self.deaf:
            return
        if changes:
            self._close()
            self._changes.spend(self.place)
            self._items.append(header[2])
        self.width, self._order, self.form = header

    def _has_width(self, width: int) -> bool:
        """Whether a line is as wide as the others: a line made of two halves may look whole, but hardly three times in a row."""
        if width == self.width or not self.width:
            self.width, self.other_count = width, 0
            return True
        self.other_count = self.other_count + 1 if width == self._other_width else 1
        self._other_width = width
        if self.other_count >= WIDTH_CHANGE and not self.form.physical:
            self.width, self._order = width, tuple(range(len(REGISTERS.names)))
        return False
