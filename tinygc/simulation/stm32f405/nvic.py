"""Exceptions: which are pending, which are enabled, and which is to be taken now (ARMv7-M, B1.5)."""

from __future__ import annotations

SVCALL, PENDSV, SYSTICK, EXTERNAL = 11, 14, 15, 16
LINES = 82
IDLE = 256  #: the priority of no exception at all
PRIORITY_BITS = 0xF0  #: of eight, those that this part has


class Nvic:
    """pending, active (innermost last): numbers of exceptions; priority: by number, the lower the more urgent."""

    def __init__(self) -> None:
        self.pending: set[int] = set()
        self.active: list[int] = []
        self.enabled = {SVCALL, PENDSV, SYSTICK}
        self.priority = [0] * (EXTERNAL + LINES)
        self._high: set[int] = set()  # lines that are held

    def line(self, interrupt: int, high: bool) -> None:
        """A peripheral's interrupt line: while it is high the interrupt is pending again as soon as its handler has returned."""
        number = EXTERNAL + interrupt
        if not high:
            self._high.discard(number)
        elif number not in self._high:
            self._high.add(number)
            self.pending.add(number)

    def pend(self, number: int) -> None:
        """An exception that is no held line."""
        self.pending.add(number)

    @property
    def wakes(self) -> bool:
        """Whether a core that waits for an interrupt goes on: masked ones wake it, too."""
        return any(number in self.enabled and self.priority[number] < self._running() for number in self.pending)

    def _running(self) -> int:
        return min((self.priority[number] for number in self.active), default=IDLE)

    def due(self, primask: int, basepri: int) -> int:
        """The exception that interrupts what runs now; 0 where none does."""
        ready = [number for number in self.pending if number in self.enabled]
        if not ready:
            return 0
        number = min(ready, key=lambda number: (self.priority[number], number))
        bar = min(self._running(), 0 if primask else IDLE, basepri or IDLE)
        return number if self.priority[number] < bar else 0

    def enter(self, number: int) -> None:
        """Its handler begins."""
        self.pending.discard(number)
        self.active.append(number)

    def leave(self) -> None:
        """The innermost handler has returned."""
        number = self.active.pop()
        if number in self._high:
            self.pending.add(number)

    # Registers, offsets from 0xE000E100

    def read(self, offset: int) -> int:
        """A word of ISER, ICER, ISPR, ICPR, IABR or IPR."""
        block, place = offset >> 7, offset & 0x7F
        if offset >= 0x300:
            first = EXTERNAL + (offset - 0x300)
            return sum(priority << 8 * n for n, priority in enumerate(self.priority[first : first + 4]))
        numbers = {0: self.enabled, 1: self.enabled, 2: self.pending, 3: self.pending, 4: set(self.active)}.get(block, set())
        first = EXTERNAL + 8 * place
        return sum(1 << n for n in range(32) if first + n in numbers)

    def write(self, offset: int, value: int) -> None:
        """A word."""
        if offset >= 0x300:
            for n in range(4):
                if EXTERNAL + offset - 0x300 + n < len(self.priority):
                    self.priority[EXTERNAL + offset - 0x300 + n] = value >> 8 * n & PRIORITY_BITS
            return
        first = EXTERNAL + 8 * (offset & 0x7F)
        numbers = {first + n for n in range(32) if value >> n & 1}
        if offset < 0x80:
            self.enabled |= numbers
        elif offset < 0x100:
            self.enabled -= numbers
        elif offset < 0x180:
            self.pending |= numbers
        elif offset < 0x200:
            self.pending -= numbers - self._high
