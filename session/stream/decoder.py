"""Bytes in, events out."""

from __future__ import annotations

import numpy as np

from session.stream import frames
from session.stream.events import Chunk, Comment, Event, Trouble
from session.stream.text import HEADER, parse_info, parse_line

WRAP_US = 2**32


class StreamDecoder:
    """Tells text from frames by itself, finds its way back after garbage, counts what is missing.

    Counts so far: samples, lost (samples missing), crc_errors (frames), garbage (bytes), implausible (samples left out), resets.
    """

    def __init__(self):
        self.samples = self.lost = self.crc_errors = self.garbage = self.implausible = self.resets = 0
        self.info = None  #: the last ``Info``
        self.mode = None  #: "text" or "frames" once it is known
        self._buffer = b""
        self._sequence = self._last = None
        self._t_us = 0

    def feed(self, data: bytes) -> list[Event]:
        """Events of these bytes and of what was kept from before; never raises, whatever the bytes."""
        self._buffer += data
        events: list[Event] = []
        if self.mode != "text" and b"\0" in self._buffer:
            self.mode = "frames"
            *tokens, self._buffer = self._buffer.split(b"\0")
            for token in tokens:
                self._frame(token, events)
        elif self.mode != "frames" and b"\n" in self._buffer:
            *lines, self._buffer = self._buffer.split(b"\n")
            for line in lines:
                self._line(line.rstrip(b"\r"), events)
        return _joined(events)

    def finish(self) -> list[Event]:
        """The stream ends here, or the port was closed: what is incomplete is dropped, what follows begins anew."""
        self._buffer, self.mode, self._sequence, self._last = b"", None, None, None
        return []

    def _frame(self, token: bytes, events: list[Event]) -> None:
        if len(token) not in (frames.SAMPLE_BYTES, frames.INFO_BYTES):
            self.garbage += len(token)
            if token:
                events.append(Trouble("garbage", len(token), self._last))
            return
        body, good = frames.decode_blocks(np.frombuffer(token, np.uint8)[None])
        if not good[0]:
            self.crc_errors += 1
            events.append(Trouble("crc", 1, self._last))
        elif len(token) == frames.INFO_BYTES:
            info = frames.decode_info(body.tobytes())
            sequence = int.from_bytes(body[0, 1:3].tobytes(), "little")
            if self._sequence is not None and sequence == (self._sequence + 1) & 0xFFFF:
                self._sequence = sequence
            if info:
                self.info = info
                events.append(info)
        else:
            row = np.ascontiguousarray(body).view(frames.SAMPLE)[0, 0]
            sequence = int(row["sequence"])
            if self._sequence is not None and (missing := (sequence - self._sequence - 1) & 0xFFFF) and missing < 0x8000:
                self.lost += missing
                events.append(Trouble("lost", missing, self._last))
            self._sequence = sequence
            self._sample(int(row["t_us"]), row["registers"].tolist(), events)

    def _line(self, line: bytes, events: list[Event]) -> None:
        if line.startswith(b"#"):
            comment = line[1:].decode("utf-8", errors="replace").strip()
            events.append(Comment(comment))
            if info := parse_info(comment):
                self.info = info
                events.append(info)
        elif values := parse_line(line):
            self.mode = "text"
            self._sample(values[0], values[1:8], events)
        elif line and line.decode("latin-1") != HEADER:
            self.garbage += len(line)
            events.append(Trouble("garbage", len(line), self._last))

    def _sample(self, raw_us: int, registers: list[int], events: list[Event]) -> None:
        if self._last is None:
            self._t_us = raw_us
        else:
            step = (raw_us - self._t_us) % WRAP_US
            if step >= WRAP_US // 2:
                self.resets += 1
                events.append(Trouble("reset", 1, self._last))
                self._t_us = raw_us
            else:
                self._t_us += step
        self._last = self._t_us
        self.samples += 1
        events.append(Chunk(np.array([self._t_us], np.int64), np.array([registers], np.int16)))


def _joined(events: list[Event]) -> list[Event]:
    """Neighbouring chunks as one."""
    joined: list[Event] = []
    for event in events:
        if isinstance(event, Chunk) and joined and isinstance(joined[-1], list):
            joined[-1].append(event)
        else:
            joined.append([event] if isinstance(event, Chunk) else event)
    return [
        Chunk(np.concatenate([c.t_us for c in e]), np.concatenate([c.registers for c in e])) if isinstance(e, list) else e for e in joined
    ]
