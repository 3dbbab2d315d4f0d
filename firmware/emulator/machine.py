"""The complete microcontroller: runs an ELF file until a time."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Protocol

from emulator.bus import CORE_HZ, GPIOA, POWER_UP, SOFTWARE_RESET, WATCHDOG_RESET, Bus, CycleClock, TimedCall
from emulator.core import HARD_FAULT, Core, Gpio, Nvic
from emulator.cpu import CORE, RETURNS, WAITS, Cpu, ProgramError, segments
from emulator.ports import SPI, Dma, Spi, SpiDevice, Usart

#: of a Cortex-M4F with the flash's caches, for such programs: an estimate that only a real core could verify
CYCLES_PER_INSTRUCTION = 1.5
EXCEPTION_CYCLES = 12  #: to enter a handler, and to leave it
LONGEST_RUN = 2_000_000
UNIQUE_ID, UID = 0x1FFF7A10, bytes.fromhex("2f0041000f51373238333932")


class Device(SpiDevice, Protocol):
    """A device on SPI1 and PA4."""

    def select(self, selected: bool, t_s: float) -> None:
        """Set its chip select."""


class Nothing:
    """No sensor: the line is pulled up."""

    def select(self, selected: bool, t_s: float) -> None:
        pass

    def transfer(self, out: bytes, t_s: float, byte_s: float) -> bytes:
        return bytes([0xFF]) * len(out)


# The independent watchdog (IWDG, RM0090, chapter 21).

PR, RLR, SR = 4, 8, 12
ACCESS, RELOAD, START = 0x5555, 0xAAAA, 0xCCCC
LSI_HZ = 32_000.0  #: typical; the STM32F405's data sheet allows 17 to 47 kHz
UPDATE_CYCLES = 5  #: of the oscillator, until a written value is taken over
FULL = 0xFFF


class Iwdg:
    """A counter of the low-speed oscillator; expire: called when it reaches its end.  A new prescaler or reload value counts from the next
    reload on.

    running: whether it was started, which only a reset ends; longest_s: the longest time between two reloads.
    """

    def __init__(self, clock: CycleClock, lsi_hz: float, expire: Callable[[], None], object_to: Callable[[str], None]):
        self._clock, self._tick, self._expire, self._object = clock, CORE_HZ / lsi_hz, expire, object_to
        self.running, self.longest_s, self._unlocked = False, 0.0, False
        self._words, self._taken_over = {PR: 0, RLR: FULL}, 0.0
        self._reloaded = 0.0
        self._end: TimedCall | None = None

    def _count_from(self, reload: int) -> None:
        if self._end:
            self._end.do = None
        period = (reload + 1) * (4 << self._words[PR]) * self._tick
        self._end = self._clock.at(self._clock.now() + period, self._expire)

    def read(self, offset: int) -> int:
        return 3 * (self._clock.now() < self._taken_over) if offset == SR else self._words.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        now = self._clock.now()
        if offset in self._words:
            if not self._unlocked:
                self._object("the watchdog is set without its key, and stays as it was")
            else:
                self._words[offset], self._taken_over = value, now + UPDATE_CYCLES * self._tick
            return
        self._unlocked = value == ACCESS
        if value == START or (value == RELOAD and self.running):
            if self.running:
                self.longest_s = max(self.longest_s, (now - self._reloaded) / CORE_HZ)
            self._count_from(self._words[RLR] if self.running and now >= self._taken_over else FULL)
            self.running, self._reloaded = True, now

    def stand_still(self, cycles: float) -> None:
        """Do not count these cycles: a debugger has stopped the core, and the program has set DBG_IWDG_STOP."""
        if self._end and self._end.do:
            cycle, self._reloaded = self._end.cycle + cycles, self._reloaded + cycles
            self._end.do = None
            self._end = self._clock.at(cycle, self._expire)


class Machine:
    """An STM32F405 with the program of an ELF file, after reset.

    device: on the SPI; stalls: (at_s, duration_s), times in which the core stops, as with a debugger, while everything else continues;
    lsi_hz: low-speed oscillator, which the watchdog counts.  hard_faults: whether a fault of the core enters its handler, without its cause
    in the registers; else it ends the run, and names the place.

    usart1, usart2: the ports; resets: number of resets, by the program or by its watchdog, and watchdog_resets: those by the watchdog;
    slept: cycles in ``wfi``; locked_up: whether the core stands still since a fault within its handler.
    """

    def __init__(
        self,
        elf: Path,
        device: Device | None = None,
        stalls: Iterable[tuple[float, float]] = (),
        lsi_hz: float = LSI_HZ,
        hard_faults: bool = False,
    ):
        self.device: Device = device or Nothing()
        self.bus, self.clock = Bus(), CycleClock(CYCLES_PER_INSTRUCTION)
        self.cpu = Cpu(self._read, self._write)
        self.clock.executed, self.clock.replan = self.cpu.executed, self._replan
        self._stalls = sorted((at_s * CORE_HZ, (at_s + duration_s) * CORE_HZ) for at_s, duration_s in stalls)
        self._segments = segments(elf)
        self.cpu.set_memory(UNIQUE_ID, UID)
        self.resets, self.watchdog_resets, self.slept = 0, 0, 0.0
        self._end, self._reset_cause, self._lsi_hz, self._hard_faults = 0.0, 0, lsi_hz, hard_faults
        self._power_up(POWER_UP)

    def _power_up(self, cause: int) -> None:
        """Set everything to its state after a reset with a cause, flags of RCC_CSR; RAM keeps its contents."""
        bus, clock = self.bus, self.clock
        bus.reset(cause)
        clock.clear()
        self.nvic = nvic = Nvic()
        self.core = Core(clock, nvic, lambda: self._ask_reset(SOFTWARE_RESET))
        self.iwdg = Iwdg(clock, self._lsi_hz, lambda: self._ask_reset(WATCHDOG_RESET), bus.object)
        pins, dma = Gpio(self._chip_select), Dma(self.cpu, nvic, bus.object)
        self.spi = Spi(clock, bus, dma, pins, self.device)
        self.usart1 = Usart(0x40011000, 37, 2, 9, dma.streams[7], clock, bus, nvic, dma, pins)
        self.usart2 = Usart(0x40004400, 38, 1, 2, None, clock, bus, nvic, dma, pins)
        bus.blocks |= {GPIOA: pins, 0x40011000: self.usart1, 0x40004400: self.usart2, SPI: self.spi, 0x40026400: dma, 0x40003000: self.iwdg}
        self._asleep, self.locked_up = False, False
        self.device.select(False, clock.now_s())
        for address, data in self._segments:
            self.cpu.set_memory(address, data)
        self.cpu.reset()

    def _ask_reset(self, cause: int) -> None:
        self._reset_cause = cause
        self.cpu.limit(0)

    def _reset(self) -> None:
        cause, self._reset_cause = self._reset_cause, 0
        self.resets += 1
        self.watchdog_resets += cause == WATCHDOG_RESET
        before = self.usart1, self.usart2
        for port in before:
            port.cut_off()
        self._power_up(cause)
        for old, new in zip(before, (self.usart1, self.usart2), strict=True):
            new.sent, new.lost = old.sent, old.lost

    def _chip_select(self, high: bool) -> None:
        if self.spi.busy:
            self.bus.object("the chip select changes while a byte is on its way")
        self.device.select(not high, self.clock.now_s())

    def _read(self, address: int) -> int:
        value = self.core.read(address) if address >= CORE else self.bus.read(address)
        if self.nvic.due:
            self.cpu.limit(0)
        return value

    def _write(self, address: int, value: int) -> None:
        (self.core if address >= CORE else self.bus).write(address, value)
        if self.nvic.due:
            self.cpu.limit(0)

    def _replan(self) -> None:
        """Limit the present run again, because an earlier event was scheduled."""
        if self.cpu.running:
            self.cpu.limit(self._budget() - 1)

    def _budget(self) -> int:
        ahead = min(self.clock.next(), self._end) - self.clock.now()
        return max(1, min(LONGEST_RUN, math.ceil(ahead / self.clock.per_instruction)))

    # Running

    def run_until(self, t_s: float) -> None:
        """Run until a simulated time."""
        clock = self.clock
        self._end = t_s * CORE_HZ
        while clock.now() < self._end:
            clock.fire()
            if self._reset_cause:
                self._reset()
            if self._stalls and self._stalls[0][0] <= clock.now():
                passed = self._let_pass(self._stalls[0][1])
                if self.core.watchdog_stops:
                    self.iwdg.stand_still(passed)
                if clock.now() >= self._stalls[0][1]:
                    del self._stalls[0]
            elif self.locked_up:
                self._let_pass(self._end)
            elif number := self.nvic.due:
                self._asleep = False
                self._enter(number)
            elif self._asleep:
                self.slept += self._let_pass(self._end)
            else:
                try:
                    self._run(self._budget())
                except ProgramError as error:
                    self._fault(error)

    def _let_pass(self, cycle: float) -> float:
        """Advance time without the core, up to the next event; return the cycles."""
        before = self.clock.now()
        self.clock.base = max(before, min(cycle, self.clock.next(), self._end))
        return self.clock.base - before

    def _enter(self, number: int) -> None:
        """Enter the handler of an exception."""
        self.nvic.enter(number)
        self.clock.base += EXCEPTION_CYCLES
        try:
            self.cpu.enter(number)
        except ProgramError as error:
            self._fault(error)

    def _fault(self, error: ProgramError) -> None:
        """Enter the handler of faults; within it, or without a stack, the core locks up (ARMv7-M, B1.5.15)."""
        if not self._hard_faults:
            raise error
        if HARD_FAULT in self.nvic.active:
            self.locked_up = True
        else:
            self._enter(HARD_FAULT)

    def _run(self, budget: int) -> None:
        why, executed = self.cpu.run(budget)
        self.clock.base += executed * self.clock.per_instruction
        if why == WAITS:
            self._asleep = not self.nvic.due
        elif why == RETURNS:
            if not self.nvic.active:
                raise ProgramError("return from an exception that there is none of")
            self.cpu.leave()
            self.nvic.leave()
            self.clock.base += EXCEPTION_CYCLES
