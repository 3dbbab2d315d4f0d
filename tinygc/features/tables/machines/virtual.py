"""A virtual table: the device's side of a make's dialogue over moving axes, with the faults of a real controller and its line.

In process it is an object that takes bytes and returns bytes, at any clock; ``TableLine`` puts it behind a port, on POSIX alone.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from session.bench.clocks import Clock
from tinygc.features.tables.machines.description import Description
from tinygc.features.tables.machines.virtual_makes import firmware_of
from tinygc.features.tables.machines.virtual_motion import Fault, Mechanics

if TYPE_CHECKING:
    from tinygc.simulation.terminal import Terminal

#: s that a late answer is late
LATE_S = 0.6


class VirtualTable:
    """A controller of ``description.make``, with ``tracks``, the true motion of each axis in seconds since it was switched on.

    The same seed changes the same bytes of garbled answers.
    """

    def __init__(self, description: Description, clock: Clock, faults: Sequence[Fault] = (), seed: int = 0):
        self.description = description
        self.mechanics = Mechanics(description, clock, faults)
        self.tracks = self.mechanics.tracks
        self._firmware = firmware_of(description.make)(self.mechanics)
        self._rng = np.random.default_rng(seed)
        self._answers: list[tuple[float, bytes]] = []  # when it is due, and what
        self._restarts = 0
        self._say(self._firmware.greeting())

    @property
    def is_connected(self) -> bool:
        """Whether the cable is in."""
        return not self.mechanics.suffers("cable")

    def feed(self, data: bytes = b"") -> bytes:
        """Take what the host sent; what the host receives by now."""
        mechanics = self.mechanics
        now_s = mechanics.now_s()
        if not self.is_connected:
            self._answers.clear()
            return b""
        if mechanics.restarts != self._restarts:
            self._restarts = mechanics.restarts
            self._firmware = firmware_of(self.description.make)(mechanics)
            self._say(self._firmware.greeting())
        self._say(self._firmware.events())
        for number in range(len(data)):
            self._say(self._firmware.take(data[number : number + 1]))
        due = b"".join(text for at_s, text in self._answers if at_s <= now_s)
        self._answers = [(at_s, text) for at_s, text in self._answers if at_s > now_s]
        return due

    def _say(self, text: bytes) -> None:
        mechanics = self.mechanics
        if not text or mechanics.suffers("silence"):
            return
        if mechanics.suffers("garbled"):
            changed = np.frombuffer(text, dtype=np.uint8).copy()
            wrong = self._rng.random(len(changed)) < 0.3
            changed[wrong] = self._rng.integers(0, 256, int(wrong.sum()))
            text = changed.tobytes()
        delay_s = LATE_S if mechanics.suffers("late") else 0.0
        self._answers += [(mechanics.now_s() + delay_s, text)] * (2 if mechanics.suffers("doubled") else 1)


#: name of the port where none is given
LINK = Path(tempfile.gettempdir()) / "tinygc-table"


class TableLine(Clock):
    """A virtual table at a terminal; a clock, too: while it waits, the table answers.

    resets: an opened port restarts the controller, as it does an Arduino Uno.
    """

    def __init__(self, table: VirtualTable, terminal: Terminal, resets: bool):
        self._table, self._terminal, self._resets = table, terminal, resets
        self._had_reader = False

    def sleep(self, seconds: float) -> None:
        """Answer the table's host, then wait."""
        self.answer()
        super().sleep(seconds)

    def answer(self) -> None:
        """Take what has come, and answer it.  Where the cable drops, the port goes away; the motion goes on."""
        if not self._table.is_connected:
            self._terminal.unplug()
        has_reader = self._terminal.has_reader
        if self._resets and has_reader and not self._had_reader:
            self._table.mechanics.restart()
        self._had_reader = has_reader
        if answer := self._table.feed(self._terminal.read()):
            self._terminal.write(answer)
