"""Writes events to ``log*.csv``, one file per reset or connection."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from session.base.errors import FormatError, StorageError
from session.bench.events import TROUBLES, AnyEvent, BoardStatus, Event, Info, SampleChunk, StreamFormat, faults_text, starts_log
from session.bench.rawfile import GrowingFile, put_aside
from session.bench.text_stream import parse_info

# The log files (docs/formats.md).  A reset of the device, or a new connection, starts a new file, since device time restarts.

NOWHERE = ""
#: logs of one recording: a board that resets again and again would fill the folder
MOST_LOGS = 1000


class LogWriter:
    """Writes the events of a stream; the files depend on the events alone.  Logs that exist already grow (``GrowingFile``)."""

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
        self.renamed: dict[str, str] = {}  #: logs that ``keep`` has named: first name -> last name

    def begin(self, stem: str) -> None:
        """The next sample begins a new file ``stem*.csv``."""
        self.close()
        self.stem = stem

    @property
    def present(self) -> str:
        """Name of the log that is being written; empty while there is none."""
        return self.paths[-1].name if self._file is not None else ""

    def pause(self) -> None:
        """Write samples to no log until the next ``begin``."""
        self.begin(NOWHERE)

    def keep(self, stem: str) -> None:
        """End the present file, if there is one, and name it ``stem*.csv``; then ``pause``."""
        path = self.paths[-1] if self._file else None
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
                self._write(event)

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

    def _end(self) -> None:
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
        self.physical = chunk.form.physical
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
        if len(self.paths) >= MOST_LOGS:
            raise FormatError(f"{self.folder}: {MOST_LOGS} logs: the board resets again and again; look at its supply")
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
