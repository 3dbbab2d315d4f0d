"""The raw bytes of a recording, decoded into the same logs again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

from session.files.reading import open_file
from session.recording.decisions import Decision, decision_of, name_kept
from session.recording.logwriter import LogWriter
from session.recording.rawfile import read_events
from session.recording.sorting import Sorting, other_board
from session.stream.decoder import StreamDecoder
from session.stream.events import Event, Trouble

BLOCK = 1 << 18


def stream(
    raw_path: Path, decoder: StreamDecoder, logs: LogWriter, sorting: Sorting | None = None
) -> Iterator[tuple[int | None, list[Event | Decision]]]:
    """Decode a raw file into ``logs``, giving (host_ns or None, events) piece by piece, with what was decided between them.

    Events of another board are not given; its logs have other names.  The caller finishes decoder and logs.
    """
    sorting = sorting or Sorting(decoder, logs)
    with open_file(raw_path) as raw:
        marks = read_events(raw_path)
        sorting.opened(0, other_board(marks, -1))
        for number, mark in enumerate(marks):
            yield from _until(raw, mark.offset, decoder, sorting)
            if mark.event.partition(" ")[0] == "open":
                yield mark.host_ns, [*new_connection(decoder, sorting, mark.offset, other_board(marks, number))]
            elif (decision := decision_of(mark)) is not None:
                if decision.word == "begin":  # a file that was kept bears its last name from the beginning
                    logs.begin(name_kept(marks, number) or decision.rest)
                elif decision.word in ("pause", "keep"):
                    logs.pause()
                yield mark.host_ns, [replace(decision, log=logs.paths[-1].name if logs.paths else "")]
        yield from _until(raw, None, decoder, sorting)


def new_connection(decoder: StreamDecoder, sorting: Sorting, offset: int, since: int | None = None) -> list[Event]:
    """The port was opened behind so many bytes, for the first time or again: what came before is over.  since: as of ``Sorting``."""
    events = sorting.take(decoder.finish())
    sorting.opened(offset, since)
    return [*events, *sorting.take([Trouble("reconnect")])] if decoder.samples else events


def _until(
    raw: BinaryIO, offset: int | None, decoder: StreamDecoder, sorting: Sorting
) -> Iterator[tuple[int | None, list[Event | Decision]]]:
    while (size := BLOCK if offset is None else min(BLOCK, offset - raw.tell())) > 0 and (data := raw.read(size)):
        yield None, [*sorting.take(decoder.feed(data))]
