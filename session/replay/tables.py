"""The reader of text logs of any program: the standard log's, of rows that are found in other text first."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.files import MB
from session.log.lines import PIECE_BYTES, Lines
from session.log.numbers import RowFault, has_rows, load, make_sound, require_era, stamps_of, with_whole_time
from session.log.numbers import fault as line_fault
from session.log.one_sensor import MOST_SENSORS, Form, refuse_turns
from session.log.reader import HEAD_LINES, Piece, Reader, first_of_content
from session.log.registers import profile_of
from session.log.stamps import COUNTER, DAY_NS, ERA_NS, Unroll
from session.replay.clock import exact_ns
from session.replay.dialects import TableLayout
from session.replay.forms import TORN, form_of
from session.replay.options import Answers
from session.replay.recognise import recognise
from session.replay.rows import Rows, Watch, holds, in_head, place_of, row_word, sensor_kinds, span_of, sparse, word_of

#: characters that are looked through for the first rows of one kind: a flight controller writes its formats and parameters first
MOST_HEAD = 16 * MB


class TableReader(Reader):
    """One text log of any program."""

    layout: TableLayout
    else_do = "or count samples: --time-unit none --odr HZ"

    def __init__(self, path: Path, answers: Answers, picking: str | None = None, only: str | None = None):
        """answers: what the log does not state.  picking: a column whose values separate several sensors, of which ``values_of`` gives
        them.  only: the quantity that is read, one of ``parts``: those of a table that has no reading of a slower sensor in many of its
        rows.

        Raises FormatError for what cannot be read or recognised, and for rows of several sensors of which none are picked.
        """
        self._begin(path)
        self._first_line, self._last_line = span_of(answers.lines)
        head = self._head_of(answers.rows)
        if not answers.rows and len(kinds := sensor_kinds(head)) == 1:
            answers = replace(answers, rows=kinds[0])
            head = self._head_of(answers.rows)
            self.notes.append(f"rows {kinds[0]} are taken: those that hold a gyroscope")
        if not any(line.strip() for line in head):
            raise self._empty()
        self._text_form = None if answers.rows else form_of(head, answers.packed, path.name)
        if self._text_form is None:
            layout = recognise(head, path.name, answers, picking)
        else:
            form, begins = self._text_form, head
            head = [form.header] * bool(form.header) + form(begins)
            layout = recognise(head, path.name, answers, picking, form.name)
            head = head[bool(form.header) :]
            layout = replace(layout, first=layout.first - bool(form.header))
            self.notes.append(f"{form.name}: read as a table")
            named = {profile.name for line in begins if (profile := profile_of(line)) is not None}
            if len(named) == 1:  # what a sketch prints when it begins: MPU-6050 ready
                self.comments["sensor"] = named.pop()
                self.notes.append(f"the sensor is {self.comments['sensor']}, as a line without readings states")
            self._text_form = form_of(begins, answers.packed, path.name)  # one that remembers nothing of these lines
        self.comments |= layout.facts
        columns = Form(path.name, layout.delimiter, layout.names, layout.used, layout.header_line)
        if picking is not None:
            columns = replace(columns, read=(*layout.used, place_of(picking, columns)))
        picked = answers.rows, answers.where
        places, rows = {kind: own for kind, own, _ in layout.kinds}, Rows(*picked, columns)(head[layout.first :])
        self.parts = () if only or layout.time is None or self._stream else sparse(rows, columns, places)
        empty = ""
        if only is not None:
            lack = sum(map(bool, rows)) - sum(map(bool, Rows(*picked, columns, places[only])(rows)))
            cells = f"the cells of {', '.join(map(layout.name, places[only]))}"
            empty = f"{cells} are empty in {lack} of the first {sum(map(bool, rows))} rows: read as a log of its own" if lack else ""
        self._wanted = Rows(*picked, columns, places[only] if only else ())
        self._go_by(layout if only is None else layout.only(only), Watch(rows, columns))
        self.notes += [empty] if empty else []
        if picking is None and answers.where is None and layout.time is not None:
            refuse_turns(head[layout.first :], layout.time, columns)
        self.picks_rows = any((*picked, answers.lines is not None))
        self.is_clock = layout.clock
        self._added = 0  # ns, of intervals so far
        self._commas = False  # in the place of decimal points; whole numbers at the beginning do not show it

    def pieces(self, size: int = PIECE_BYTES, *, as_written: bool = False) -> Iterator[Piece]:
        """All rows, a few ten thousand at a time.  Raises FormatError with the line that is at fault."""
        yield from super().pieces(size, as_written=as_written)
        if self._text_form is not None and self._text_form.left_out:
            self._note(f"{self._text_form.left_out} lines hold no reading: left out")
        if self._wanted.left_out:
            self._note(f"{self._wanted.left_out} rows of other kinds or sensors: left out")

    def values_of(self, name: str) -> list[str]:
        """The values of a column in the rows that are wanted, in their order.  FormatError where they are too many for sensors."""
        columns = Form(self.path.name, self.layout.delimiter, self.layout.names, ())
        place, found = place_of(name, columns), dict[str, None]()
        with Lines(self.path) as file:
            number, lines = 1, file.take()
            while lines:
                skip = max(self.layout.first - number + 1, 0)
                for line in self._rows(lines, number, skip):
                    cells = line.split("#")[0].split(self.layout.delimiter)
                    if place < len(cells) and (cell := cells[place].strip().strip('"').strip()) and line.strip() != self.layout.header_line:
                        found[cell] = None
                if len(found) > MOST_SENSORS:
                    raise FormatError(
                        f"{self.path.name}: the column {name!r} holds more than {MOST_SENSORS} values; it separates no sensors"
                    )
                number, lines = number + len(lines), file.take()
        return list(found)

    def _head_of(self, wanted: str | None) -> list[str]:
        """The first lines, or, where the wanted rows begin with a word, those among which enough of them stand."""
        word = row_word(wanted)
        begun, found, characters = False, 0 if word else HEAD_LINES, 0

        def is_enough(lines: list[str]) -> bool:
            nonlocal begun, found, characters
            begun |= first_of_content(lines) is not None
            found, characters = found + sum(word_of(line) == word for line in lines), characters + sum(map(len, lines))
            return begun and (found >= HEAD_LINES or characters >= MOST_HEAD)

        lines = self._head(is_enough, None if word else HEAD_LINES)
        if word and not found:
            raise FormatError(f"{self.path.name}: no row begins with {word!r} (rows); give the word that the sensor's rows begin with")
        return in_head(lines, word)

    def _unroll_of(self) -> Unroll:
        layout = self.layout
        if layout.clock or layout.finer:
            return Unroll(DAY_NS if layout.clock else None, None)
        return Unroll(None if COUNTER * layout.time_ns > ERA_NS else round(COUNTER * layout.time_ns), layout.time_ns)

    def _as_table(self, lines: list[str], number: int) -> list[str]:
        """The lines from ``number`` on as a table's, with blanks in the place of those that are not meant."""
        first, last = self._first_line - number, self._last_line - number
        if first > 0 or last < len(lines) - 1:
            lines = [line if i < self.layout.first or first <= i <= last else "" for i, line in enumerate(lines)]
        return lines if self._text_form is None else self._text_form(lines)

    def _rows(self, lines: list[str], number: int, skip: int = 0) -> list[str]:
        return self._wanted(self._as_table(lines, number)[skip:])

    def _wrong_row(self, line: str) -> str:
        return self._text_form.torn if self._text_form is not None and line == TORN else ""

    def _parse(self, lines: list[str], unsigned: set[str] | None = None) -> tuple[np.ndarray, np.ndarray | None]:
        lines = self._with_points(lines)
        try:
            table, stamps = _parse(lines, self.layout, unsigned)
        except ValueError:
            if unsigned is None or self._commas or not self._has_decimal_commas(lines):
                raise
            self._commas = True
            return self._parse(lines, unsigned)
        if unsigned is not None and stamps is not None and len(stamps) and self.layout.intervals:
            stamps = self._added + np.cumsum(stamps)
            self._added = int(stamps[-1])
        return table, stamps

    def _with_points(self, lines: list[str]) -> list[str]:
        return [line.replace(",", ".") for line in lines] if self._commas else lines

    def _fault(self, line: str) -> str | None:
        return _fault(line, self.layout)

    def _repaired(self, lines: list[str], number: int, last: bool) -> list[str]:
        """Without a header that comes again, as well."""
        header = self.layout.header_line
        kept = ["" if line.strip() == header else line for line in lines]
        if header and kept != lines:
            self._note("the header comes again (the logger was restarted?): left out")
        held = [line if holds(line.split(self.layout.delimiter), self.layout.numbers) else "" for line in kept]
        if self.layout.time is not None and held != kept:  # else each counts
            self._note("rows without any reading: left out")
            kept = held
        return super()._repaired(self._with_points(kept), number, last)

    def _has_decimal_commas(self, lines: list[str]) -> bool:
        """Whether numbers of these rows have commas in them, and none has a point: 1,234 next to 0.5 may be a thousand."""
        if self.layout.delimiter not in (";", "\t"):
            return False
        rows = (line.split("#")[0].split(self.layout.delimiter) for line in lines if line.strip() != self.layout.header_line)
        # Of a date, the time.
        cells = [row[column].strip().split(" ")[-1] for row in rows for column in self.layout.used if column < len(row)]
        return any("," in cell for cell in cells) and not any("." in cell for cell in cells)


# Lines of any program's table into numbers and stamps: cells in quotes, clocks, seconds in several columns.

QUOTE = '"'
OPEN = "a quotation mark that is not closed"


def _parse(lines: list[str], layout: TableLayout, unsigned: set[str] | None = None) -> tuple[np.ndarray, np.ndarray | None]:
    """As ``session.log.numbers.parse``; no stamps where nothing stamps the rows."""
    if not has_rows(lines):
        return np.zeros((0, len(layout.numbers))), None
    if QUOTE in "".join(lines) and any(map(_opens, lines)):
        raise ValueError(OPEN)  # NumPy would read on to the next quotation mark, over however many lines
    if layout.finer:
        table, time = load(lines, layout.numbers, layout, np.float64, quote=QUOTE), _summed(lines, layout)
    elif layout.time is None or layout.clock:
        table, time = load(lines, layout.numbers, layout, np.float64, quote=QUOTE), None
    else:
        table, time = _with_time(lines, layout)
    make_sound(table, time, layout, set() if unsigned is None else unsigned, "is its unit right?")
    if layout.time is None or layout.finer:
        return table, time
    return table, stamps_of(time, lines, layout, exact_ns, QUOTE)


def _opens(line: str) -> bool:
    """Whether a cell begins with a quotation mark, and one is not closed in its line."""
    return QUOTE in line and (line := line.split("#")[0]).count(QUOTE) % 2 == 1 and re.search(r'(?:^|[,;\t ])"', line) is not None


def _with_time(lines: list[str], layout: TableLayout) -> tuple[np.ndarray, np.ndarray]:
    """Numbers (N, …) and times (N,) in their unit, whole where the first row's is."""
    row = next(line for line in lines if line.lstrip()[:1] not in ("", "#")).split(layout.delimiter)
    column = layout.time_column
    if column < len(row) and re.fullmatch(r"[-+]?[0-9]+", row[column].strip().strip(QUOTE)):
        with contextlib.suppress(ValueError):  # the others need not be
            return with_whole_time(lines, layout, QUOTE)
    rows = load(lines, layout.used, layout, np.float64, quote=QUOTE)
    return rows[:, 1:], rows[:, 0]


def _summed(lines: list[str], layout: TableLayout) -> np.ndarray:
    """(N,) int64 ns of a time in several columns, whole seconds and their fraction.  RowFault where a fraction is more than the unit
    before it."""
    columns, units = (layout.time_column, *(column for column, _ in layout.finer)), (layout.time_ns, *(ns for _, ns in layout.finer))
    try:
        parts = load(lines, columns, layout, np.int64, quote=QUOTE)
    except ValueError:  # fractions: exactly, from their text
        texts = load(lines, columns, layout, "U48", quote=QUOTE).tolist()
        exact = np.array([sum(exact_ns(text, ns) for text, ns in zip(row, units, strict=True)) for row in texts], dtype=object)
        require_era(np.abs(exact) < ERA_NS, lambda row: " + ".join(texts[row]), layout)
        return exact.astype(np.int64)
    for place, (column, unit_ns) in enumerate(layout.finer, start=1):
        most = units[place - 1] // unit_ns
        if most > 1 and not (fine := (parts[:, place] >= 0) & (parts[:, place] < most)).all():
            row = int(np.argmin(fine))
            raise RowFault(row, f"{layout.name(column)} is {parts[row, place]}, expected a second's fraction from 0 to {most - 1}")
    fine = np.all([np.abs(part) < ERA_NS // ns // len(units) for part, ns in zip(parts.T, units, strict=True)], axis=0)
    require_era(fine, lambda row: " + ".join(map(str, parts[row])), layout)
    return np.asarray(parts @ np.array(units))


def _fault(line: str, layout: TableLayout) -> str | None:
    """What is wrong with a line, by itself; None where nothing is."""
    if _opens(line):
        return OPEN
    return line_fault(line.replace(QUOTE, " "), layout, lambda cell: exact_ns(cell, layout.time_ns))
