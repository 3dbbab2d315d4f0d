"""Simulated time in cycles of the core, and the peripherals at their addresses."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable
from typing import Protocol

# Simulated time in cycles of the core, and scheduled events.

CORE_HZ = 168_000_000
NEVER = math.inf
TURN = 60  #: cycles: a waiting loop has shorter iterations, one with other work has longer ones


class TimedCall:
    """A call scheduled for a cycle, unless ``cancel`` is called."""

    __slots__ = ("cycle", "do")

    def __init__(self, cycle: float, do: Callable[[], None] | None):
        self.cycle, self.do = cycle, do

    def cancel(self) -> None:
        """Cancel the call."""
        self.do = None


class CycleClock:
    """executed: instructions that the core has run since ``base`` cycles; per_instruction: cycles of each of them.

    replan: called for a new or an earlier event while the core runs; skipped: cycles of waiting loops that were not executed.
    """

    def __init__(self, per_instruction: float):
        self.per_instruction = per_instruction
        self.base = 0.0
        self.executed: Callable[[], int] = lambda: 0
        self.replan: Callable[[], None] = lambda: None
        self.skipped = 0.0
        self._events: list[tuple[float, int, TimedCall]] = []
        self._order = itertools.count()

    def clear(self) -> None:
        """Drop all scheduled calls."""
        self._events.clear()

    def now(self) -> float:
        """Return cycles since the start."""
        return self.base + self.executed() * self.per_instruction

    def now_s(self) -> float:
        """Return seconds since the start."""
        return self.now() / CORE_HZ

    def at(self, cycle: float, do: Callable[[], None]) -> TimedCall:
        """Schedule a call for a cycle."""
        event = TimedCall(cycle, do)
        heapq.heappush(self._events, (cycle, next(self._order), event))
        if self._events[0][2] is event:
            self.replan()
        return event

    def next(self) -> float:
        """Return the cycle of the next event, or infinity."""
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
        """Skip a waiting loop of the core until a cycle, or until the next event.

        A wait for an event that never comes is executed.
        """
        ahead = min(cycle, self.next()) - self.now()
        if cycle < NEVER and ahead > 0:
            self.base += ahead
            self.skipped += ahead
            self.replan()


class Poll:
    """Detects a core that reads the same value from a status register repeatedly, with no other access to that peripheral.

    turns: number of repetitions that counts as a waiting loop.
    """

    def __init__(self, clock: CycleClock, turns: int = 1) -> None:
        self._clock, self._turns = clock, turns
        self._last, self._at, self._same = -1, -NEVER, 0

    def again(self, value: int) -> bool:
        """Whether the value has been read often enough, each time shortly after the last."""
        now = self._clock.now()
        self._same = self._same + 1 if value == self._last and now - self._at < TURN else 0
        self._last, self._at = value, now
        return self._same >= self._turns

    def broken(self) -> None:
        """Reset after another access."""
        self._last = -1


# The peripherals at their addresses, each with its clock; a program's errors in their use.

BLOCK = 0x400
RCC = 0x40023800
#: peripheral -> (enable register's offset in RCC, bit)
CLOCKS = {0x40020000 + BLOCK * port: (0x30, port) for port in range(9)} | {
    0x40026400: (0x30, 22),
    0x40026000: (0x30, 21),
    0x40004400: (0x40, 17),
    0x40011000: (0x44, 4),
    0x40013000: (0x44, 12),
    0x40013800: (0x44, 14),
}
NAMES = {
    0x40026400: "DMA2",
    0x40026000: "DMA1",
    0x40004400: "USART2",
    0x40011000: "USART1",
    0x40013000: "SPI1",
    0x40013800: "SYSCFG",
} | {0x40020000 + BLOCK * port: f"GPIO{'ABCDEFGHI'[port]}" for port in range(9)}
HSI_HZ, HSE_HZ = 16_000_000, 8_000_000


class Peripheral(Protocol):
    """A block of registers, accessed by offsets of whole words."""

    def read(self, offset: int) -> int:
        """Read a word."""

    def write(self, offset: int, value: int) -> None:
        """Write a word."""


#: of RCC_CSR, with the reset pin's flag, which every reset sets
POWER_UP, SOFTWARE_RESET, WATCHDOG_RESET = 0x0E000000, 1 << 28 | 1 << 26, 1 << 29 | 1 << 26
REMOVE_FLAGS = 1 << 24


class Kept:
    """A peripheral that is not emulated: written values can be read back."""

    def __init__(self) -> None:
        self.words: dict[int, int] = {}

    def read(self, offset: int) -> int:
        """Read a word."""
        return self.words.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        """Write a word."""
        self.words[offset] = value


class Rcc(Kept):
    """Clocks: every oscillator and the PLL are ready at once, and the switch follows immediately.

    causes: flags of CSR that name the causes of resets, until the program removes them.
    """

    def __init__(self, causes: int = POWER_UP) -> None:
        super().__init__()
        self.words = {0x00: 0x83, 0x04: 0x24003010}
        self.causes = causes

    def read(self, offset: int) -> int:
        """Read a word, with the ready flags."""
        value = super().read(offset)
        if offset == 0x00:
            return value | sum(1 << bit + 1 for bit in (0, 16, 24, 26) if value >> bit & 1)
        if offset == 0x08:
            return value & ~0xC | (value & 3) << 2
        if offset in (0x70, 0x74):
            return value | (value & 1) << 1 | (self.causes if offset == 0x74 else 0)
        return value

    def write(self, offset: int, value: int) -> None:
        """Write a word."""
        if offset == 0x74:
            self.causes = 0 if value & REMOVE_FLAGS else self.causes
            value &= 1
        super().write(offset, value)

    @property
    def low_speed_on(self) -> bool:
        """Whether the low-speed oscillator is switched on."""
        return bool(super().read(0x74) & 1)

    def enabled(self, peripheral: int) -> bool:
        """Whether the peripheral's clock runs."""
        place = CLOCKS.get(peripheral)
        return place is None or bool(super().read(place[0]) >> place[1] & 1)

    @property
    def core_hz(self) -> float:
        """Core clock as the registers set it, with the usual crystal of 8 MHz."""
        cfgr, pll = super().read(0x08), super().read(0x04)
        if cfgr & 3 == 2:
            source = HSE_HZ if pll >> 22 & 1 else HSI_HZ
            system = source / max(1, pll & 0x3F) * (pll >> 6 & 0x1FF) / (2 * (pll >> 16 & 3) + 2)
        else:
            system = HSE_HZ if cfgr & 3 == 1 else HSI_HZ
        prescaler = cfgr >> 4 & 15
        return system / ({8: 2, 9: 4, 10: 8, 11: 16, 12: 64, 13: 128, 14: 256, 15: 512}.get(prescaler, 1))

    def divider(self, apb: int) -> int:
        """Return cycles of the core per cycle of APB1 or APB2."""
        code = super().read(0x08) >> {1: 10, 2: 13}[apb] & 7
        return 1 << max(0, code - 3)


class Bus:
    """objections: errors of the program that the part does not allow or would ignore, each reported once; strangers: addresses of
    peripherals that were used but are not emulated."""

    def __init__(self) -> None:
        self.rcc = Rcc()
        self.blocks: dict[int, Peripheral] = {RCC: self.rcc}
        self._live: dict[int, Peripheral] = {}  # peripherals whose clock was found to run
        self.objections: dict[str, None] = {}
        self.strangers: set[int] = set()

    def object(self, what: str) -> None:
        """Record an error of the program, once."""
        self.objections[what] = None

    def _block(self, address: int) -> Peripheral | None:
        start = address & ~(BLOCK - 1)
        if start in self._live:
            return self._live[start]
        if not self.rcc.enabled(start):
            self.object(f"{NAMES[start]} is used while its clock is off")
            return None
        block = self.blocks.get(start)
        if block is None:
            self.strangers.add(start)
            block = self.blocks[start] = Kept()
        self._live[start] = block
        return block

    def read(self, address: int, size: int) -> int:
        """Read some bytes of a peripheral."""
        block = self._block(address)
        if block is None:
            return 0
        value = block.read(address & BLOCK - 4)
        return value if size == 4 else value >> 8 * (address & 3) & (1 << 8 * size) - 1

    def write(self, address: int, size: int, value: int) -> None:
        """Write some bytes; a part of a word at its beginning is a word (the data registers), elsewhere the rest of the word is kept."""
        block = self._block(address)
        if block is None:
            return
        if address & 3:
            shift, mask = 8 * (address & 3), (1 << 8 * size) - 1
            value = block.read(address & BLOCK - 4) & ~(mask << shift) | (value & mask) << shift
        block.write(address & BLOCK - 4, value)
        if block is self.rcc:
            self._live.clear()

    def reset(self, cause: int) -> None:
        """Reset the bus for a cause, flags of RCC_CSR; the peripherals must be added again."""
        self.rcc = Rcc(self.rcc.causes | cause)
        self.blocks = {RCC: self.rcc}
        self._live.clear()

    def check_clock(self) -> None:
        """Record an error if the core clock is not 168 MHz, which the simulated time assumes."""
        if abs(self.rcc.core_hz - CORE_HZ) > 1:
            self.object(f"the core's clock is set to {self.rcc.core_hz / 1e6:g} MHz; emulated are {CORE_HZ / 1e6:g}")
