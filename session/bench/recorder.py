"""The recorder: everything that a port gives goes to disk; its events come out, now or when the raw bytes are decoded again."""

from __future__ import annotations

import contextlib
import itertools
import queue
import time
from collections.abc import Callable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

from session.base.files import open_file
from session.bench.clocks import ClockComparison
from session.bench.decoder import StreamDecoder
from session.bench.events import AnyEvent, Event, SampleChunk, starts_log
from session.bench.logwriter import LogWriter
from session.bench.port import Arrival, BoardSetup, Port, is_virtual
from session.bench.rawfile import RAW, Mark, RawFile, decision_of, name_kept, raw_event, read_events

#: bytes decoded at once; the caller may stop between two such pieces
BLOCK = 1 << 16

Piece = tuple[int | None, list[AnyEvent]]


def stream(raw_path: Path, decoder: StreamDecoder, logs: LogWriter) -> Iterator[Piece]:
    """Decode a raw file into ``logs``: (host_ns or None, events) piece by piece, with the decisions between them.

    Bytes that are added to the file after this call are not decoded.  The caller finishes decoder and logs.
    """
    with open_file(raw_path):
        size = raw_path.stat().st_size
    return _pieces(raw_path, size, read_events(raw_path), decoder, logs)


def _pieces(raw_path: Path, size: int, marks: list[Mark], decoder: StreamDecoder, logs: LogWriter) -> Iterator[Piece]:
    with open_file(raw_path) as raw:
        for number, mark in enumerate(marks):
            yield from _until(raw, min(mark.offset, size), decoder, logs)
            if mark.event.partition(" ")[0] == "open":
                yield mark.host_ns, new_connection(decoder, logs)
            elif (decision := decision_of(mark)) is not None:
                if decision.kind == "begin":  # a file that was kept has its last name from the beginning
                    logs.begin(name_kept(marks, number) or decision.text)
                elif decision.kind in ("pause", "keep"):
                    logs.pause()
                yield mark.host_ns, [decision]
        yield from _until(raw, size, decoder, logs)


def new_connection(decoder: StreamDecoder, logs: LogWriter) -> list[AnyEvent]:
    """The port was opened: finish what came before."""
    events = decoder.finish()
    events += [Event("reconnect")] if decoder.samples else []
    logs.write(events)
    return events


def _until(raw: BinaryIO, offset: int, decoder: StreamDecoder, logs: LogWriter) -> Iterator[Piece]:
    while (size := min(BLOCK, offset - raw.tell())) > 0 and (data := raw.read(size)):
        events = decoder.feed(data)
        logs.write(events)
        yield None, events


LAST_S = 0.5  #: for decoding what has arrived when the recording is to stop


class Recorder:
    """``catch_up``, ``poll`` until done, then ``close``.

    Where the folder holds a raw file already, the recording continues behind it, and ``catch_up`` gives the events of what is in it.
    port: makes the port, None: a real one; heard: host_ns and device time t_us of the last samples of this connection, None at first.
    """

    def __init__(
        self,
        folder: Path,
        name: str,
        baudrate: int = 921600,
        header: str | None = None,
        wanted: Mapping[str, float | None] | None = None,
        port: Callable[..., Port] | None = None,
    ):
        self.decoder, self.logs = StreamDecoder(header), LogWriter(folder)
        self.clock = ClockComparison()
        self.heard: tuple[int, int] | None = None
        self.raw = RawFile(folder)  # locked against other writers from now on
        self._past: Iterator[Piece] | None = None
        self._decoded = self.raw.size  # bytes; the reader thread is ahead of it
        self.undecoded = 0  #: bytes in the raw file whose samples are in no log, since the recording was to stop while they were decoded
        self.connected, self.why, self._closed = False, "", False  # why: why the port is not open
        try:
            if self.raw.size:
                self._past = stream(folder / RAW, self.decoder, self.logs)
            self.setting = BoardSetup(wanted or {})
            self.port = (port or Port)(name, baudrate, self._keep, self.setting)
            self._has_clock = not is_virtual(name)  # a virtual board may run slower or faster than real time
        except BaseException:
            self.raw.discard()
            raise

    def catch_up(self) -> Iterator[list[AnyEvent]]:
        """Events of what the raw file held before, piece by piece; the caller may stop in between.  ``poll`` comes after it."""
        if self._past is not None:
            for _, events in self._past:
                yield events
            self._past = None

    def poll(self, timeout_s: float = 0.1) -> list[AnyEvent]:
        """Events of what has arrived, or of a part of it, waiting for the first at most so long.

        StorageError when the disk is full, or the files were removed.
        """
        assert self._past is None, "catch_up comes first"
        if self.raw.trouble is not None and not self._closed:
            raise self.raw.trouble
        items: list[Arrival] = []
        size = 0
        with contextlib.suppress(queue.Empty):
            while size < BLOCK:
                items.append(self.port.items.get(timeout=timeout_s) if not items else self.port.items.get_nowait())
                size += len(items[-1][1]) if isinstance(items[-1][1], bytes) else 0
        events = self._take(items)
        self.logs.flush()
        return events

    def decide(self, decision: Event) -> None:
        """Carry out a decision behind all samples that were polled; a replay repeats it.  Call it between two polls."""
        self.raw.mark(time.monotonic_ns(), raw_event(decision), self._decoded)
        if decision.kind == "begin":
            self.logs.begin(decision.text)
        elif decision.kind == "pause":
            self.logs.pause()
        elif decision.kind == "keep":
            self.logs.keep(decision.text)

    @property
    def samples(self) -> int:
        """Number of samples."""
        return self.decoder.samples

    def close(self) -> None:
        """Stop reading, write what is left, close the files; may be called twice."""
        if self._closed:
            return
        self._closed = True
        self.port.close()
        deadline = time.monotonic() + LAST_S
        try:
            while self._past is None and not self.port.items.empty() and time.monotonic() < deadline:
                self.poll(0)
            if self._past is None and self.port.items.empty():
                self.logs.write(self.decoder.finish())
            else:  # a resumed recording completes the logs: nothing is finished here
                self.undecoded = self.raw.size - self.decoder.taken
        finally:
            self.raw.close()
            self.logs.close(whole=not self.undecoded)

    def _keep(self, item: Arrival) -> None:
        """Store an item, in the reader thread."""
        host_ns, what = item
        if isinstance(what, bytes):
            self.raw.append(host_ns, what)
        elif what.kind == "open":
            self.raw.mark(host_ns, f"open {datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} {what.text}")
        else:
            self.raw.mark(host_ns, raw_event(what))

    def _take(self, items: list[Arrival]) -> list[AnyEvent]:
        """Decode and log; bytes that waited together are decoded together, which is faster."""
        events: list[AnyEvent] = []
        for kind, group in itertools.groupby(items, lambda item: type(item[1])):
            if kind is bytes:
                times_ns, parts = zip(*group, strict=True)
                data = b"".join(parts)
                self._decoded += len(data)
                fresh = self.decoder.feed(data)
                chunks = [event for event in fresh if isinstance(event, SampleChunk)]
                if any(map(starts_log, fresh)):
                    self.clock.restart()
                elif self._has_clock and chunks:
                    self.clock.add(times_ns[-1], int(chunks[-1].t_us[-1]), sum(map(len, chunks)))
                if chunks:
                    self.heard = times_ns[-1], int(chunks[-1].t_us[-1])
                self.logs.write(fresh)
                events += fresh
            else:
                events += [event for _, item in group for event in self._take_state(item)]
        return events

    def _take_state(self, item: Event | Exception) -> list[AnyEvent]:
        if isinstance(item, Exception):
            raise item
        self.connected = item.kind == "open"
        self.why = "" if self.connected else item.text
        if not self.connected:
            return []
        self.clock.restart()
        self.heard = None
        return new_connection(self.decoder, self.logs)
