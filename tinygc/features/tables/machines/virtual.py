"""A virtual table: the device's side of a make's dialogue over moving axes, with the faults of a real controller and its line.

In process it is an object that takes bytes and returns bytes, at any clock; ``tinygc.features.tables.virtual_line`` puts it behind a port.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from session.bench.clocks import Clock, HostClock
from tinygc.features.tables.machines.description import Description
from tinygc.features.tables.machines.mechanics import AxisTrack, TableErrors
from tinygc.features.tables.machines.virtual_makes import firmware_of
from tinygc.features.tables.machines.virtual_motion import Fault, Mechanics

#: s that a late answer is late
LATE_S = 0.6


class VirtualTable:
    """A controller of ``description.make``, with ``tracks``, the true motion of each axis in seconds since it was switched on.

    errors: play of each axis (the other errors are the stage's: ``true_attitudes``); ``latency_s`` of its word.  The same seed changes
    the same bytes of garbled answers.
    """

    def __init__(
        self,
        description: Description,
        errors: TableErrors | None = None,
        clock: Clock | None = None,
        faults: Sequence[Fault] = (),
        seed: int = 0,
    ):
        self.description = description
        self.errors = errors or TableErrors.none(description)
        self.mechanics = Mechanics(description, self.errors, clock or HostClock(), faults)
        self._firmware = firmware_of(description.make)(self.mechanics)
        self._rng = np.random.default_rng(seed)
        self._answers: list[tuple[float, bytes]] = []  # when it is due, and what
        self._restarts = 0
        self._say(self._firmware.greeting())

    @property
    def tracks(self) -> tuple[AxisTrack, ...]:
        """Motion of each axis's motor, in seconds of the table."""
        return self.mechanics.tracks

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
