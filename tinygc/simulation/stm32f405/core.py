"""The core's own registers: SysTick, the cycle counter, the NVIC and what belongs to the system."""

from __future__ import annotations

from collections.abc import Callable

from tinygc.simulation.stm32f405.clock import Clock, Event
from tinygc.simulation.stm32f405.nvic import PENDSV, PRIORITY_BITS, SYSTICK, Nvic

CPUID, ICSR, VTOR, AIRCR, SHPR = 0xE000ED00, 0xE000ED04, 0xE000ED08, 0xE000ED0C, range(0xE000ED18, 0xE000ED24, 4)
DEMCR, DWT_CTRL, CYCCNT = 0xE000EDFC, 0xE0001000, 0xE0001004
SYSTICK_CSR, SYSTICK_RVR, SYSTICK_CVR = 0xE000E010, 0xE000E014, 0xE000E018
NVIC_FIRST, NVIC_LAST = 0xE000E100, 0xE000E4EF
RESET_KEY, RESET_REQUEST = 0x05FA0000, 1 << 2
TURN, TURNS, SKIP = 60, 3, 168  #: a wait for CYCCNT: turns of at most so many cycles; after so many, each is made a microsecond long


class SysTick:
    """Counts down at the core's clock, or at an eighth of it."""

    def __init__(self, clock: Clock, nvic: Nvic):
        self._clock, self._nvic = clock, nvic
        self._csr, self._rvr, self._zero = 0, 0, 0.0
        self._counted = False
        self._event: Event | None = None

    @property
    def _period(self) -> int:
        return (self._rvr + 1) * (1 if self._csr & 4 else 8)

    def _restart(self) -> None:
        if self._event:
            self._event.cancel()
        self._zero = self._clock.now()
        self._event = self._clock.at(self._zero + self._period, self._tick) if self._csr & 1 and self._rvr else None

    def _tick(self) -> None:
        self._zero += self._period
        self._counted = True
        if self._csr & 2:
            self._nvic.pend(SYSTICK)
        self._event = self._clock.at(self._zero + self._period, self._tick)

    def read(self, address: int) -> int:
        """CSR, RVR or CVR."""
        if address == SYSTICK_CSR:
            value, self._counted = self._csr | self._counted << 16, False
            return value
        if address == SYSTICK_RVR:
            return self._rvr
        if not self._csr & 1 or not self._rvr:
            return 0
        gone = int((self._clock.now() - self._zero) / (1 if self._csr & 4 else 8))
        return max(0, self._rvr - gone)

    def write(self, address: int, value: int) -> None:
        """CSR, RVR or CVR, which any value sets to 0."""
        if address == SYSTICK_RVR:
            self._rvr = value & 0xFFFFFF
            return
        if address == SYSTICK_CSR:
            started = value & 1 and not self._csr & 1
            self._csr = value & 7
            if self._csr & 1 and not started:
                return
        self._restart()


class CycleCounter:
    """CYCCNT of the DWT.  A loop that waits for it is spared most of its turns."""

    def __init__(self, clock: Clock):
        self._clock, self._zero, self._on, self._stood = clock, 0.0, False, 0
        self._last, self._turns = -1e9, 0

    def switch(self, on: bool) -> None:
        """Count, or stand still."""
        if on and not self._on:
            self._zero = self._clock.now() - self._stood
        elif not on:
            self._stood = self.read()
        self._on = on

    def read(self) -> int:
        """Cycles, 32 bits."""
        if not self._on:
            return self._stood
        now = self._clock.now()
        self._turns = self._turns + 1 if now - self._last < TURN else 0
        if self._turns > TURNS:
            self._clock.skip_to(now + SKIP)
        self._last = self._clock.now()
        return int(self._last - self._zero) & 0xFFFFFFFF

    def write(self, value: int) -> None:
        """Set it."""
        self._stood, self._zero = value, self._clock.now() - value

    def broken(self) -> None:
        """Something else was done: it is no loop that only waits."""
        self._turns = 0


class Core:
    """vectors: where they are; reset: called where the program asks for a reset."""

    def __init__(self, clock: Clock, nvic: Nvic, reset: Callable[[], None]):
        self.vectors = 0x08000000
        self._nvic, self._reset = nvic, reset
        self.ticks, self.cycles = SysTick(clock, nvic), CycleCounter(clock)
        self._kept: dict[int, int] = {CPUID: 0x410FC241, AIRCR: 0xFA050000, DWT_CTRL: 0x40000000}

    def read(self, address: int, size: int) -> int:
        """Some bytes."""
        word = self._word(address & ~3)
        return word >> 8 * (address & 3) & (1 << 8 * size) - 1

    def _word(self, address: int) -> int:
        if address == CYCCNT:
            return self.cycles.read()
        if SYSTICK_CSR <= address <= SYSTICK_CVR:
            return self.ticks.read(address)
        if NVIC_FIRST <= address <= NVIC_LAST:
            return self._nvic.read(address - NVIC_FIRST)
        if address == VTOR:
            return self.vectors
        if address == ICSR:
            pending = self._nvic.pending
            active = self._nvic.active[-1] if self._nvic.active else 0
            return (PENDSV in pending) << 28 | (SYSTICK in pending) << 26 | max(pending, default=0) << 12 | active
        if address in SHPR:
            first = 4 + address - SHPR[0]
            return sum(priority << 8 * n for n, priority in enumerate(self._nvic.priority[first : first + 4]))
        return self._kept.get(address, 0)

    def write(self, address: int, size: int, value: int) -> None:
        """Some bytes."""
        self.cycles.broken()
        word = address & ~3
        if size < 4:
            shift, mask = 8 * (address & 3), (1 << 8 * size) - 1
            others = self._word(word) if 0xE000E400 <= word <= NVIC_LAST or word in SHPR or word in self._kept else 0
            value = others & ~(mask << shift) | (value & mask) << shift
        self._set_word(word, value)

    def _set_word(self, address: int, value: int) -> None:
        if address == CYCCNT:
            self.cycles.write(value)
        elif SYSTICK_CSR <= address <= SYSTICK_CVR:
            self.ticks.write(address, value)
        elif NVIC_FIRST <= address <= NVIC_LAST:
            self._nvic.write(address - NVIC_FIRST, value)
        elif address == VTOR:
            self.vectors = value & ~0x7F
        elif address == ICSR:
            for bit, number, sets in ((28, PENDSV, True), (27, PENDSV, False), (26, SYSTICK, True), (25, SYSTICK, False)):
                if value >> bit & 1:
                    (self._nvic.pending.add if sets else self._nvic.pending.discard)(number)
        elif address in SHPR:
            for n in range(4):
                self._nvic.priority[4 + address - SHPR[0] + n] = value >> 8 * n & PRIORITY_BITS
        elif address == AIRCR:
            if value & 0xFFFF0000 == RESET_KEY and value & RESET_REQUEST:
                self._reset()
        else:
            self._kept[address] = value
            if address in (DEMCR, DWT_CTRL):
                self.cycles.switch(bool(self._kept.get(DEMCR, 0) & 1 << 24 and self._kept.get(DWT_CTRL, 0) & 1))
