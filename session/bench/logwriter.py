"""Writes events to ``log*.csv``, one file per reset or connection."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from session.base.errors import FormatError, StorageError
from session.bench.decoder import StreamDecoder
from session.bench.events import TROUBLES, AnyEvent, BoardStatus, Event, Info, SampleChunk, StreamFormat, faults_text, starts_log
from session.bench.rawfile import GrowingFile, Mark, put_aside
from session.bench.text_stream import parse_info

# The log files (docs/formats.md).  A reset of the device, or a new connection, starts a new file, since device time restarts.

NOWHERE = ""
#: a start shorter than this is short; after so many short ones in a row, a further short one gets no log
SHORT_US, SHORT_STARTS = 1_000_000, 20
#: prefix of the logs of another board, which no command reads
FOREIGN = "foreign"


class LogWriter:
    """Writes the events of a stream; the files depend on the events alone.

    Logs that exist already grow (``GrowingFile``).  A board that resets again and again would fill the folder with logs of a few samples;
    short starts after many others get none.
    """

    def __init__(self, folder: Path):
        self.folder, self.stem = folder, "log"
        self.paths: list[Path] = []  #: the logs so far, in order
        self.put_aside: list[Path] = []  #: where logs went that somebody had changed
        self.physical: bool | None = None  #: whether the samples are in physical units; None before the first
        self._file: GrowingFile | None = None
        self._info: Info | None = None
        self.board: BoardStatus | None = None  # of this connection; it is written to every log
        self._waiting: list[str] = []  # comments before the first sample
        self._left_out: Event | None = None  # samples left out, whose count may still grow
        self._first_us: int | None = None  # of the samples since the last start
        self._short = 0  # starts in a row that lasted less than SHORT_US
        self._held: list[AnyEvent] = []  # since the last start, while it may be short
        self.not_logged = self.not_logged_starts = 0  #: samples of short starts without a log, and those starts
        self.renamed: dict[str, str] = {}  #: logs that ``keep`` has named: first name -> last name
        self._own_stem = self.stem  # while another board's samples are written

    def begin(self, stem: str) -> None:
        """The next sample begins a new file ``stem*.csv``."""
        self._own_stem = stem
        if not self.is_apart:
            self.close()
            self.stem = stem

    @property
    def is_apart(self) -> bool:
        """Whether another board's samples are written."""
        return self.stem == FOREIGN

    @property
    def present(self) -> str:
        """Name of the log that is being written; empty while there is none."""
        return self.paths[-1].name if self._file is not None and not self.is_apart else ""

    def apart(self) -> None:
        """Events from here on are another board's, until ``back``."""
        if not self.is_apart:
            self.close()
            self._own_stem, self.stem = self.stem, FOREIGN

    def back(self) -> None:
        """Events from here on are the recording's own."""
        if self.is_apart:
            self.close()
            self.stem = self._own_stem

    def rename_apart(self, which: slice) -> None:
        """Rename some of ``paths`` as another board's.  The present file continues under its new name."""
        chosen = range(*which.indices(len(self.paths)))
        with self._storage():
            present = self._file is not None and len(self.paths) - 1 in chosen
            if present and self._file is not None:
                self._file.close()
            for number in chosen:
                target = self._next(FOREIGN)
                put_aside(target)
                self.paths[number] = self.paths[number].rename(target)
            if present:
                self._file = GrowingFile(self.paths[-1], behind=True)
                self._own_stem, self.stem = self.stem, FOREIGN

    def pause(self) -> None:
        """Write samples to no log until the next ``begin``."""
        self.begin(NOWHERE)

    def keep(self, stem: str) -> None:
        """End the present file, if there is one, and name it ``stem*.csv``; then ``pause``."""
        path = self.paths[-1] if self._file and not self.is_apart else None
        self.pause()
        if path is None:
            return
        with self._storage():
            target = self._next(stem)
            put_aside(target)
            path.rename(target)
            self.paths[-1] = target
            self.renamed[path.name] = target.name

    def write(self, events: Iterable[AnyEvent]) -> None:
        """Append; StorageError where that fails."""
        with self._storage():
            for event in events:
                self._take(event)

    def flush(self) -> None:
        """Pass buffered text to the operating system."""
        if self._file:
            with self._storage():
                self._file.flush()

    def close(self, whole: bool = True) -> None:
        """End the present file; whole: False where undecoded samples follow, by which the file is to grow."""
        with self._storage():
            self._left_out = self._left_out if whole else None
            self._end()

    def _take(self, event: AnyEvent) -> None:
        """Write an event, or hold it until it is known whether this start is short."""
        if isinstance(event, SampleChunk) and len(event):
            self._first_us = int(event.t_us[0]) if self._first_us is None else self._first_us
            self._short = 0 if int(event.t_us[-1]) - self._first_us >= SHORT_US else self._short
        if starts_log(event):
            self._short += self._first_us is not None
            self._first_us = None
            self._skip_held()
        elif self._short >= SHORT_STARTS:
            self._held.append(event)
            return
        held, self._held = self._held, []
        for each in (*held, event):
            self._write(each)

    def _skip_held(self) -> None:
        samples = sum(len(event) for event in self._held if isinstance(event, SampleChunk))
        self._held = []
        self.not_logged += samples
        self.not_logged_starts += samples > 0

    def _end(self) -> None:
        self._skip_held()
        self._write_left_out()
        file, self._file, self._info, self._waiting = self._file, None, None, []
        if file:
            if file.aside:
                self.put_aside.append(file.aside)
            file.close()

    @contextlib.contextmanager
    def _storage(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            do = "make room, then go on with record --resume, or import raw.bin"
            raise StorageError(f"{self.folder}: {error.strerror or error}; {do}") from None

    def _write(self, event: AnyEvent) -> None:
        if isinstance(event, Event) and event.kind == "implausible":
            before = self._left_out
            if before is not None and before.merges_with(event):
                event = replace(event, count=before.count + event.count)
            else:
                self._write_left_out()
            self._left_out = event
            return
        if event.kind not in TROUBLES or starts_log(event):
            self._write_left_out()
        if isinstance(event, SampleChunk):
            if len(event):
                self._samples(event)
        elif isinstance(event, Info):
            if event != self._info:
                self._info = event
                self._comment(event.text)
        elif isinstance(event, BoardStatus):
            if self.board is not None and event.source != self.board.source:
                self._end()  # a log is of a sensor, or of its stand-in
            self.board = event
            if self._file is not None:
                self._comment(event.text)
        elif event.kind == "comment":
            self._info = parse_info(event.text) or self._info
            self._comment(event.text)
        elif event.kind == "faults" and any(event.numbers):
            self._comment(faults_text(event.numbers))
        elif starts_log(event):
            self._end()
            self.board = None if event.kind == "reconnect" else self.board

    def _write_left_out(self) -> None:
        event, self._left_out = self._left_out, None
        if event is not None:
            self._comment(f"left out as implausible: {event.count} (t_us {'?' if event.t_us is None else event.t_us})")

    def _samples(self, chunk: SampleChunk) -> None:
        self.physical = self.physical if self.is_apart else chunk.form.physical
        if self.stem == NOWHERE:
            return
        file = self._file or self._open(chunk.form)
        columns = [chunk.t_us.tolist(), *chunk.registers.T.tolist()]
        row = ",".join(["%d"] + ["%r" if chunk.form.physical else "%d"] * (len(columns) - 1)) + "\n"
        file.write(row * len(chunk) % tuple(itertools.chain.from_iterable(zip(*columns, strict=True))))

    def _comment(self, text: str) -> None:
        if self.stem == NOWHERE:
            return
        if self._file is None:
            self._waiting.append(text)
        else:
            self._file.write(f"# {text}\n")

    def _open(self, form: StreamFormat) -> GrowingFile:
        path = self._next(self.stem)
        if (packed := path.with_name(path.name + ".gz")).exists():
            raise FormatError(f"{packed}: a recording goes on in plain logs only; unpack it first (gunzip)")
        self._file = file = GrowingFile(path)
        self.paths.append(path)
        for text in self._waiting + ([self.board.text] if self.board else []):
            file.write(f"# {text}\n")
        file.write(",".join(("t_us", *form.names[1:])) + "\n")  # the time of a log is in us
        self._waiting = []
        return file

    def _next(self, stem: str) -> Path:
        number = 1 + sum(path.name.startswith(stem) for path in self.paths)
        return self.folder / f"{stem}{number:04d}.csv"


def not_logged_words(samples: int, starts: int) -> str:
    """The starts that got no log, in words."""
    short = f"{starts} starts that lasted less than {SHORT_US / 1e6:g} s, behind {SHORT_STARTS} in a row"
    return f"{samples} samples are in no log, of {short}; why does the board reset?"


# Another board may have been plugged in for a while.  Its bytes are noted in ``raw.times`` as ``foreign N``, at their connection: what
# follows the N-th checkpoint of the recording is another board's, until the port is opened again.  A checkpoint is a new log or an info:
# its place among the events does not depend on how the bytes were divided.

WORD = "foreign"


class BoardRouter:
    """Separates the events of the recording's own board from another one's.  samples: the number of its own."""

    def __init__(self, decoder: StreamDecoder, logs: LogWriter):
        self._decoder, self._logs = decoder, logs
        self.samples = 0
        self._info: Info | None = None  # of the recording's own board
        self._number = self._offset = 0
        self._since: int | None = None  # the checkpoint behind which another board sends
        #: of each checkpoint: its number; the bytes before its connection; the recording's own logs and samples before it
        self._checkpoints = [(0, 0, 0, 0)]

    def opened(self, offset: int, since: int | None = None) -> None:
        """The port was opened behind so many bytes; since: the checkpoint behind which another board sends, or None."""
        self._logs.back()
        self._offset, self._since = offset, since
        self._turn()

    def take(self, events: Iterable[AnyEvent]) -> list[AnyEvent]:
        """Write each event to its log; returns those of the recording's own board."""
        own: list[AnyEvent] = []
        for event in events:
            apart = self._logs.is_apart
            self._logs.write([event])
            if not apart:
                own.append(event)
                self.samples += len(event) if isinstance(event, SampleChunk) else 0
                self._info = event if isinstance(event, Info) else self._info
            if isinstance(event, Info) or starts_log(event):
                self._number += 1
                if not apart:
                    self._checkpoints.append((self._number, self._offset, len(self._logs.paths), self.samples))
                self._turn()
        if self._logs.is_apart:
            self._decoder.info = self._info
        return own

    def _turn(self) -> None:
        if self._since is not None and self._number >= self._since:
            self._logs.apart()

    def set_apart(self, count: int) -> tuple[int, int]:
        """Events behind the count-th checkpoint that ``take`` returned were another board's: rename their logs.

        Returns the checkpoint's number, and the bytes before its connection.
        """
        number, offset, logs, samples = self._checkpoints[count]
        following = next(((logs, samples) for _, begins, logs, samples in self._checkpoints if begins > offset), None)
        self._logs.rename_apart(slice(logs, following[0] if following else None))
        self.samples -= (following[1] if following else self.samples) - samples
        if following is None:
            self._since = number
            self._turn()
        return number, offset


def other_board(marks: Sequence[Mark], begun: int) -> int | None:
    """The checkpoint behind which another board sends in the connection that marks[begun] opens (-1: before the first), or None."""
    found = []
    for mark in marks[begun + 1 :]:
        word, _, rest = mark.event.partition(" ")
        if word == "open":
            break
        if word == WORD and rest.isascii() and rest.isdigit():
            found.append(int(rest))
    return min(found, default=None)
