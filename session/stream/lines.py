"""Whole lines of text into rows of numbers, comments, and what is neither."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.stream.events import Comment, Info
from session.stream.form import REGISTERS, Form, parse_header
from session.stream.text import parse_comment, parse_decimals, parse_info, parse_line, parse_lines

#: lines of another width that must come one after the other before they are believed
WIDTH_CHANGE = 3


@dataclass(frozen=True, eq=False)
class Rows:
    """Consecutive lines of numbers: t_us (n,) int64 as sent; values (n, 7) int16 registers, or (n, 6 or 7) float64."""

    t_us: np.ndarray
    values: np.ndarray


@dataclass(frozen=True)
class Garbage:
    """Bytes of a line that is none."""

    count: int


Item = Rows | Comment | Info | Garbage | Form


class LineReader:
    """form: what the columns are, registers until a header says otherwise; ``take`` blocks that end with a line's end.

    told: the header of a stream that does not send it.
    """

    def __init__(self, told: str | None = None):
        header = None if told is None else parse_header(told.encode())
        self.form, self._width, self._order = REGISTERS, 0, tuple(range(len(REGISTERS.names)))
        if header is not None:
            self._width, self._order, self.form = header
        self._other_width, self._other_count = 0, 0

    def is_line(self, line: bytes) -> bool:
        """Whether a line shows that this is text."""
        return bool(parse_comment(line) is not None or parse_header(line) or self._parse(line))

    def take(self, block: bytes) -> list[Item]:
        """What the lines say, in order; a ``Form`` where a header changes what the columns are."""
        good = None
        if self._width and not self.form.physical:
            good, values = parse_lines(block, self._width, self._order)
            if good.all():
                self._other_count = 0
                return [_registers(values)]
        items: list[Item] = []
        rows: list[list] = []
        done = 0
        for number, line in enumerate(block.split(b"\n")[:-1]):
            if good is not None and good[number]:
                rows.append(values[done].tolist())
                done += 1
                self._other_count = 0
                continue
            found, width = self._parse(line), self._width
            if found and self._has_width(found[0]):
                rows.append(found[1])
                continue
            if self._width != width:  # what was looked at all at once was so with the width before
                good = None
            self._close(rows, items)
            if not line.strip():
                continue
            comment, header = parse_comment(line), parse_header(line)
            if comment is not None:
                items.append(Comment(comment))
                if info := parse_info(comment):
                    items.append(info)
            elif header:
                self._width, self._order, form = header
                if form != self.form:
                    self.form = form
                    items.append(form)
                # What follows is looked at line by line in this block, and all at once from the next on.
                good = None
            else:
                items.append(Garbage(len(line) + 1))
        self._close(rows, items)
        return items

    def _parse(self, line: bytes) -> tuple[int, list] | None:
        return parse_decimals(line, self._order, self.form) if self.form.physical else parse_line(line, self._order)

    def _close(self, rows: list[list], items: list[Item]) -> None:
        if rows:
            items.append(_physical(rows) if self.form.physical else _registers(np.array(rows, np.int64)))
            rows.clear()

    def _has_width(self, width: int) -> bool:
        """Whether a line is as wide as the others: one of two halves may look whole, but hardly thrice running."""
        if width == self._width or not self._width:
            self._width, self._other_count = width, 0
            return True
        self._other_count = self._other_count + 1 if width == self._other_width else 1
        self._other_width = width
        if self._other_count >= WIDTH_CHANGE and not self.form.physical:
            self._width, self._order = width, tuple(range(len(REGISTERS.names)))
        return False


def _registers(values: np.ndarray) -> Rows:
    return Rows(values[:, 0], values[:, 1:].astype(np.int16))


def _physical(rows: list[list]) -> Rows:
    return Rows(np.array([row[0] for row in rows], np.int64), np.array([row[1:] for row in rows], float))
