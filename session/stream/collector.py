"""What one call of the decoder gives: its events, gathered."""

from __future__ import annotations

import numpy as np

from session.stream.events import Chunk, Event, Trouble


class Collector:
    """Events in order, with as few objects as possible: between two that have a place, one chunk, and one count of each trouble."""

    _COUNTED = ("lost", "crc", "garbage")

    def __init__(self) -> None:
        self._done: list[Event] = []
        self._chunks: list[Chunk] = []
        self._counts: dict[str, Trouble] = {}

    def add(self, event: Event) -> None:
        """One more."""
        if isinstance(event, Chunk):
            self._chunks.append(event)
        elif isinstance(event, Trouble) and event.kind in self._COUNTED:
            before = self._counts.get(event.kind)
            self._counts[event.kind] = event if before is None else Trouble(event.kind, before.count + event.count, before.t_us)
        else:
            self._close()
            last = self._done[-1] if self._done else None
            if (
                isinstance(event, Trouble)
                and isinstance(last, Trouble)
                and last.kind == event.kind == "implausible"
                and last.t_us == event.t_us
            ):
                self._done[-1] = Trouble(event.kind, last.count + event.count, event.t_us)
            else:
                self._done.append(event)

    def events(self) -> list[Event]:
        """All so far."""
        self._close()
        return self._done

    def _close(self) -> None:
        if len(self._chunks) > 1:
            t_us, registers = (np.concatenate([getattr(chunk, name) for chunk in self._chunks]) for name in ("t_us", "registers"))
            self._chunks = [Chunk(t_us, registers, self._chunks[0].form)]
        self._done += [*self._chunks, *self._counts.values()]
        self._chunks, self._counts = [], {}
