"""Everything that a port gives goes to disk; its events come out."""

from __future__ import annotations

import contextlib
import itertools
import queue
import time
from datetime import UTC, datetime
from pathlib import Path

from session.common.errors import CalibrationError
from session.recording.clock import ComparisonOfClocks
from session.recording.decisions import Decision
from session.recording.decoding import new_connection, stream
from session.recording.logwriter import NEW_LOG, LogWriter
from session.recording.port import Closed, Opened, Port, Received
from session.recording.rawfile import RAW, RawFile
from session.stream.decoder import StreamDecoder
from session.stream.events import Chunk, Event, Trouble


class Recorder:
    """``poll`` until done, then ``close``.

    connected: whether the port is open now; why: if not, why; raw: the raw file; decoder: its counts.  Where the folder holds a
    raw file already, ``resumed`` holds the events of what is in it, and the recording goes on behind it.
    """

    def __init__(self, folder: Path, name: str, baudrate: int = 921600, header: str | None = None):
        self.decoder, self.logs = StreamDecoder(header), LogWriter(folder)
        self.clock = ComparisonOfClocks()
        self.resumed: list[Event | Decision] = []
        if (folder / RAW).exists():
            for _, events in stream(folder / RAW, self.decoder, self.logs):
                self.resumed += events
        self.raw = RawFile(folder)
        self._decoded = self.raw.size  # bytes; the reader thread is ahead of it
        self.connected, self.why, self._closed = False, "", False
        try:
            self.port = Port(name, baudrate, self._keep)
        except CalibrationError:
            self.raw.discard()
            raise

    def poll(self, timeout_s: float = 0.1) -> list[Event]:
        """Events of all that has arrived, waiting for the first at most so long.  StorageError when the disk is full."""
        items = []
        with contextlib.suppress(queue.Empty):
            items.append(self.port.items.get(timeout=timeout_s))
            while True:
                items.append(self.port.items.get_nowait())
        events = self._take(items)
        self.logs.flush()
        return events

    def decide(self, decision: Decision) -> None:
        """Do what was decided at the table, behind all samples that were polled; a replay does it too.  Call it between two polls."""
        self.raw.mark(time.monotonic_ns(), decision.text, self._decoded)
        if decision.word == "begin":
            self.logs.begin(decision.rest)
        elif decision.word == "pause":
            self.logs.pause()
        elif decision.word == "keep":
            self.logs.keep(decision.rest)

    def close(self) -> None:
        """Stop reading, write what is left, close the files; may be called twice."""
        if self._closed:
            return
        self._closed = True
        self.port.close()
        try:
            self.poll(0)
            self.logs.write(self.decoder.finish())
        finally:
            self.raw.close()
            self.logs.close()

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
            else:
                fresh = [event for item in group for event in self._take_state(item)]
            self.logs.write(fresh)
            events += fresh
        return events

    def _compare(self, events: list[Event], host_ns: int) -> None:
        if any(isinstance(event, Trouble) and event.kind in NEW_LOG for event in events):
            self.clock.restart()
        elif chunks := [event for event in events if isinstance(event, Chunk)]:
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
        return new_connection(self.decoder)
