"""Simulated time in cycles of the core, and what is due when."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable

CORE_HZ = 168_000_000
NEVER = math.inf
TURN = 60  #: cycles; a loop that only waits has shorter turns, one that does something else meanwhile has longer ones


class Event:
    """Something that is due at a cycle; ``cancel`` it, and it is not."""

    __slots__ = ("cycle", "do")

    def __init__(self, cycle: float, do: Callable[[], None] | None):
        self.cycle, self.do = cycle, do

    def cancel(self) -> None:
        """It will not happen."""
        self.do = None


class Clock:
    """executed: instructions that the core has run since ``base`` cycles; per_instruction: cycles of each of them.

    replan: told of a new or a nearer event while the core runs; skipped: cycles for which the core was spared its own waiting.
    """

    def __init__(self, per_instruction: float):
        self.per_instruction = per_instruction
        self.base = 0.0
        self.executed: Callable[[], int] = lambda: 0
        self.replan: Callable[[], None] = lambda: None
        self.skipped = 0.0
        self._events: list[tuple[float, int, Event]] = []
        self._order = itertools.count()

    def now(self) -> float:
        """Cycles since the start."""
        return self.base + self.executed() * self.per_instruction

    def now_s(self) -> float:
        """Seconds since the start."""
        return self.now() / CORE_HZ

    def at(self, cycle: float, do: Callable[[], None]) -> Event:
        """Let it happen at a cycle."""
        event = Event(cycle, do)
        heapq.heappush(self._events, (cycle, next(self._order), event))
        if self._events[0][2] is event:
            self.replan()
        return event

    def next(self) -> float:
        """The cycle of the next event, or infinity."""
        while self._events and self._events[0][2].do is None:
            heapq.heappop(self._events)
        return self._events[0][0] if self._events else NEVER

    def fire(self) -> None:
        """All that is due by now, in its order."""
        while self.next() <= self.now():
            do = heapq.heappop(self._events)[2].do
            if do:
                do()

    def skip_to(self, cycle: float) -> None:
        """The core waits in a loop for something that is due at a cycle: spare it the turns until then, or until the next event.

        For something that will never come it waits itself.
        """
        ahead = min(cycle, self.next()) - self.now()
        if cycle < NEVER and ahead > 0:
            self.base += ahead
            self.skipped += ahead
            self.replan()


class Poll:
    """Notices a core that reads the same from a status register again and again, with nothing else done to that peripheral.

    turns: after so many in a row it counts as a loop that only waits.
    """

    def __init__(self, clock: Clock, turns: int = 1) -> None:
        self._clock, self._turns = clock, turns
        self._last, self._at, self._same = -1, -NEVER, 0

    def again(self, value: int) -> bool:
        """Whether it was the last value, too, and a moment ago, often enough."""
        now = self._clock.now()
        self._same = self._same + 1 if value == self._last and now - self._at < TURN else 0
        self._last, self._at = value, now
        return self._same >= self._turns

    def broken(self) -> None:
        """Something else was done."""
        self._last = -1
