"""The raw bytes of a recording, decoded into the same logs again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

from session.files.reading import open_file
from session.recording.decisions import Decision, decision_of, name_kept
from session.recording.logwriter import LogWriter
from session.recording.rawfile import Mark, read_events
from session.recording.sorting import Sorting, other_board
from session.stream.decoder import StreamDecoder
from session.stream.events import Event, Trouble

#: bytes decoded in one go; whoever asks for the next piece may stop between two
BLOCK = 1 << 16

Piece = tuple[int | None, list[Event | Decision]]


def stream(raw_path: Path, decoder: StreamDecoder, logs: LogWriter, sorting: Sorting | None = None) -> Iterator[Piece]:
    """Decode a raw file into ``logs``, giving (host_ns or None, events) piece by piece, with what was decided between them.

    Events of another board are not given; its logs have other names.  What is added to the file behind this call is not looked at.
    The caller finishes decoder and logs.
    """
    with open_file(raw_path):
        size = raw_path.stat().st_size
    return _pieces(raw_path, size, read_events(raw_path), decoder, logs, sorting or Sorting(decoder, logs))


def _pieces(raw_path: Path, size: int, marks: list[Mark], decoder: StreamDecoder, logs: LogWriter, sorting: Sorting) -> Iterator[Piece]:
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


def new_connection(decoder: StreamDecoder, sorting: Sorting, offset: int, since: int | None = None) -> list[Event]:
    """The port was opened behind so many bytes, for the first time or again: what came before is over.  since: as of ``Sorting``."""
    events = sorting.take(decoder.finish())
    sorting.opened(offset, since)
    return [*events, *sorting.take([Trouble("reconnect")])] if decoder.samples else events


def _until(raw: BinaryIO, offset: int, decoder: StreamDecoder, sorting: Sorting) -> Iterator[Piece]:
    while (size := min(BLOCK, offset - raw.tell())) > 0 and (data := raw.read(size)):
        yield None, [*sorting.take(decoder.feed(data))]
