"""Record: everything that a port gives goes to disk; decode the raw bytes again later."""

from __future__ import annotations

import contextlib
import itertools
import queue
import time
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

from session.bench.decoder import StreamDecoder
from session.bench.events import Event, SampleChunk, Trouble
from session.bench.logwriter import FOREIGN, NEW_LOG, WORD, BoardRouter, ClockComparison, LogWriter, other_board
from session.bench.port import BoardSetup, Closed, Opened, Port, Received, RequestedSettings, is_virtual
from session.bench.rawfile import RAW, Mark, RawFile, RecordingDecision, decision_of, name_kept, read_events
from session.io.files import open_file

# The raw bytes of a recording, decoded into the same logs again.

#: bytes decoded in one go; whoever asks for the next piece may stop between two
BLOCK = 1 << 16

Piece = tuple[int | None, list[Event | RecordingDecision]]


def stream(raw_path: Path, decoder: StreamDecoder, logs: LogWriter, sorting: BoardRouter | None = None) -> Iterator[Piece]:
    """Decode a raw file into ``logs``, giving (host_ns or None, events) piece by piece, with what was decided between them.

    Events of another board are not given; its logs have other names.  What is added to the file behind this call is not looked at.
    The caller finishes decoder and logs.
    """
    with open_file(raw_path):
        size = raw_path.stat().st_size
    return _pieces(raw_path, size, read_events(raw_path), decoder, logs, sorting or BoardRouter(decoder, logs))


def _pieces(raw_path: Path, size: int, marks: list[Mark], decoder: StreamDecoder, logs: LogWriter, sorting: BoardRouter) -> Iterator[Piece]:
    with open_file(raw_path) as raw:
        sorting.opened(0, other_board(marks, -1))
        for number, mark in enumerate(marks):
            yield from _until(raw, min(mark.offset, size), decoder, sorting)
            if mark.event.partition(" ")[0] == "open":
                yield mark.host_ns, [*new_connection(decoder, sorting, mark.offset, other_board(marks, number))]
            elif (decision := decision_of(mark)) is not None:
                if decision.word == "begin":  # a file that was kept bears its last name from the beginning
                    logs.begin(name_kept(marks, number) or decision.rest)
                elif decision.word in ("pause", "keep"):
                    logs.pause()
                yield mark.host_ns, [replace(decision, log=logs.paths[-1].name if logs.paths else "")]
        yield from _until(raw, size, decoder, sorting)


def new_connection(decoder: StreamDecoder, sorting: BoardRouter, offset: int, since: int | None = None) -> list[Event]:
    """The port was opened behind so many bytes, for the first time or again: what came before is over.  since: as of ``BoardRouter``."""
    events = sorting.take(decoder.finish())
    sorting.opened(offset, since)
    return [*events, *sorting.take([Trouble("reconnect")])] if decoder.samples else events


def _until(raw: BinaryIO, offset: int, decoder: StreamDecoder, sorting: BoardRouter) -> Iterator[Piece]:
    while (size := min(BLOCK, offset - raw.tell())) > 0 and (data := raw.read(size)):
        yield None, [*sorting.take(decoder.feed(data))]


# Everything that a port gives goes to disk; its events come out.

LAST_S = 0.5  #: for what has come and is not decoded yet, when somebody wants to stop


class Recorder:
    """``catch_up``, ``poll`` until done, then ``close``.

    connected: whether the port is open now; why: if not, why; raw: the raw file; decoder: its counts.  Where the folder holds a
    raw file already, the recording goes on behind it, and ``catch_up`` gives the events of what is in it.  undecoded: bytes that
    are in the raw file, and whose samples are in no log, since somebody wanted to stop while they were being decoded.
    """

    def __init__(self, folder: Path, name: str, baudrate: int = 921600, header: str | None = None, wanted: RequestedSettings | None = None):
        self.decoder, self.logs = StreamDecoder(header), LogWriter(folder)
        self._sorting = BoardRouter(self.decoder, self.logs)
        self.clock = ClockComparison()
        self.raw = RawFile(folder)  # nobody else writes there from now on
        self._past: Iterator[Piece] | None = None
        self._decoded = self.raw.size  # bytes; the reader thread is ahead of it
        self.undecoded = 0
        self.connected, self.why, self._closed = False, "", False
        try:
            if self.raw.size:
                self._past = stream(folder / RAW, self.decoder, self.logs, self._sorting)
            self.setting = BoardSetup(wanted or RequestedSettings())
            self.port = Port(name, baudrate, self._keep, self.setting, self.setting.forgotten)
            self._has_clock = not is_virtual(name)  # a virtual board may be slower than it should, or told to hurry
        except BaseException:
            self.raw.discard()
            raise

    def catch_up(self) -> Iterator[list[Event | RecordingDecision]]:
        """Events of what the raw file held before, a slice at a time; then ``poll``.  Whoever stops in between loses nothing."""
        if self._past is not None:
            for _, events in self._past:
                yield events
            self._past = None

    def poll(self, timeout_s: float = 0.1) -> list[Event]:
        """Events of what has arrived, a slice of it where there is much, waiting for the first at most so long.

        StorageError when the disk is full, or the files are not there any more.
        """
        if self.raw.trouble is not None:
            raise self.raw.trouble
        return self._poll(timeout_s)

    def _poll(self, timeout_s: float) -> list[Event]:
        assert self._past is None, "catch_up comes first"
        items: list = []
        size = 0
        with contextlib.suppress(queue.Empty):
            while size < BLOCK:
                items.append(self.port.items.get(timeout=timeout_s) if not items else self.port.items.get_nowait())
                size += len(items[-1].data) if isinstance(items[-1], Received) else 0
        events = self._take(items)
        self.logs.flush()
        return events

    def decide(self, decision: RecordingDecision) -> None:
        """Do what was decided at the table, behind all samples that were polled; a replay does it too.  Call it between two polls."""
        self.raw.mark(time.monotonic_ns(), decision.text, self._decoded)
        if decision.word == "begin":
            self.logs.begin(decision.rest)
        elif decision.word == "pause":
            self.logs.pause()
        elif decision.word == "keep":
            self.logs.keep(decision.rest)

    def set_apart(self, landmarks: int) -> list[str]:
        """What came behind so many of the new logs and infos that were given away was another board's, until the port is opened again.

        That is written down for every replay, and its logs get another name: those names, as far as there are any.
        """
        landmark = self._sorting.set_apart(landmarks)
        self.raw.mark(time.monotonic_ns(), f"{WORD} {landmark.number}", landmark.offset)
        return [path.name for path in self.logs.paths if path.name.startswith(FOREIGN)]

    @property
    def samples(self) -> int:
        """Of this recording's own board."""
        return self._sorting.samples

    def close(self) -> None:
        """Stop reading, write what is left, close the files; may be called twice."""
        if self._closed:
            return
        self._closed = True
        self.port.close()
        deadline = time.monotonic() + LAST_S
        try:
            while self._past is None and not self.port.items.empty() and time.monotonic() < deadline:
                self._poll(0)
            if self._past is None and self.port.items.empty():
                self._sorting.take(self.decoder.finish())
            else:  # half a log is what a whole one begins with: nothing is finished here
                self.undecoded = self.raw.size - self.decoder.taken
        finally:
            self.raw.close()
            self.logs.close(whole=not self.undecoded)

    def _keep(self, item: object) -> None:
        """In the reader thread: to disk first."""
        if isinstance(item, Received):
            self.raw.append(item.host_ns, item.data)
        elif isinstance(item, Opened):
            self.raw.mark(item.host_ns, f"open {datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} {item.name}")
        elif isinstance(item, Closed):
            self.raw.mark(item.host_ns, f"close {item.why}")

    def _take(self, items: list) -> list[Event]:
        """Decode and log; bytes that waited together go through together, which is faster."""
        events: list[Event] = []
        for kind, group in itertools.groupby(items, type):
            if kind is Received:
                arrivals = list(group)
                data = b"".join(item.data for item in arrivals)
                self._decoded += len(data)
                fresh = self.decoder.feed(data)
                self._compare(fresh, arrivals[-1].host_ns)
                events += self._sorting.take(fresh)
            else:
                events += [event for item in group for event in self._take_state(item)]
        return events

    def _compare(self, events: list[Event], host_ns: int) -> None:
        if any(isinstance(event, Trouble) and event.kind in NEW_LOG for event in events):
            self.clock.restart()
        elif self._has_clock and (chunks := [event for event in events if isinstance(event, SampleChunk)]):
            self.clock.add(host_ns, int(chunks[-1].t_us[-1]))

    @property
    def odr_hz(self) -> float | None:
        """The true data rate: as the board says it, else as its stamps show it."""
        return self.decoder.info.odr_hz if self.decoder.info else self.decoder.measured_odr_hz

    def _take_state(self, item: Opened | Closed | Exception) -> list[Event]:
        if isinstance(item, Exception):
            raise item
        self.connected = isinstance(item, Opened)
        self.why = item.why if isinstance(item, Closed) else ""
        if not self.connected:
            return []
        self.clock.restart()
        return new_connection(self.decoder, self._sorting, self._decoded)
