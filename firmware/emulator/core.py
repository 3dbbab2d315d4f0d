"""The core's own registers: SysTick, exceptions (ARMv7-M, B1.5), reset; and a port of pins."""

from __future__ import annotations

from collections.abc import Callable

from emulator.bus import CycleClock, Kept, TimedCall

HARD_FAULT, SYSTICK, EXTERNAL = 3, 15, 16


class Nvic:
    """pending, active (innermost last): numbers of exceptions.  All have one priority, as the firmware leaves it; only a fault, which the
    machine enters by itself, interrupts a handler."""

    def __init__(self) -> None:
        self.pending: set[int] = set()
        self.active: list[int] = []
        self.enabled = {SYSTICK}
        self._high: set[int] = set()  # interrupt lines that are high

    def line(self, interrupt: int, high: bool) -> None:
        """Set a peripheral's interrupt line: while it is high the interrupt is pending again as soon as its handler has returned."""
        number = EXTERNAL + interrupt
        if not high:
            self._high.discard(number)
        elif number not in self._high:
            self._high.add(number)
            self.pending.add(number)

    @property
    def due(self) -> int:
        """The exception that interrupts the running code; 0 where none does."""
        return 0 if self.active else min(self.pending & self.enabled, default=0)

    def enter(self, number: int) -> None:
        self.pending.discard(number)
        self.active.append(number)

    def leave(self) -> None:
        number = self.active.pop()
        if number in self._high:
            self.pending.add(number)

    def enable(self, word: int, bits: int) -> None:
        """A write to ISER."""
        self.enabled |= {EXTERNAL + 32 * word + n for n in range(32) if bits >> n & 1}


AIRCR, DEBUG_FREEZE, IWDG_STOP = 0xE000ED0C, 0xE0042008, 1 << 12
SYSTICK_CSR, SYSTICK_RVR, SYSTICK_CVR = 0xE000E010, 0xE000E014, 0xE000E018
ISER = range(0xE000E100, 0xE000E10C, 4)
RESET_KEY, RESET_REQUEST = 0x05FA0000, 1 << 2


class SysTick:
    """Counter that runs down at the core's clock."""

    def __init__(self, clock: CycleClock, nvic: Nvic):
        self._clock, self._nvic = clock, nvic
        self._csr, self._rvr, self._zero = 0, 0, 0.0
        self._event: TimedCall | None = None

    def _restart(self) -> None:
        if self._event:
            self._event.do = None
        self._zero = self._clock.now()
        self._event = self._clock.at(self._zero + self._rvr + 1, self._tick) if self._csr & 1 and self._rvr else None

    def _tick(self) -> None:
        self._zero += self._rvr + 1
        if self._csr & 2:
            self._nvic.pending.add(SYSTICK)
        self._event = self._clock.at(self._zero + self._rvr + 1, self._tick)

    def read(self, address: int) -> int:
        if address == SYSTICK_CVR:
            return max(0, self._rvr - int(self._clock.now() - self._zero)) if self._csr & 1 else 0
        return self._csr if address == SYSTICK_CSR else self._rvr

    def write(self, address: int, value: int) -> None:
        if address == SYSTICK_RVR:
            self._rvr = value & 0xFFFFFF
            return
        if address == SYSTICK_CSR:
            goes_on = value & self._csr & 1
            self._csr = value & 7
            if goes_on:
                return
        self._restart()


class Core:
    """reset: called when the program requests a reset."""

    def __init__(self, clock: CycleClock, nvic: Nvic, reset: Callable[[], None]):
        self._nvic, self._reset, self.ticks = nvic, reset, SysTick(clock, nvic)
        self._kept: dict[int, int] = {}

    @property
    def watchdog_stops(self) -> bool:
        """Whether the watchdog stands still while a debugger holds the core (DBG_IWDG_STOP)."""
        return bool(self._kept.get(DEBUG_FREEZE, 0) & IWDG_STOP)

    def read(self, address: int) -> int:
        return self.ticks.read(address) if SYSTICK_CSR <= address <= SYSTICK_CVR else self._kept.get(address, 0)

    def write(self, address: int, value: int) -> None:
        if SYSTICK_CSR <= address <= SYSTICK_CVR:
            self.ticks.write(address, value)
        elif address in ISER:
            self._nvic.enable((address - ISER[0]) // 4, value)
        elif address == AIRCR:
            if value & 0xFFFF0000 == RESET_KEY and value & RESET_REQUEST:
                self._reset()
        else:
            self._kept[address] = value


MODER, ODR, BSRR, AFRL, AFRH = 0x00, 0x14, 0x18, 0x20, 0x24
OUTPUT, ALTERNATE = 1, 2


class Gpio(Kept):
    """Port A.  select: called with the level of the pin that is the sensor's chip select."""

    SELECT = 4

    def __init__(self, select: Callable[[bool], None]) -> None:
        self.words = {MODER: 0xA8000000}
        self._select = select

    def alternate(self, pin: int) -> int:
        """The alternate function of a pin, or -1."""
        function = self.words.get(AFRH if pin > 7 else AFRL, 0) >> 4 * (pin & 7) & 15
        return function if self.words[MODER] >> 2 * pin & 3 == ALTERNATE else -1

    def _level(self) -> bool:
        is_output = self.words[MODER] >> 2 * self.SELECT & 3 == OUTPUT
        return not is_output or bool(self.words.get(ODR, 0) >> self.SELECT & 1)

    def write(self, offset: int, value: int) -> None:
        before = self._level()
        if offset == BSRR:
            self.words[ODR] = self.words.get(ODR, 0) & ~(value >> 16) | value & 0xFFFF
        else:
            super().write(offset, value)
        if self._level() != before:
            self._select(self._level())
