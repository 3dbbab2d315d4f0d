"""Rows of one sensor among others: known by the word or the width that they have, or by a column that states which sensor it was.

A text log may hold a flight controller's whole day (``IMU, …`` and ``ATT, …``), or two sensors in turn (a column ``I`` of 0 and 1).  Read
as one sensor, every row of the others is a false reading.  So such a log is read where a person states which rows, and else refused.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence

from session.base.errors import FormatError
from session.base.texts import listed
from session.log import one_sensor
from session.log.one_sensor import LEAST_ROWS, Form, bare

#: a row's first cell where it is a word
WORD = re.compile(r'\s*+"?([A-Za-z$][\w.$-]*+)"?\s*(?:[,;\t]|\s)')
#: what ArduPilot calls the columns of a kind: ``FMT, 131, 48, IMU, QfffffffIIfBB, TimeUS,GyrX,…``
FORMAT_WORD, FORMAT_KIND, FORMAT_NAMES = "FMT", 3, 5
#: other rows of such a log that no sensor made, and words that begin what a sensor made
PARAMETER_WORD, SENSOR_WORDS = "PARM", ("IMU", "RAW", "GYR")
#: the share of a log's first rows that is no accident
SHARE = 0.1
#: of a log: beyond any
MOST_LINES = 10**12
#: a comma at the end of some rows makes one column more
WIDER = 2


def row_word(rows: str | None) -> str | None:
    """The word that the wanted rows begin with, where ``--rows`` is one."""
    return None if rows is None or rows.isdigit() else rows


def in_head(lines: list[str], kind: str | None) -> list[str]:
    """A log's first lines with blanks in the place of other kinds' rows, of a kind that is known by its word; a line that describes the
    kind becomes its header."""
    if kind is None:
        return lines
    kept, begun = [], False
    for line in lines:
        word = word_of(line)
        begun |= word == kind
        # The header of a kind, where an ArduPilot log's line describes it: rows have its name in the place of what is before the
        # columns.
        header = ",".join((kind, *line.split(",")[FORMAT_NAMES:])) if _described_kind(line) == kind else None
        alone = word == kind or (not begun and word != FORMAT_WORD)
        kept.append(header or (line if alone else ""))
    return kept


def span_of(lines: str | None) -> tuple[int, int]:
    """The first line and the last, from 1, of ``FIRST-LAST``; all where None.  FormatError where it is no such span."""
    first, dash, last = (lines if lines is not None else "-").partition("-")
    begin, end = (int(text) if text.isdigit() else default if not text else -1 for text, default in ((first, 1), (last, MOST_LINES)))
    if not dash or not 1 <= begin <= end:
        raise FormatError(f"--lines is {(lines or '')[:40]!r}, expected FIRST-LAST, such as 1-2991")
    return begin, end


#: what stands in a cell for a reading that a slower sensor did not have
EMPTY_CELLS = ("", "nan", "null", "none", "na", "n/a", "-")


def holds(cells: Sequence[str], columns: Collection[int]) -> bool:
    """Whether a row has a reading in any of the columns, or does not have the columns: then it is torn, which its reader reports."""
    return any(column >= len(cells) or bare(cells[column]).lower() not in EMPTY_CELLS for column in columns)


def sparse(lines: Sequence[str], form: Form, kinds: Mapping[str, Collection[int]]) -> tuple[str, ...]:
    """The kinds of quantities, each with its columns, of a log whose first rows lack all readings of one of them again and again: a slower
    sensor's.  Empty where none is slower."""
    rows = [line.split(form.delimiter) for line in lines if line.strip() and not line.lstrip().startswith("#")]
    held = {kind: sum(holds(row, columns) for row in rows) for kind, columns in kinds.items()}
    if len(rows) < LEAST_ROWS or form.delimiter is None or min(held.values(), default=0) >= (1 - SHARE) * len(rows):
        return ()
    return tuple(kind for kind in kinds if held[kind] or kind != "temp")


class Rows:
    """Keeps the rows that are wanted; ``left_out`` counts the others.  Raises FormatError for a column that is not there."""

    def __init__(self, rows: str | None, where: str | None, form: Form, held: Collection[int] = ()):
        """rows: the word that the wanted ones begin with, or how many columns they have; where: ``NAME=VALUE``; held: columns, of which a
        row has a reading in one at least."""
        self._delimiter, self.left_out, self._held = form.delimiter, 0, held
        self._word = row_word(rows)
        self._width = None if rows is None or self._word else int(rows)
        self._column, self._value = None, ""
        if where is not None:
            called, equals, self._value = (part.strip() for part in where.partition("="))
            if not equals or not called or not self._value:
                raise FormatError(f"where is {where!r}, expected NAME=VALUE, the column's name or its number from 1")
            self._column = place_of(called, form)

    def __call__(self, lines: list[str]) -> list[str]:
        """The lines, with blanks in the place of rows that are not wanted: each line keeps its number."""
        if self._held:
            lines = [line if holds(line.split(self._delimiter), self._held) else "" for line in lines]
        if (self._word, self._width, self._column) == (None, None, None):
            return lines
        kept = [line if self._mine(line) else "" for line in lines]
        self.left_out += sum(bool(line.strip()) and not mine for line, mine in zip(lines, kept, strict=True))
        return kept

    def _mine(self, line: str) -> bool:
        if not line.strip() or line.lstrip().startswith("#"):
            return True
        if self._word is not None and word_of(line) != self._word:
            return False
        cells = line.split(self._delimiter)
        if self._width is not None and _width(cells) != self._width:
            return False
        return self._column is None or (self._column < len(cells) and _same(bare(cells[self._column]), self._value))


class Watch(one_sensor.Watch):
    """Refuses rows of several kinds as well."""

    def __init__(self, lines: list[str], form: Form):
        """lines: the first rows that are wanted.  Raises FormatError, which states which rows there are and how to pick one kind."""
        rows = form.rows(lines)
        refuse_kinds(rows, form)
        cells = [row.split(form.delimiter) for row in rows]
        widths = Counter(map(_width, cells))
        often = [width for width, count in widths.most_common() if count >= max(2, SHARE * len(cells)) and width > max(form.read)]
        if len(cells) >= LEAST_ROWS and len(often) > 1 and abs(often[0] - often[1]) >= WIDER:
            several = f"rows of {often[0]} and rows of {often[1]} columns, so of several kinds"
            raise FormatError(f"{form.file}: {several}; give --rows {often[0]}")
        self._begin_with_words = bool(rows) and all(word_of(row) is not None for row in rows)
        super().__init__(lines, form)

    def __call__(self, lines: list[str]) -> None:
        """Raises FormatError for rows of another kind or sensor than the first."""
        if self._begin_with_words:
            refuse_kinds(self.form.rows(lines), self.form)
        super().__call__(lines)


def sensor_kinds(lines: Sequence[str]) -> list[str]:
    """The kinds of rows that an ArduPilot log's lines describe with a gyroscope's and an accelerometer's columns."""
    found = []
    for line in lines:
        kind = _described_kind(line)
        names = [cell.strip().lower() for cell in line.split(",")[FORMAT_NAMES:]] if kind is not None else []
        if kind is not None and {"gyrx", "accx"} <= set(names):
            found.append(kind)
    return list(dict.fromkeys(found))


def word_of(line: str) -> str | None:
    """The word that a row begins with; None where it begins with a number."""
    found = WORD.match(line)
    return None if found is None else found[1]


def refuse_kinds(rows: Sequence[str], form: Form) -> None:
    """FormatError where rows begin with several words: those that a log describes, or that have widths of their own.

    Words under a header, in rows of one width, are no kinds: somebody has labelled the rows.
    """
    described = [kind for row in rows if (kind := _described_kind(row)) is not None]
    begun = [(word, row) for row in rows if (word := word_of(row)) not in (None, FORMAT_WORD)]
    words = Counter(word for word, _ in begun if word is not None)
    kinds = Counter({word: count for word, count in words.items() if count > 1} | {kind: max(words[kind], 1) for kind in described})
    if len(kinds) < 2 or (not described and len(begun) < max(LEAST_ROWS, (1 - SHARE) * len(rows))):
        return
    widths = {word: _width(row.split(form.delimiter or ",")) for word, row in begun if word in kinds}
    if described or not form.header_line or max(widths.values()) - min(widths.values()) >= WIDER:
        named = [word for word, _ in kinds.most_common() if word not in (FORMAT_WORD, PARAMETER_WORD)]
        longest = max(named, key=lambda word: widths.get(word, 0))
        meant = next((word for word in named if word.lstrip("$").upper().startswith(SENSOR_WORDS)), longest)
        some = listed(named, 6)
        raise FormatError(f"{form.file}: rows of several kinds ({some}), by the words that they begin with; give --rows {meant}")


def _described_kind(line: str) -> str | None:
    """The kind of rows that an ArduPilot log's line describes."""
    cells = line.split(",") if word_of(line) == FORMAT_WORD else []
    return cells[FORMAT_KIND].strip() if len(cells) > FORMAT_NAMES else None


def place_of(called: str, form: Form) -> int:
    """The column of a name, or of a number from 1.  FormatError where there is none."""
    names = [each.lower() for each in form.names]
    if called.lower() in names:
        return names.index(called.lower())
    if called.isdigit() and 1 <= int(called) <= len(names):
        return int(called) - 1
    raise FormatError(f"{form.file}: no column {called!r} (where {called}=…) among {', '.join(form.names)[:80]}")


def _same(cell: str, value: str) -> bool:
    try:
        return cell == value or float(cell) == float(value)
    except ValueError:
        return False


def _width(cells: Sequence[str]) -> int:
    return len(cells) - (not cells[-1].strip())
