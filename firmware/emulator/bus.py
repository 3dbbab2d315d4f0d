"""Simulated time in cycles of the core, and the peripherals at their addresses."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable
from typing import Protocol

CORE_HZ = 168_000_000
NEVER = math.inf


class TimedCall:
    """A call scheduled for a cycle, unless ``do`` is set to None."""

    def __init__(self, cycle: float, do: Callable[[], None] | None):
        self.cycle, self.do = cycle, do


class CycleClock:
    """executed: instructions that the core has run since ``base`` cycles; per_instruction: cycles of each of them.

    replan: called for a new or an earlier event while the core runs.
    """

    def __init__(self, per_instruction: float):
        self.per_instruction, self.base = per_instruction, 0.0
        self.executed: Callable[[], int] = lambda: 0
        self.replan: Callable[[], None] = lambda: None
        self._events: list[tuple[float, int, TimedCall]] = []
        self._order = itertools.count()

    def clear(self) -> None:
        self._events.clear()

    def now(self) -> float:
        """Cycles since the start."""
        return self.base + self.executed() * self.per_instruction

    def now_s(self) -> float:
        return self.now() / CORE_HZ

    def at(self, cycle: float, do: Callable[[], None]) -> TimedCall:
        """Schedule a call for a cycle."""
        event = TimedCall(cycle, do)
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
        """Run all calls that are due, in order."""
        while self.next() <= self.now():
            do = heapq.heappop(self._events)[2].do
            if do:
                do()

    def skip_to(self, cycle: float) -> None:
        """Skip a waiting loop of the core until a cycle, or until the next event.  A wait for nothing is executed."""
        ahead = min(cycle, self.next()) - self.now()
        if cycle < NEVER and ahead > 0:
            self.base += ahead
            self.replan()


# The peripherals at their addresses, each with its clock; a program's errors in their use.

BLOCK, RCC, GPIOA = 0x400, 0x40023800, 0x40020000
#: peripheral -> its name, enable register's offset in RCC, bit
CLOCKS = {
    GPIOA: ("GPIOA", 0x30, 0),
    0x40026400: ("DMA2", 0x30, 22),
    0x40004400: ("USART2", 0x40, 17),
    0x40011000: ("USART1", 0x44, 4),
    0x40013000: ("SPI1", 0x44, 12),
}
#: of RCC_CSR, with the reset pin's flag, which every reset sets
POWER_UP, SOFTWARE_RESET, WATCHDOG_RESET = 0x0E000000, 1 << 28 | 1 << 26, 1 << 29 | 1 << 26
REMOVE_FLAGS = 1 << 24


class Peripheral(Protocol):
    """A block of registers, accessed by offsets of whole words."""

    def read(self, offset: int) -> int: ...

    def write(self, offset: int, value: int) -> None: ...


class Kept:
    """A peripheral that is not emulated: written values can be read back."""

    def __init__(self) -> None:
        self.words: dict[int, int] = {}

    def read(self, offset: int) -> int:
        return self.words.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        self.words[offset] = value


class Rcc(Kept):
    """Clocks: every oscillator and the PLL are ready at once, and the switch follows immediately.  causes: flags of CSR that name the
    causes of resets, until the program removes them."""

    def __init__(self, causes: int = POWER_UP) -> None:
        self.words = {0x00: 0x83, 0x04: 0x24003010}
        self.causes = causes

    def read(self, offset: int) -> int:
        value = super().read(offset)
        if offset == 0x00:
            return value | (value & 1 << 24) << 1
        if offset == 0x08:
            return value & ~0xC | (value & 3) << 2
        return value | self.causes if offset == 0x74 else value

    def write(self, offset: int, value: int) -> None:
        if offset == 0x74:
            self.causes = 0 if value & REMOVE_FLAGS else self.causes
            value &= 1
        super().write(offset, value)

    @property
    def core_hz(self) -> float:
        """Core clock as the registers set it, from the internal oscillator."""
        pll = super().read(0x04)
        return 16e6 / (pll & 0x3F) * (pll >> 6 & 0x1FF) / (2 * (pll >> 16 & 3) + 2) if super().read(0x08) & 3 == 2 else 16e6

    def divider(self, apb: int) -> int:
        """Cycles of the core per cycle of APB1 or APB2."""
        return 1 << max(0, (super().read(0x08) >> {1: 10, 2: 13}[apb] & 7) - 3)


class Bus:
    """objections: errors of the program that the part does not allow or would ignore, each reported once."""

    def __init__(self) -> None:
        self.rcc = Rcc()
        self.blocks: dict[int, Peripheral] = {RCC: self.rcc}
        self.objections: dict[str, None] = {}

    def object(self, what: str) -> None:
        self.objections[what] = None

    def _block(self, address: int) -> Peripheral:
        start = address & ~(BLOCK - 1)
        if start in CLOCKS:
            name, offset, bit = CLOCKS[start]
            if not self.rcc.words.get(offset, 0) >> bit & 1:
                self.object(f"{name} is used while its clock is off")
                return Kept()
        return self.blocks.setdefault(start, Kept())

    def read(self, address: int) -> int:
        return self._block(address).read(address & BLOCK - 4)

    def write(self, address: int, value: int) -> None:
        self._block(address).write(address & BLOCK - 4, value)

    def reset(self, cause: int) -> None:
        """Reset the bus for a cause, flags of RCC_CSR; the peripherals must be added again."""
        self.rcc = Rcc(self.rcc.causes | cause)
        self.blocks = {RCC: self.rcc}

    def check_clock(self) -> None:
        """Object if the core clock is not 168 MHz, which the simulated time assumes."""
        if abs(self.rcc.core_hz - CORE_HZ) > 1:
            self.object(f"the core's clock is set to {self.rcc.core_hz / 1e6:g} MHz; emulated are {CORE_HZ / 1e6:g}")
