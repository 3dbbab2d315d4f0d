"""The reader of standard logs (docs/formats.md): the rows of one file, in pieces, in constant memory whatever its length."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.texts import command_line
from session.base.units import NS
from session.log.layout import Layout, Triad
from session.log.lines import PIECE_BYTES, UTF_16_NOTE, Lines
from session.log.numbers import CORRECT, EMPTY, RowFault, fault, parse, unreadable, wrong_width
from session.log.one_sensor import Form, Watch, refuse_turns
from session.log.registers import RegisterUnits
from session.log.stamps import COUNTER, TWO_PIECES, Unroll, bad_stamps, why_back
from session.log.standard import flagged, standard_layout
from session.log.thermometer import Sound

#: of text that is looked through for a header, from the first line that is neither blank nor a comment
HEAD_LINES, HEAD_BYTES = 400, 1 << 16
#: characters in which a zero byte shows that this is no text; further on it is a line that broke
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
    """One file: ``layout`` at once, ``pieces()`` once, ``notes`` and ``comments`` as they are met."""

    #: what to do, apart from a split, where stamps go back, and whether they are times of a day
    else_do, is_clock = "or correct the stamps", False

    def __init__(self, path: Path, gyro_alone: bool = False):
        """gyro_alone: whether it may lack an accelerometer.

        Raises FormatError for what cannot be read or is no standard log, and for rows of several sensors.
        """
        self._begin(path)
        head = self._head(lambda lines: first_of_content(lines) is not None)
        instead = f"`{command_line('import', path)}` reads another program's log"
        if self._is_wide:
            raise FormatError(f"{path.name}: not a text log (UTF-16 or binary); expected CSV in UTF-8; {instead}")
        if first_of_content(head) is None:
            raise self._empty()
        layout = standard_layout(head, path.name, gyro_alone, instead)
        form = Form(path.name, layout.delimiter, layout.names, layout.used, layout.header_line)
        self._go_by(layout, Watch(head[layout.first :], form))
        refuse_turns(head[layout.first :], layout.time_column, form)

    def _begin(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self.comments: dict[str, str] = {}
        self._stream: Lines | None = None  # what can be read but once: a pipe, standard input
        self._file: Lines | None = None
        self._before: int | None = None
        self._stood_at, self._standing = 0, 0  # the last stamp, and rows of the pieces that held no other
        self._as_written = False
        self._rows_read, self._begins = 0, [(0, 1)]  # rows so far; of each piece, its first row, and its first line from 1
        self._unsigned: set[str] = set()  # kinds whose registers are

    def _empty(self) -> FormatError:
        return FormatError(f"{self.path.name}: empty; expected a header line and samples; was the recording stopped before it began?")

    def _go_by(self, layout: Layout, watch: Watch) -> None:
        """Take the columns from this layout; watch: refuses rows that are another sensor's."""
        self.layout, self._watch = layout, watch
        self.comments |= flagged(layout.names)
        if layout.remark:
            self._note(layout.remark)
        self._unroll = self._unroll_of()

    def _unroll_of(self) -> Unroll:
        """By the usual counter, of which some stamps may be missing: of us alone."""
        ns = self.layout.time_ns
        return Unroll(round(COUNTER * ns) if self.layout.name(self.layout.time_column) == "t_us" else None, ns)

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
                if file.note:
                    self._note(file.note)
                rows = self._rows(lines, number, skip)
                self._watch(rows)
                piece = self._piece(rows, number + skip, last=not following)
                if piece is not None:
                    self._require_time(piece, number + skip)
                    yield piece
                number, skip, lines = number + len(lines), max(skip - len(lines), 0), following

    def unrolled(self, stamps: np.ndarray) -> np.ndarray:
        """(N,) ns that go on, of all stamps (N,) ns as they were written: all of them together distinguish a counter from an epoch.

        Raises FormatError with the line from which they go back.
        """
        try:
            return self._unrolled(stamps, self._line_of)
        except RowFault as wrong:
            raise FormatError(f"{self.path.name} line {self._line_of(wrong.row)}: {wrong.what}; {wrong.do}") from None

    def factors(self, units: RegisterUnits, gyro_alone: bool = False) -> tuple[float, float]:
        """SI per unit of rates and forces.  FormatError for registers whose meaning is not known."""
        try:
            return self.layout.gyro_si(units), 1.0 if gyro_alone else self.layout.accel_si(units)
        except FormatError as error:
            raise FormatError(f"{self.path.name} holds registers: {error}") from None

    def notes_on(self, sound: Sound, model: str, has_temperature: bool) -> list[str]:
        """The notes once all rows are read; sound: of its thermometer; model: of its sensor."""
        notes = [*self.notes, *sound.notes]
        if self.layout.temp is not None and not has_temperature:
            notes.append(f"temp: what the temperature register of {model} means is not known: left out")
        return notes + ([f"the time counter came round {self.wraps}x: unrolled"] if self.wraps else [])

    def _head(self, is_enough: Callable[[list[str]], bool], most: int | None = HEAD_LINES) -> list[str]:
        """The first lines, as far as ``is_enough``, which is called with each further part; most: from the first of content on."""
        file = Lines(self.path)
        try:
            lines = more = file.take(HEAD_BYTES)
            while not is_enough(more) and (more := file.take(HEAD_BYTES)):
                lines = lines + more
        finally:
            if not file.once:
                file.close()
        self.comments |= file.comments
        self._is_wide = file.note == UTF_16_NOTE
        if file.once:
            file.give_back(lines)
            self._stream = file
        if "\0" in "\n".join(lines[:TEXT_BEGINS])[:TEXT_BEGINS]:
            program = "Betaflight's blackbox_decode" if lines[0].startswith("H Product:Blackbox") else "its own program"
            raise FormatError(f"{self.path.name}: not a text log (UTF-16 or binary); expected CSV in UTF-8: export it with {program}")
        first = first_of_content(lines)
        return [line if line.strip(EMPTY) else "" for line in (lines if first is None or most is None else lines[: first + most])]

    def _rows(self, lines: list[str], number: int, skip: int = 0) -> list[str]:
        """The lines from ``number`` on, behind those before the rows, with blanks in the place of those that are not meant."""
        return lines[skip:]

    def _parse(self, lines: list[str], unsigned: set[str] | None = None) -> tuple[np.ndarray, np.ndarray | None]:
        """Numbers and stamps of lines, as ``parse``; unsigned: of rows that are read, and not only looked at."""
        return parse(lines, self.layout, unsigned)

    def _fault(self, line: str) -> str | None:
        return fault(line, self.layout)

    def _piece(self, lines: list[str], number: int, last: bool) -> Piece | None:
        if (wrong := wrong_width(lines, self.layout)) is not None:
            count, names = lines[wrong].count(self.layout.delimiter or "") + 1, len(self.layout.names)
            self._refuse_restart(lines, wrong, number)
            problem = self._wrong_row(lines[wrong]) or f"{count} columns, expected {names}"
            if not last or any(rest.strip() for rest in lines[wrong + 1 :]):
                hint = ", or save decimal commas with semicolons between the columns" if count > names else ""
                raise FormatError(f"{self.path.name} line {number + wrong}: {problem}; {CORRECT}{hint}")
            self.notes.append(f"line {number + wrong}, the last, is cut off ({problem}): left out")
            lines = [*lines[:wrong], *[""] * (len(lines) - wrong)]

        def line_of(row: int) -> int:
            return number + [i for i, line in enumerate(lines) if line.split("#")[0].strip(EMPTY)][row]

        try:
            try:
                table, stamps = self._parse(lines, self._unsigned)
            except ValueError:
                # Only now, since it is slow: look for the line that is at fault.
                lines = self._repaired(lines, number, last)
                table, stamps = self._parse(lines, self._unsigned)
            for places in (places for kind, places, _ in self.layout.kinds if kind in self._unsigned):
                self._note(f"{', '.join(map(self.layout.name, places))}: unsigned registers; 65535 is read as -1")
            if not len(table):
                return None
            self._begins.append((self._rows_read, number))
            self._rows_read += len(table)
            t_ns = stamps if stamps is None or self._as_written else self._unrolled(stamps, line_of)
        except RowFault as wrong:
            raise FormatError(f"{self.path.name} line {line_of(wrong.row)}: {wrong.what}; {wrong.do}") from None
        gyro, accel = (self._triad(table, triad) for triad in (self.layout.gyro, self.layout.accel))
        temp = None if self.layout.temp is None else table[:, self.layout.numbers.index(self.layout.temp)]
        return Piece(t_ns, gyro, accel, temp)

    def _wrong_row(self, line: str) -> str:
        """What is known of a row of another width than the header's."""
        return ""

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
                for line in self._rows(lines, at):
                    is_row = line.split("#")[0].strip(EMPTY) and line.strip() != self.layout.header_line
                    if at >= number and at > self.layout.first and is_row:
                        if first == row:
                            return at
                        first += 1
                    at += 1
                lines = file.take()
        return number

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
        if (back := why_back(t_ns, before_ns, name, self.is_clock, self.else_do)) is not None:
            raise RowFault(*back)
        self._before = int(t_ns[-1])
        return t_ns

    def _repaired(self, lines: list[str], number: int, last: bool) -> list[str]:
        """Without a last line that was cut off; blanks in the place of what is left out keep the numbers."""
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
            elif problem := self._fault(line):
                leave_out(i, problem)
        # No rule of ours: numpy itself finds which is the first line that it cannot take.
        if (row := unreadable(kept, self._parse)) is not None:
            leave_out(row, f"{kept[row][:40]!r} cannot be read as numbers")
        return kept

    def _refuse_restart(self, lines: list[str], wrong: int, number: int) -> None:
        """FormatError where a line that holds no reading is what a board sends when it starts: behind it the time begins again."""
        stamps: list[int] = []
        for part in (reversed(lines[max(wrong - BOOT_LINES, 0) : wrong]), lines[wrong + 1 : wrong + BOOT_LINES]):
            for line in part:
                with suppress(ValueError, RowFault):
                    if (stamp := self._parse([line])[1]) is not None and wrong_width([line], self.layout) is None:
                        stamps.append(int(stamp[0]))
                        break
        if len(stamps) == 2 and (back := why_back(np.array(stamps), stamps[0], "", False, "")) is not None and TWO_PIECES in back[2]:
            name, text = self.layout.name(self.layout.time_column), lines[wrong].strip()[:40]
            what = f"a restart: {text!r} stands between the rows, and {name} begins again at {stamps[1] * NS:g} s"
            raise FormatError(f"{self.path.name} line {number + wrong}: {what}; {TWO_PIECES}")

    def _note(self, text: str) -> None:
        if text not in self.notes:
            self.notes.append(text)


def first_of_content(lines: list[str]) -> int | None:
    """The first line that is neither blank nor a comment."""
    return next((i for i, line in enumerate(lines) if line.strip() and not line.lstrip().startswith("#")), None)
