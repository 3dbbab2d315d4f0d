"""The text form of a stream, line by line: the log's own lines (docs/formats.md).

A line carries no check.  What protects it: it stands between two line ends, it has the columns that the others have, its numbers are
written as a program writes them (no sign without a digit, no leading zero), registers fit 16 bits; and ``continuity`` looks at its stamp.
"""

from __future__ import annotations

import re
from unicodedata import category

import numpy as np

from session.common.texts import printable
from session.stream.events import Info
from session.stream.form import COLUMNS, Form

LONGEST_LINE = 512
SHAPING = "Cf"  #: of Unicode's categories: signs that shape, join or turn others round, and show nothing
_NUMBER = re.compile(rb"-?[1-9][0-9]{0,17}|0")
#: as a program writes them: at most 18 digits before the point, no leading zero
_DECIMAL_TEXT = rb"[-+]?(?:(?:0|[1-9][0-9]{0,17})(?:\.[0-9]{0,17})?|\.[0-9]{1,17})(?:[eE][-+]?[0-9]{1,2})?"
_DECIMAL = re.compile(_DECIMAL_TEXT)
_DECIMALS = re.compile(_DECIMAL_TEXT + rb"(?:," + _DECIMAL_TEXT + rb")*")
_FURTHER = re.compile(rb"[-+.\w ]*")
_PAIR = re.compile(r"(\w+)=(\S+)")
_LONGEST_NUMBER = 19
_LATEST_US = 2**60

# What a byte may be in a line of whole numbers.
_DIGIT, _ZERO, _MINUS, _COMMA, _END = 1, 2, 3, 4, 5
_CLASS = np.zeros(256, np.uint8)
_CLASS[list(b"123456789")] = _DIGIT
_CLASS[ord("0")], _CLASS[ord("-")], _CLASS[ord(",")], _CLASS[ord("\n")] = _ZERO, _MINUS, _COMMA, _END

_BLANK = np.zeros(256, bool)
_BLANK[list(b" \t\n\r\x0b\x0c")] = True

#: columns of a line of numbers, at the least, and the digits in them
_FEWEST = 7


class Looks:
    """What lines of codes (n,) uint8, from starts up to ends, can be, all at once: blank (k,) bool, and worth (k,), which may be
    a comment, a header or numbers, and want a closer look."""

    def __init__(self, codes: np.ndarray, starts: np.ndarray, ends: np.ndarray):
        def count(mask: np.ndarray) -> np.ndarray:
            total = np.concatenate([[0], np.cumsum(mask, dtype=np.int32)])
            return total[ends] - total[starts]

        cells = count(codes == ord(",")) + 1 >= _FEWEST
        lengths, kind = ends - starts, _CLASS[codes]
        numbers = cells & (count((kind == _DIGIT) | (kind == _ZERO)) >= _FEWEST)
        header = cells & (count(codes == ord("g")) >= 3) & (count(codes == ord("a")) >= 3)
        comment = (lengths > 0) & (codes[np.minimum(starts, len(codes) - 1)] == ord("#"))
        self.blank = count(_BLANK[codes]) == lengths
        self.worth = numbers | header | comment


def parse_lines(block: bytes, columns: int, order: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
    r"""Many lines at once: block ends with ``\n``, a line has ``columns`` whole numbers, of which ``order`` are the log's eight.

    Returns good (lines,) bool and values (good lines, 8) int64.  A line that is not good may still be one for ``parse_line``.
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


def parse_line(line: bytes, order: tuple[int, ...] = tuple(range(8))) -> tuple[int, list[int]] | None:
    """One line, blanks allowed, further columns of any kind: how many columns, and the log's eight; None where it is no such line."""
    cells = [cell.strip(b" \t") for cell in line.split(b",")]
    if len(cells) <= max(order) or not all(_NUMBER.fullmatch(cells[i]) for i in order) or not all(map(_FURTHER.fullmatch, cells)):
        return None
    values = [int(cells[i]) for i in order]
    return (len(cells), values) if values[0] >= 0 and all(-32768 <= value <= 32767 for value in values[1:]) else None


def parse_decimals(line: bytes, order: tuple[int, ...], form: Form) -> tuple[int, list] | None:
    """One line in physical units: how many columns, and the stamp in whole us with the values; None where it is no such line, or holds
    what no sensor measures."""
    if _DECIMALS.fullmatch(line):  # at once, as nearly all lines are
        cells = line.split(b",")
        if len(cells) <= max(order):
            return None
    else:
        cells = [cell.strip(b" \t") for cell in line.split(b",")]
        if len(cells) <= max(order) or not all(_DECIMAL.fullmatch(cells[i]) for i in order) or not all(map(_FURTHER.fullmatch, cells)):
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
    r"""What stands behind the ``#`` of a comment; None where the line is none, or holds what no person wrote.

    Characters that only shape others, as the joiner within an emoji, are a person's: they stand there as ``\u200d``.
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
    """What a comment says of the board, or None where it is about something else."""
    said = dict(_PAIR.findall(comment))
    try:
        gyro, accel, odr = numbers = [float(said[name]) for name in ("gyro_fs_dps", "accel_fs_g", "odr_hz")]
    except (KeyError, ValueError):
        return None
    return Info(gyro, accel, odr, said.get("serial", ""), said.get("sensor", "")) if all(0 < number < 1e6 for number in numbers) else None
