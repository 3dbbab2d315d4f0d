"""Everything that a port gives goes to disk; its events come out."""

from __future__ import annotations

import queue
import time
from datetime import UTC, datetime
from pathlib import Path

from session.errors import CalibrationError
from session.recording.logwriter import LogWriter
from session.recording.port import Closed, Opened, Port, Received
from session.recording.rawfile import RAW, RawFile
from session.recording.replay import new_connection, stream
from session.stream.decoder import StreamDecoder
from session.stream.events import Event


class Recorder:
    """``poll`` until done, then ``close``.

    connected: whether the port is open now; why: if not, why; raw: the raw file; decoder: its counts.  Where the folder holds a
    raw file already, ``resumed`` holds the events of what is in it, and the recording goes on behind it.
    """

    def __init__(self, folder: Path, name: str, baudrate: int = 921600):
        self.decoder, self.logs = StreamDecoder(), LogWriter(folder)
        self.resumed: list[Event] = []
        if (folder / RAW).exists():
            for _, events in stream(folder / RAW, self.decoder, self.logs):
                self.resumed += events
        self.raw = RawFile(folder)
        self._decoded = self.raw.size  # bytes; the reader thread is ahead of it
        self.connected, self.why = False, ""
        try:
            self.port = Port(name, baudrate, self._keep)
        except CalibrationError:
            self.raw.close()
            raise

    def poll(self, timeout_s: float = 0.1) -> list[Event]:
        """Events of all that has arrived, waiting for the first at most so long.  StorageError when the disk is full."""
        events: list[Event] = []
        try:
            item = self.port.items.get(timeout=timeout_s)
            while True:
                events += self._take(item)
                item = self.port.items.get_nowait()
        except queue.Empty:
            pass
        self.logs.write(events)
        self.logs.flush()
        return events

    def begin(self, stem: str) -> None:
        """Samples from here on go to a new ``stem*.csv`` (``log`` or ``closure``), in a replay too.  Call it between two polls."""
        self.raw.mark(time.monotonic_ns(), f"begin {stem}", self._decoded)
        self.logs.begin(stem)

    def close(self) -> None:
        """Stop reading, write what is left, close the files."""
        self.port.close()
        try:
            self.logs.write([*self._rest(), *self.decoder.finish()])
        finally:
            self.logs.close()
            self.raw.close()

    def _rest(self) -> list[Event]:
        events: list[Event] = []
        while not self.port.items.empty():
            events += self._take(self.port.items.get())
        return events

    def _keep(self, item: object) -> None:
        """In the reader thread: to disk first."""
        if isinstance(item, Received):
            self.raw.append(item.host_ns, item.data)
        elif isinstance(item, Opened):
            self.raw.mark(item.host_ns, f"open {datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ} {item.name}")
        elif isinstance(item, Closed):
            self.raw.mark(item.host_ns, f"close {item.why}")

    def _take(self, item: object) -> list[Event]:
        if isinstance(item, Exception):
            raise item
        if isinstance(item, Received):
            self._decoded += len(item.data)
            return self.decoder.feed(item.data)
        if isinstance(item, Opened):
            self.connected, self.why = True, ""
            return new_connection(self.decoder)
        self.connected, self.why = False, item.why
        return []
