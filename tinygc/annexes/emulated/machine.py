"""The complete microcontroller: runs an ELF file until a time."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Protocol

from tinygc.annexes.emulated import spi, usart
from tinygc.annexes.emulated.bus import (
    BLOCK,
    CORE_HZ,
    NEVER,
    POWER_UP,
    SOFTWARE_RESET,
    WATCHDOG_RESET,
    Bus,
    CycleClock,
    Kept,
    TimedCall,
)
from tinygc.annexes.emulated.core import HARD_FAULT, SVCALL, Core, Exti, Gpio, Nvic, Syscfg
from tinygc.annexes.emulated.cpu import CALLS, CORE, FLASH, RETURNS, UNIQUE_ID, WAITS, Cpu, ProgramError, segments
from tinygc.annexes.emulated.spi import Dma
from tinygc.annexes.emulated.watchdog import LSI_HZ, Iwdg

#: of a Cortex-M4F with the flash's caches, for such programs: an estimate that only a real core could verify
CYCLES_PER_INSTRUCTION = 1.5
EXCEPTION_CYCLES = 12  #: to enter a handler, and to leave it
MASKED_RUN = 64  #: instructions until a masked pending interrupt is checked again
LONGEST_RUN = 2_000_000
CHIP_SELECT, INT1 = ("A", 4), ("C", 4)
UID = bytes.fromhex("2f0041000f51373238333932")


class Device(spi.SpiDevice, Protocol):
    """A device on SPI1, PA4 and PC4."""

    rises: int
    watched: bool

    def select(self, selected: bool, t_s: float) -> None:
        """Set its chip select."""

    def int1(self, t_s: float) -> bool:
        """Return the level of its interrupt pin."""

    def int1_stays_until(self, t_s: float) -> float:
        """Return a time before which that level cannot change without a transfer."""


class Nothing:
    """No sensor: the lines are pulled up."""

    rises, watched = 0, False

    def select(self, selected: bool, t_s: float) -> None:
        """Ignore the chip select."""

    def transfer(self, out: bytes, t_s: float, byte_s: float) -> bytes:
        """Return the level of the pulled-up line."""
        return bytes([0xFF]) * len(out)

    def int1(self, t_s: float) -> bool:
        """Return low: this line has no pull-up."""
        return False

    def int1_stays_until(self, t_s: float) -> float:
        """Return infinity."""
        return math.inf


class Machine:
    """An STM32F405 with the program of an ELF file, after reset.

    device: on the SPI; uid: the unique id, 12 bytes; stalls: (at_s, lasts_s), times in which the core stops, as with a debugger, while
    everything else continues; lsi_hz: low-speed oscillator, which the watchdog counts.  hard_faults: whether a fault of the core enters its
    handler, without its cause in the registers; else it ends the run, and says where.

    usart1, usart2: the ports; resets: number of resets, by the program or by its watchdog, and watchdog_resets: those by the watchdog;
    slept: cycles in ``wfi``; locked_up: whether the core stands still since a fault within its handler.
    Raises ValueError where the file is not a program for ARM, ProgramError where Unicorn is missing.
    """

    def __init__(
        self,
        elf: Path,
        device: Device | None = None,
        uid: bytes = UID,
        stalls: Iterable[tuple[float, float]] = (),
        cycles_per_instruction: float = CYCLES_PER_INSTRUCTION,
        lsi_hz: float = LSI_HZ,
        hard_faults: bool = False,
    ):
        self.device: Device = device or Nothing()
        self.bus, self.clock = Bus(), CycleClock(cycles_per_instruction)
        self.cpu = Cpu(self._read, self._write)
        self.clock.executed, self.clock.replan = self.cpu.executed, self._replan
        self._stalls = sorted((at_s * CORE_HZ, (at_s + lasts_s) * CORE_HZ) for at_s, lasts_s in stalls)
        self._segments = segments(elf)
        self.cpu.set_memory(UNIQUE_ID, uid)
        self.resets, self.watchdog_resets, self.slept = 0, 0, 0.0
        self._end, self._reset_asked, self._lsi_hz, self._hard_faults = 0.0, 0, lsi_hz, hard_faults
        self._power_up(POWER_UP)

    def _power_up(self, cause: int) -> None:
        """Set everything to its state after a reset with a cause, flags of RCC_CSR; RAM keeps its contents."""
        bus, clock = self.bus, self.clock
        bus.reset(cause)
        clock.clear()
        self.nvic = nvic = Nvic()
        self.core = Core(clock, nvic, lambda: self._ask_reset(SOFTWARE_RESET))
        self.iwdg = Iwdg(clock, self._lsi_hz, lambda: bus.rcc.low_speed_on, lambda: self._ask_reset(WATCHDOG_RESET), bus.object)
        self.exti = Exti(nvic, self._watch)
        self.ports = {name: Gpio(clock, 0xA8000000 if name == "A" else 0) for name in "ABCDEFGHI"}
        self.dma = Dma(clock, self.cpu, nvic, bus.object)
        a = self.ports["A"]
        self.spi = spi.Spi(clock, bus, nvic, self.dma, a, self.device)
        self.usart1 = usart.Usart("USART1", 0x40011000, 37, 2, ((7, 4),), clock, bus, nvic, self.dma, lambda: a.alternate(9) == 7)
        self.usart2 = usart.Usart("USART2", 0x40004400, 38, 1, (), clock, bus, nvic, self.dma, lambda: a.alternate(2) == 7)
        a.outputs[CHIP_SELECT[1]] = self._chip_select
        self.ports[INT1[0]].inputs[INT1[1]] = lambda: self.device.int1(clock.now_s())
        self.ports[INT1[0]].changes = lambda: self.device.int1_stays_until(clock.now_s()) * CORE_HZ + 1
        bus.blocks |= {0x40020000 + BLOCK * n: port for n, port in enumerate(self.ports.values())}
        bus.blocks |= {0x40011000: self.usart1, 0x40004400: self.usart2, spi.ADDRESS: self.spi, 0x40026400: self.dma}
        bus.blocks |= {0x40003000: self.iwdg, 0x40013C00: self.exti, 0x40013800: Syscfg(self.exti, self._watch), 0x40023C00: Kept()}
        self._asleep, self.locked_up, self._rises = False, False, 0
        self._pin_event: TimedCall | None = None
        self.device.select(False, clock.now_s())
        for address, data in self._segments:
            self.cpu.set_memory(address, data)
        self.cpu.reset(FLASH)

    def _ask_reset(self, cause: int) -> None:
        self._reset_asked = cause
        self.cpu.limit(0)

    def _reset(self) -> None:
        cause, self._reset_asked = self._reset_asked, 0
        self.resets += 1
        self.watchdog_resets += cause == WATCHDOG_RESET
        before = self.usart1, self.usart2
        for port in before:
            port.cut_off()
        self._power_up(cause)
        for old, new in zip(before, (self.usart1, self.usart2), strict=True):
            new.sent, new.lost = old.sent, old.lost

    # The sensor's wires

    def _chip_select(self, high: bool) -> None:
        self.spi.settle()
        if self.spi.busy:
            self.bus.object("the chip select changes while a byte is on its way")
        self.device.select(not high, self.clock.now_s())
        if high:
            self._watch()

    def _watch(self) -> None:
        """Pass an edge of INT1 to a program that uses it, and schedule the next check."""
        if self._pin_event:
            self._pin_event.cancel()
            self._pin_event = None
        port, pin = "ABCDEFGHI".index(INT1[0]), INT1[1]
        watched = self.device.watched = self.exti.watched(port, pin)
        if not watched:
            self._rises = self.device.rises
            return
        now_s = self.clock.now_s()
        high = self.device.int1(now_s)
        if self.device.rises != self._rises:
            self._rises = self.device.rises
            self.exti.edge(port, pin, True)
        if not high:
            self.exti.edge(port, pin, False)
        until_s = self.device.int1_stays_until(now_s)
        if until_s < NEVER:
            self._pin_event = self.clock.at(max(until_s * CORE_HZ + 1, self.clock.now() + 1), self._watch)

    # The bus

    def _read(self, address: int, size: int) -> int:
        value = self.core.read(address, size) if address >= CORE else self._peripheral(address, size)
        if self.nvic.pending and self.nvic.wakes:
            self.cpu.limit(0)
        return value

    def _peripheral(self, address: int, size: int) -> int:
        self.core.cycles.broken()
        return self.bus.read(address, size)

    def _write(self, address: int, size: int, value: int) -> None:
        if address >= CORE:
            self.core.write(address, size, value)
        else:
            self.core.cycles.broken()
            self.bus.write(address, size, value)
        if self.nvic.pending and self.nvic.wakes:
            self.cpu.limit(0)

    def _replan(self) -> None:
        """Limit the present run again, because an earlier event was scheduled."""
        if self.cpu.running:
            self.cpu.limit(self._budget() - 1)

    def _budget(self) -> int:
        ahead = min(self.clock.next(), self._end) - self.clock.now()
        return max(1, min(LONGEST_RUN, math.ceil(ahead / self.clock.per_instruction)))

    # Running

    @property
    def load(self) -> float:
        """Share of the time in which the core did not sleep; waiting loops count as work."""
        return 1 - self.slept / max(1.0, self.clock.now())

    @property
    def waited(self) -> float:
        """Share of the time in skipped waiting loops for a peripheral."""
        return self.clock.skipped / max(1.0, self.clock.now())

    def stall(self, lasts_s: float) -> None:
        """Stop the core from now on for a time."""
        now = self.clock.now()
        self._stalls.insert(0, (now, now + lasts_s * CORE_HZ))
        if self.cpu.running:
            self.cpu.limit(0)

    def run_until(self, t_s: float) -> None:
        """Run until a simulated time.  Raises ProgramError where the program faults."""
        clock, nvic = self.clock, self.nvic
        self._end = t_s * CORE_HZ
        while clock.now() < self._end:
            clock.fire()
            if self._reset_asked:
                self._reset()
                nvic = self.nvic
            if self._stalls and self._stalls[0][0] <= clock.now():
                passed = self._let_pass(self._stalls[0][1])
                if self.core.watchdog_stops:
                    self.iwdg.stand_still(passed)
                if clock.now() >= self._stalls[0][1]:
                    del self._stalls[0]
                continue
            if self.locked_up:
                self._let_pass(self._end)
                continue
            budget = self._budget()
            if nvic.pending:
                self._asleep = self._asleep and not nvic.wakes
                number = nvic.due(self.cpu.get("PRIMASK") & 1, self.cpu.get("BASEPRI"))
                if number:
                    self._enter(number)
                    continue
                if nvic.wakes:
                    budget = min(budget, MASKED_RUN)
            if self._asleep:
                self.slept += self._let_pass(self._end)
                continue
            try:
                self._run(budget)
            except ProgramError as error:
                self._fault(error)

    def _let_pass(self, cycle: float) -> float:
        """Advance time without the core, up to the next event; return the cycles."""
        clock = self.clock
        before = clock.now()
        clock.base = max(before, min(cycle, clock.next(), self._end))
        return clock.base - before

    def _enter(self, number: int) -> None:
        """Enter the handler of an exception."""
        self.nvic.enter(number)
        self.clock.base += EXCEPTION_CYCLES
        try:
            self.cpu.enter(number, self.core.vectors)
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
            self._asleep = not self.nvic.wakes
        elif why == RETURNS:
            if not self.nvic.active:
                raise ProgramError(f"return from an exception that there is none of, to 0x{self.cpu.pc:08x}")
            self.cpu.leave()
            self.nvic.leave()
            self.clock.base += EXCEPTION_CYCLES
        elif why == CALLS:
            self.nvic.pend(SVCALL)
