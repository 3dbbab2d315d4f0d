"""The raw bytes of a recording, decoded into the same logs again."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from session.common.errors import FormatError
from session.recording.logwriter import LogWriter
from session.recording.rawfile import read_marks
from session.stream.decoder import StreamDecoder
from session.stream.events import Event, Trouble

BLOCK = 1 << 18


def stream(raw_path: Path, decoder: StreamDecoder, logs: LogWriter) -> Iterator[tuple[int | None, list[Event]]]:
    """Decode a raw file into ``logs``, giving (host_ns or None, events) piece by piece.  The caller finishes decoder and logs."""
    try:
        raw = raw_path.open("rb")
    except OSError as error:
        raise FormatError(f"{raw_path}: cannot be read ({error.strerror or error})") from None
    with raw:
        for mark in [mark for mark in read_marks(raw_path) if mark.event]:
            yield from _until(raw, mark.offset, decoder, logs)
            word, _, rest = mark.event.partition(" ")
            if word == "open":
                logs.write(events := new_connection(decoder))
                yield mark.host_ns, events
            elif word == "begin" and rest.isidentifier():
                logs.begin(rest)
        yield from _until(raw, None, decoder, logs)


def new_connection(decoder: StreamDecoder) -> list[Event]:
    """The port was opened, for the first time or again: what came before is over."""
    events = decoder.finish()
    return [*events, Trouble("reconnect")] if decoder.samples else events


def _until(raw: BinaryIO, offset: int | None, decoder: StreamDecoder, logs: LogWriter) -> Iterator[tuple[int | None, list[Event]]]:
    while (size := BLOCK if offset is None else min(BLOCK, offset - raw.tell())) > 0 and (data := raw.read(size)):
        events = decoder.feed(data)
        logs.write(events)
        yield None, events
