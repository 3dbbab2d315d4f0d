"""The one reader of text logs: the rows of one file, in pieces, in constant memory whatever its length, or all at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.files import MB
from session.base.units import NS
from session.log.dialects import Answers, Layout, Triad
from session.log.forms import TORN, form_of
from session.log.lines import PIECE_BYTES, UTF_16_NOTE, Lines
from session.log.numbers import CORRECT, EMPTY, RowFault, fault, parse, unreadable, wrong_width
from session.log.recognise import recognise
from session.log.rows import MOST_SENSORS, Form, Rows, Wanted, Watch, place_of, refuse_turns, sensor_kinds, span_of, sparse
from session.log.stamps import COUNTER, DAY_NS, ERA_NS, TWO_PIECES, Unroll, bad_stamps, why_back
from session.log.standard import flagged, standard_layout

#: of text that is looked through for a header, from the first line that is neither blank nor a comment
HEAD_LINES, HEAD_BYTES = 400, 1 << 16
#: characters that are looked through for the first rows of one kind: a flight controller writes its formats and parameters first
MOST_HEAD = 16 * MB
#: characters in which a zero byte says that this is no text; further on it is a line that broke
TEXT_BEGINS = 1000
#: rows of one stamp, many times as many as the coarsest stamps, whole seconds, share at any sensor's rate
MOST_STANDING = 1_000_000
#: lines among which a board's words at its start may stand
BOOT_LINES = 200


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

    def __init__(
        self,
        path: Path,
        answers: Answers | None,
        wanted: Wanted | None = None,
        picking: str | None = None,
        gyro_alone: bool = False,
        only: str | None = None,
    ):
        """answers: options for a log of any dialect; None: it must be a standard log, to the letter of docs/formats.md.
        wanted: its rows that are meant, where that is not among the answers.  picking: a column whose values tell several sensors apart,
        of which ``values_of`` gives them.  gyro_alone: whether a standard log may lack an accelerometer.  only: the quantity that is read,
        one of ``parts``: those of a table that has no reading of a slower sensor in many of its rows.

        Raises FormatError for what cannot be read or recognised, and for rows of several sensors of which none are picked.
        """
        self.path = path
        self.notes: list[str] = []
        self.comments: dict[str, str] = {}
        self._stream: Lines | None = None  # what can be read but once: a pipe, standard input
        self._first_line, self._last_line = span_of(None if answers is None else answers.lines)
        wanted = wanted or (Wanted() if answers is None else Wanted(answers.rows, answers.where))
        head = self._head(wanted, answers is None)
        if answers is not None and not wanted.rows and len(kinds := sensor_kinds(head)) == 1:
            wanted, answers = Wanted(kinds[0], wanted.where), replace(answers, rows=kinds[0])
            head = self._head(wanted, standard=False)
            self.notes.append(f"rows {kinds[0]} are taken: those that hold a gyroscope")
        if not any(line.strip() for line in head) or (answers is None and _first_of_content(head) is None):
            raise FormatError(f"{path.name}: empty; expected a header line and samples; was the recording stopped before it began?")
        self._text_form = None if answers is None or wanted.rows else form_of(head, answers.packed, path.name)
        if answers is None:
            self.layout: Layout = standard_layout(head, path.name, gyro_alone)
        elif self._text_form is None:
            self.layout = recognise(head, path.name, answers, picking)
        else:
            form, begins = self._text_form, head
            head = [form.header] * bool(form.header) + form(begins)
            self.layout = recognise(head, path.name, answers, picking, form.name)
            head = head[bool(form.header) :]
            self.layout = replace(self.layout, first=self.layout.first - bool(form.header))
            self.notes.append(f"{form.name}: read as a table")
            self._text_form = form_of(begins, answers.packed, path.name)  # one that remembers nothing of these lines
        self.comments |= {**self.layout.facts, **flagged(self.layout.names)}
        self.notes += [self.layout.remark] if self.layout.remark else []
        layout = self.layout
        columns = Form(path.name, layout.delimiter, layout.names, layout.used, layout.header_line, layout.standard)
        if picking is not None:
            columns = replace(columns, read=(*layout.used, place_of(picking, columns)))
        places, rows = {kind: own for kind, own, _ in layout.kinds}, Rows(wanted, columns)(head[layout.first :])
        self.parts = () if answers is None or only or layout.time is None or self._stream else sparse(rows, columns, places)
        if only is not None:
            self.layout = layout = layout.only(only)
            lack = sum(map(bool, rows)) - sum(map(bool, Rows(wanted, columns, places[only])(rows)))
            cells = f"the cells of {', '.join(map(layout.name, places[only]))}"
            self.notes += [f"{cells} are empty in {lack} of the first {sum(map(bool, rows))} rows: read as a log of its own"] * bool(lack)
        self._wanted, self._watch = Rows(wanted, columns, places[only] if only else ()), Watch(rows, columns)
        if answers is not None and picking is None and wanted.where is None and layout.time is not None:
            refuse_turns(head[layout.first :], layout.time, columns)
        self.picks_rows = bool(wanted) or (answers is not None and answers.lines is not None)
        self._file: Lines | None = None
        self._unroll = Unroll(self._counter_ns(), None if self.layout.clock or self.layout.finer else self.layout.time_ns)
        self._before: int | None = None
        self._added = 0  # ns, of intervals so far
        self._stood_at, self._standing = 0, 0  # the last stamp, and rows of the pieces that held no other
        self._as_written = False
        self._rows, self._begins = 0, [(0, 1)]  # rows so far; of each piece, its first row, and its first line from 1
        self._unsigned: set[str] = set()  # kinds whose registers are
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
                piece = self._piece(self._mine(self._as_table(lines, number)[skip:]), number + skip, last=not following)
                if piece is not None:
                    self._require_time(piece, number + skip)
                    yield piece
                number, skip, lines = number + len(lines), max(skip - len(lines), 0), following
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
                for line in self._wanted(self._as_table(lines, number)[skip:]):
                    cells = line.split("#")[0].split(self.layout.delimiter)
                    if place < len(cells) and (cell := cells[place].strip().strip('"').strip()) and line.strip() != self.layout.header_line:
                        found[cell] = None
                if len(found) > MOST_SENSORS:
                    raise FormatError(
                        f"{self.path.name}: the column {name!r} holds more than {MOST_SENSORS} values; it tells no sensors apart"
                    )
                number, lines = number + len(lines), file.take()
        return list(found)

    def unrolled(self, stamps: np.ndarray) -> np.ndarray:
        """(N,) ns that go on, of all stamps (N,) ns as they were written: all of them together tell a counter from an epoch.

        Raises FormatError with the line from which they go back.
        """
        try:
            return self._unrolled(stamps, self._line_of)
        except RowFault as wrong:
            raise FormatError(f"{self.path.name} line {self._line_of(wrong.row)}: {wrong.what}; {wrong.do}") from None

    def _head(self, wanted: Wanted, standard: bool) -> list[str]:
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
        if "\0" in "\n".join(lines[:TEXT_BEGINS])[:TEXT_BEGINS] or (standard and file.note == UTF_16_NOTE):
            raise FormatError(f"{self.path.name}: not a text log (UTF-16 or binary); expected CSV in UTF-8")
        lines = [line if line.strip(EMPTY) else "" for line in lines]
        if wanted.word is None:
            return lines if first is None else lines[: first + HEAD_LINES]
        if not found:
            raise FormatError(
                f"{self.path.name}: no row begins with {wanted.word!r} (rows); give the word that the sensor's rows begin with"
            )
        return wanted.in_head(lines)

    def _counter_ns(self) -> int | None:
        """The span of the usual counter in which some stamps may be missing, ns; None where there is none."""
        layout = self.layout
        if layout.standard:
            return round(COUNTER * layout.time_ns) if layout.name(layout.time_column) == "t_us" else None
        if layout.clock:
            return DAY_NS
        return None if layout.finer or COUNTER * layout.time_ns > ERA_NS else round(COUNTER * layout.time_ns)

    def _as_table(self, lines: list[str], number: int) -> list[str]:
        """The lines from ``number`` on as a table's, with blanks in the place of those that are not meant."""
        first, last = self._first_line - number, self._last_line - number
        if first > 0 or last < len(lines) - 1:
            lines = [line if i < self.layout.first or first <= i <= last else "" for i, line in enumerate(lines)]
        return lines if self._text_form is None else self._text_form(lines)

    def _mine(self, lines: list[str]) -> list[str]:
        """The lines, with blanks in the place of rows that are not wanted.  FormatError for rows of another kind or sensor."""
        kept = self._wanted(lines)
        self._watch(kept)
        return kept

    def _piece(self, lines: list[str], number: int, last: bool) -> Piece | None:
        if self._commas:
            lines = _with_points(lines)
        if (wrong := wrong_width(lines, self.layout)) is not None:
            count, names = lines[wrong].count(self.layout.delimiter or "") + 1, len(self.layout.names)
            problem = f"{count} columns, expected {names}"
            self._refuse_restart(lines, wrong, number)
            if self._text_form is not None and lines[wrong] == TORN:
                problem = self._text_form.torn
            if not last or any(rest.strip() for rest in lines[wrong + 1 :]):
                hint = ", or save decimal commas with semicolons between the columns" if count > names else ""
                raise FormatError(f"{self.path.name} line {number + wrong}: {problem}; {CORRECT}{hint}")
            self.notes.append(f"line {number + wrong}, the last, is cut off ({problem}): left out")
            lines = [*lines[:wrong], *[""] * (len(lines) - wrong)]

        def line_of(row: int) -> int:
            return number + [i for i, line in enumerate(lines) if line.split("#")[0].strip(EMPTY)][row]

        try:
            try:
                table, stamps = parse(lines, self.layout, self._unsigned)
            except ValueError:
                # Only now, since it is slow: look for the line that is at fault.
                if not self._commas and self._has_decimal_commas(lines):
                    self._commas = True
                    lines = _with_points(lines)
                lines = self._repaired(lines, number, last)
                table, stamps = parse(lines, self.layout, self._unsigned)
            for places in (places for kind, places, _ in self.layout.kinds if kind in self._unsigned):
                self._note(f"{', '.join(map(self.layout.name, places))}: unsigned registers; 65535 is read as -1")
            if not len(table):
                return None
            if stamps is not None and self.layout.intervals:
                stamps = self._added + np.cumsum(stamps)
                self._added = int(stamps[-1])
            self._begins.append((self._rows, number))
            self._rows += len(table)
            t_ns = stamps if stamps is None or self._as_written else self._unrolled(stamps, line_of)
        except RowFault as wrong:
            raise FormatError(f"{self.path.name} line {line_of(wrong.row)}: {wrong.what}; {wrong.do}") from None
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
                for line in self._wanted(self._as_table(lines, at)):
                    is_row = line.split("#")[0].strip(EMPTY) and line.strip() != self.layout.header_line
                    if at >= number and at > self.layout.first and is_row:
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

    def _unrolled(self, stamps: np.ndarray, line_of: Callable[[int], int]) -> np.ndarray:
        """(N,) ns that go on from those before; single bad ones are put right.  RowFault where they go back."""
        name = self.layout.name(self.layout.time_column)
        if (stamps[1:] < stamps[:-1]).any() and len(bad := bad_stamps(stamps)):
            before, stamps = stamps, stamps.copy()
            stamps[bad] = (stamps[bad - 1] + stamps[bad + 1]) // 2
            value, right = (f"{t[bad[0]] / self.layout.time_ns:.15g}" for t in (before, stamps))
            more = f"; so are {len(bad) - 1} more such stamps" if len(bad) > 1 else ""
            line = line_of(int(bad[0]))
            self.notes.append(f"line {line}: {name} is {value}, beyond both neighbours: taken as {right}, their middle{more}")
        t_ns = self._unroll(stamps)
        before_ns = int(t_ns[0]) if self._before is None else self._before
        else_do = "or correct the stamps" if self.layout.standard else "or count samples: --time-unit none --odr HZ"
        if (back := why_back(t_ns, before_ns, name, self.layout.clock, else_do)) is not None:
            raise RowFault(*back)
        self._before = int(t_ns[-1])
        return t_ns

    def _repaired(self, lines: list[str], number: int, last: bool) -> list[str]:
        """Without a header that comes again, and without a last line that was cut off; blanks in their place keep the numbers."""
        kept = list(lines)

        def leave_out(i: int, problem: str) -> None:
            self._refuse_restart(lines, i, number)
            if not (last and not any(rest.strip() for rest in lines[i + 1 :])):
                raise FormatError(f"{self.path.name} line {number + i}: {problem}; {CORRECT}")
            self.notes.append(f"line {number + i}, the last, is cut off ({problem}): left out")
            kept[i] = ""

        for i, line in enumerate(lines):
            if not line.split("#")[0].strip(EMPTY):
                kept[i] = ""  # numpy takes blanks for a number that is missing
            elif line.strip() == self.layout.header_line and not self.layout.standard:
                self._note("the header comes again (the logger was restarted?): left out")
                kept[i] = ""
            elif problem := fault(line, self.layout):
                leave_out(i, problem)
        # No rule of ours: numpy itself says which is the first line that it cannot take.
        if (row := unreadable(kept, self.layout)) is not None:
            leave_out(row, f"{kept[row][:40]!r} cannot be read as numbers")
        return kept

    def _refuse_restart(self, lines: list[str], wrong: int, number: int) -> None:
        """FormatError where a line that holds no reading is what a board says when it starts: behind it the time begins again."""
        stamps: list[int] = []
        for part in (reversed(lines[max(wrong - BOOT_LINES, 0) : wrong]), lines[wrong + 1 : wrong + BOOT_LINES]):
            for line in part:
                with suppress(ValueError, RowFault):
                    if (stamp := parse([line], self.layout)[1]) is not None and wrong_width([line], self.layout) is None:
                        stamps.append(int(stamp[0]))
                        break
        if len(stamps) == 2 and (back := why_back(np.array(stamps), stamps[0], "", False, "")) is not None and TWO_PIECES in back[2]:
            name, text = self.layout.name(self.layout.time_column), lines[wrong].strip()[:40]
            what = f"a restart: {text!r} stands between the rows, and {name} begins again at {stamps[1] * NS:g} s"
            raise FormatError(f"{self.path.name} line {number + wrong}: {what}; {TWO_PIECES}")

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


def _first_of_content(lines: list[str]) -> int | None:
    """The first line that is neither blank nor a comment."""
    return next((i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), None)


def _with_points(lines: list[str]) -> list[str]:
    return [line.replace(",", ".") for line in lines]
