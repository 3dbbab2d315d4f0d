"""Events into ``log*.csv`` (docs/formats.md).  A reset of the device, or a new connection, begins a new file: device time begins anew."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterable, Iterator
from pathlib import Path

from session.common.errors import FormatError, StorageError
from session.recording.growing import GrowingFile, put_aside
from session.stream.board import Board, Done, Faults, SelfTest
from session.stream.events import Chunk, Comment, Event, Info, Trouble
from session.stream.form import Form
from session.stream.text import parse_info

NEW_LOG = ("reset", "reconnect")
NOWHERE = ""
#: starts in a row that last less than this; behind so many, one that does so again gets no log
SHORT_US, SHORT_STARTS = 1_000_000, 20
#: begins the names of logs of another board, which no command reads
FOREIGN = "foreign"


class LogWriter:
    """Writes what a stream says; paths: the logs so far, in order.  What it writes depends on the events alone.

    Logs that are there already grow (``growing``); put_aside: where those went that somebody had changed; physical: whether
    the samples are in physical units, None before the first.  A board that begins anew again and again would fill the folder with logs
    of a few samples: not_logged counts the samples of starts that got none (``SHORT_STARTS``), not_logged_starts those.
    """

    def __init__(self, folder: Path, stem: str = "log"):
        self.folder, self.stem = folder, stem
        self.paths: list[Path] = []
        self.put_aside: list[Path] = []
        self.physical: bool | None = None  # what was written, once something was
        self._file: GrowingFile | None = None
        self._info: Info | None = None
        self.board: Board | None = None  # of this connection; said once, it holds in every log
        self._waiting: list[str] = []  # comments before the first sample
        self._left_out: Trouble | None = None  # the last of a kind, which may become more
        self._first_us: int | None = None  # of the samples since the last start
        self._short = 0  # starts in a row that lasted less than SHORT_US
        self._doubted: list[Event] = []  # since the last start, where it may be one more
        self.not_logged = self.not_logged_starts = 0
        self._own_stem = stem  # while another board's samples are written

    def begin(self, stem: str) -> None:
        """The next sample begins a new file ``stem*.csv``."""
        self._own_stem = stem
        if not self.is_apart:
            self.close()
            self.stem = stem

    @property
    def is_apart(self) -> bool:
        """Whether what comes is another board's."""
        return self.stem == FOREIGN

    def apart(self) -> None:
        """What comes from here on is another board's, until ``back``."""
        if not self.is_apart:
            self.close()
            self._own_stem, self.stem = self.stem, FOREIGN

    def back(self) -> None:
        """What comes from here on is the recording's own."""
        if self.is_apart:
            self.close()
            self.stem = self._own_stem

    def rename_apart(self, which: slice) -> None:
        """Some of ``paths`` turn out to be another board's: they get such names.  The present file goes on under its new one."""
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
        """Samples from here on go to no log, until the next ``begin``."""
        self.begin(NOWHERE)

    def keep(self, stem: str) -> None:
        """The present file is whole: end it, and name it ``stem*.csv``; then ``pause``.  Nothing where there is no file."""
        path = self.paths[-1] if self._file and not self.is_apart else None
        self.pause()
        if path is None:
            return
        with self._storage():
            target = self._next(stem)
            put_aside(target)
            path.rename(target)
            self.paths[-1] = target

    def write(self, events: Iterable[Event]) -> None:
        """Append; StorageError where that fails."""
        with self._storage():
            for event in events:
                self._take(event)

    def flush(self) -> None:
        """Hand what is buffered to the operating system."""
        if self._file:
            with self._storage():
                self._file.flush()

    def close(self, whole: bool = True) -> None:
        """End the present file; whole: no, where what comes behind is only not decoded yet, and the file is to grow."""
        with self._storage():
            self._left_out = self._left_out if whole else None
            self._end()

    def _take(self, event: Event) -> None:
        """Write it, or keep it until it is known whether this start lasts."""
        if isinstance(event, Chunk) and len(event):
            self._first_us = int(event.t_us[0]) if self._first_us is None else self._first_us
            lasts = int(event.t_us[-1]) - self._first_us >= SHORT_US
            self._short = 0 if lasts else self._short
        elif isinstance(event, Trouble) and event.kind in NEW_LOG:
            self._short += self._first_us is not None
        if self._short >= SHORT_STARTS and not (isinstance(event, Trouble) and event.kind in NEW_LOG):
            self._doubted.append(event)
            return
        doubted, self._doubted = self._doubted, []
        if isinstance(event, Trouble) and event.kind in NEW_LOG:
            self._first_us = None
            self._pass_over(doubted)
        else:
            for each in doubted:
                self._write(each)
        self._write(event)

    def _pass_over(self, events: list[Event]) -> None:
        samples = sum(len(event) for event in events if isinstance(event, Chunk))
        self.not_logged += samples
        self.not_logged_starts += samples > 0

    def _end(self) -> None:
        doubted, self._doubted = self._doubted, []
        self._pass_over(doubted)
        self._say_left_out()
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
            do = "make room, then go on with record --resume, or replay raw.bin"
            raise StorageError(f"{self.folder}: {error.strerror or error}; {do}") from None

    def _write(self, event: Event) -> None:
        if isinstance(event, Trouble) and event.kind == "implausible":
            before = self._left_out
            if before is not None and before.t_us == event.t_us:
                event = Trouble("implausible", before.count + event.count, event.t_us)
            else:
                self._say_left_out()
            self._left_out = event
            return
        if not isinstance(event, Trouble) or event.kind in NEW_LOG:
            self._say_left_out()
        if isinstance(event, Chunk):
            if len(event):
                self._samples(event)
        elif isinstance(event, Comment):
            self._info = parse_info(event.text) or self._info
            self._comment(event.text)
        elif isinstance(event, Info):
            if event != self._info:
                self._info = event
                self._comment(event.text)
        elif isinstance(event, Board):
            if self.board is not None and event.source != self.board.source:
                self._end()  # a log is of a sensor, or of what stood in for it
            self.board = event
            if self._file is not None:
                self._comment(event.text)
        elif isinstance(event, Faults):
            if any(event.counts):
                self._comment(event.text)
        elif isinstance(event, (Done, SelfTest)):
            pass  # an answer to whoever asked
        elif event.kind in NEW_LOG:
            self._end()
            self.board = None if event.kind == "reconnect" else self.board

    def _say_left_out(self) -> None:
        event, self._left_out = self._left_out, None
        if event is not None:
            self._comment(f"left out as implausible: {event.count} (t_us {'?' if event.t_us is None else event.t_us})")

    def _samples(self, chunk: Chunk) -> None:
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

    def _open(self, form: Form) -> GrowingFile:
        path = self._next(self.stem)
        if (packed := path.with_name(path.name + ".gz")).exists():
            raise FormatError(f"{packed}: a recording goes on in plain logs only; unpack it first (gunzip)")
        self._file = file = GrowingFile(path)
        self.paths.append(path)
        for text in self._waiting + ([self.board.text] if self.board else []):
            file.write(f"# {text}\n")
        file.write(form.log_header + "\n")
        self._waiting = []
        return file

    def _next(self, stem: str) -> Path:
        number = 1 + sum(path.name.startswith(stem) for path in self.paths)
        return self.folder / f"{stem}{number:04d}.csv"


def said_not_logged(samples: int, starts: int) -> str:
    """Of the starts that got no log."""
    short = f"{starts} starts that lasted less than {SHORT_US / 1e6:g} s, behind {SHORT_STARTS} in a row"
    return f"{samples} samples are in no log, of {short}; why does the board reset?"
