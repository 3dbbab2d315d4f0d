"""The processor core and its memory; only this file uses Unicorn."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

# Unicorn counts the instructions that it runs, but has no function that returns the count.  It is read from the engine's memory.
#
# ``emu_start(count=…)`` keeps two adjacent numbers in its ``uc_struct``: the instructions begun, and the limit.  Two short runs of
# no-operations with different counts locate them.  The first is the clock of the emulation; writing the second ends a run early, after any
# instruction, at no cost.  Where the numbers cannot be located there is no emulator, instead of a wrong clock.

WORDS = 500  #: of the engine's struct that are searched; it is much longer
RUNS = (1237, 389)


def find(engine: Any, address: int) -> int:
    """Locate the count in an engine that can run ``max(RUNS)`` no-operations from an address on."""
    candidates = set(range(WORDS - 1))
    for count in RUNS:
        engine.emu_start(address | 1, 0, count=count)
        words = (ctypes.c_size_t * WORDS).from_address(engine._uch.value)
        candidates = {place for place in candidates if words[place] == count + 1 and words[place + 1] == count}
    if len(candidates) != 1:
        raise RuntimeError("this version of Unicorn keeps its count elsewhere: expected that of constraints.txt")
    return candidates.pop()


def segments(path: Path) -> list[tuple[int, bytes]]:
    """(load address, bytes) of each loadable part of a program for ARM."""
    data = path.read_bytes()
    (table,), (size, count) = struct.unpack_from("<I", data, 28), struct.unpack_from("<HH", data, 42)
    parts = [struct.unpack_from("<5I", data, table + number * size) for number in range(count)]
    return [(address, data[offset : offset + length]) for kind, offset, _, address, length in parts if kind == 1 and length]


FLASH, RAM, CCM, SYSTEM = 0x08000000, 0x20000000, 0x10000000, 0x1FFF0000
#: address -> bytes, as in the linker's script; SYSTEM: the system memory with the unique id
MEMORIES = {FLASH: 1024 * 1024, RAM: 128 * 1024, CCM: 64 * 1024, SYSTEM: 32 * 1024}
PERIPHERALS, CORE = 0x40000000, 0xE0000000
#: address -> bytes of the ranges that the machine serves
WINDOWS = {PERIPHERALS: 0x80000, CORE: 0x100000}

NOP = b"\x00\xbf"
EXCEPTION_RETURN = 8
RAN, WAITS, RETURNS = "ran", "waits", "returns"
FPCA = 1 << 2


class ProgramError(RuntimeError):
    """A processor would fault; the message has the reason and the place."""


def missing() -> str:
    """What to install, or an empty string."""
    try:
        import unicorn  # noqa: F401
    except ImportError:
        return "not installed: unicorn (pip install unicorn)"
    return ""


class Cpu:
    """A Cortex-M4F with the STM32F405's memories; words at all other addresses go through two functions.

    instructions: run so far; running: whether a run is in progress.
    """

    def __init__(self, read: Callable[[int], int], write: Callable[[int, int], None]):
        import unicorn
        from unicorn import arm_const as arm

        self._arm, self._error = arm, unicorn.UcError
        self._engine: Any = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self._engine.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
        for address, size in MEMORIES.items():
            self._engine.mem_map(address, size)
        for address, size in WINDOWS.items():
            reads, writes = (
                self._safe(lambda at, of=address: read(of + at)),
                self._safe(lambda at, value, of=address: write(of + at, value)),
            )
            self._engine.mmio_map(address, size, lambda _, at, size, __, do=reads: do(at, size), None,
                                  lambda _, at, size, value, __, do=writes: do(at, size, value), None)  # fmt: skip
        self._trouble: BaseException | None = None  # an exception within an access
        self._engine.mem_write(SYSTEM, NOP * 2000)  # outside the program, because code that has run is not translated again
        self._place = find(self._engine, SYSTEM)
        self._words = (ctypes.c_size_t * (self._place + 2)).from_address(self._engine._uch.value)
        self._engine.mem_write(SYSTEM, bytes(4000))
        self._engine.hook_add(unicorn.UC_HOOK_INTR, self._interrupted)
        self._interrupt: int | None = None
        self.running, self.instructions = False, 0
        self._frame = [getattr(arm, f"UC_ARM_REG_{name}") for name in ("R0", "R1", "R2", "R3", "R12", "LR", "PC", "XPSR")]

    def _interrupted(self, engine: Any, number: int, data: Any) -> None:
        self._interrupt = number
        engine.emu_stop()

    def _safe(self, do: Callable[..., int | None]) -> Callable[..., int]:
        def called(at: int, size: int, *value: int) -> int:
            try:
                if size != 4 or at & 3:
                    raise ProgramError(f"an access of {size} bytes at 0x{at:05x} of the peripherals: only words are emulated")
                return do(at, *value) or 0
            except BaseException as trouble:  # Unicorn would print it, and go on
                self._trouble = trouble
                self._engine.emu_stop()
                return 0

        return called

    # Memory

    def memory(self, address: int, count: int) -> bytes:
        """Read bytes."""
        try:
            return bytes(self._engine.mem_read(address, count))
        except self._error:
            raise ProgramError(f"no memory at 0x{address:08x}") from None

    def set_memory(self, address: int, data: bytes) -> None:
        """Write bytes."""
        try:
            self._engine.mem_write(address, data)
        except self._error:
            raise ProgramError(f"no memory at 0x{address:08x}") from None

    def words(self, address: int, count: int) -> tuple[int, ...]:
        """Read words of 32 bits."""
        return struct.unpack(f"<{count}I", self.memory(address, 4 * count))

    # Running

    def executed(self) -> int:
        """The instructions of the present run, without the current one; 0 between runs."""
        return self._words[self._place] - 1 if self.running else 0

    def limit(self, instructions: int) -> None:
        """End the present run so many instructions after the current one."""
        self._words[self._place + 1] = self._words[self._place] + max(0, instructions)

    def run(self, instructions: int) -> tuple[str, int]:
        """Run at most so many: why the run ended, and the number of instructions."""
        self._interrupt, self.running = None, True
        pc, lr = self._frame[6], self._frame[5]
        where = self._engine.reg_read
        try:
            self._engine.emu_start(where(pc) | 1, 0, count=instructions)
        except self._error as error:
            raise ProgramError(f"{error} at 0x{where(pc):08x}, called from 0x{where(lr):08x}") from None
        finally:
            self.running = False
        begun, given = self._words[self._place], self._words[self._place + 1]
        if self._trouble:
            trouble, self._trouble = self._trouble, None
            raise trouble
        if self._interrupt not in (None, EXCEPTION_RETURN):
            raise ProgramError(f"exception {self._interrupt} of the emulator (undefined or a breakpoint) at 0x{where(pc):08x}")
        if self._interrupt is not None:
            why, executed = RETURNS, begun
        elif begun > given:  # the last one was begun, and stopped
            why, executed = RAN, begun - 1
        else:
            why, executed = WAITS, begun
        self.instructions += executed
        return why, executed

    # Registers and exceptions

    def get(self, name: str) -> int:
        """A register, by Unicorn's name for it."""
        return self._engine.reg_read(getattr(self._arm, f"UC_ARM_REG_{name}"))

    def set(self, name: str, value: int) -> None:
        """Set a register."""
        self._engine.reg_write(getattr(self._arm, f"UC_ARM_REG_{name}"), value)

    def reset(self) -> None:
        """Load stack and program counter from the vectors."""
        stack, start = self.words(FLASH, 2)
        for name, value in (
            ("IPSR", 0),
            ("PRIMASK", 0),
            ("BASEPRI", 0),
            ("FAULTMASK", 0),
            ("CONTROL", 0),
            ("SP", stack),
            ("PC", start | 1),
        ):
            self.set(name, value)

    def enter(self, number: int) -> None:
        """Stack the registers of an exception and enter its handler (ARMv7-M, B1.5.6); the floating-point registers if in use."""
        frame, sp = [self._engine.reg_read(register) for register in self._frame], self.get("SP")
        control, in_handler = self.get("CONTROL"), frame[7] & 0x1FF
        floating = bool(control & FPCA)
        data = struct.pack("<8I", *(value & 0xFFFFFFFF for value in frame))
        if floating:
            data += struct.pack("<18I", *(self.get(f"S{n}") for n in range(16)), self.get("FPSCR"), 0)
        padded = sp & 4
        if padded:
            data = data[:28] + struct.pack("<I", frame[7] | 1 << 9) + data[32:]
        sp -= len(data) + padded
        self.set_memory(sp, data)
        (handler,) = self.words(FLASH + 4 * number, 1)
        self.set("SP", sp)
        self.set("IPSR", number)
        self.set("CONTROL", control & ~FPCA)
        self.set("LR", (0xFFFFFFF1 if in_handler else 0xFFFFFFF9) & ~(0x10 if floating else 0))
        self.set("PC", handler | 1)

    def leave(self) -> None:
        """Restore what ``enter`` has stacked: the program counter holds the special value (B1.5.8)."""
        sp, floating = self.get("SP"), not self.get("PC") & 0x10
        frame = self.words(sp, 8)
        if floating:
            more = self.words(sp + 32, 17)
            for n in range(16):
                self.set(f"S{n}", more[n])
            self.set("FPSCR", more[16])
        sp += (104 if floating else 32) + (4 if frame[7] & 1 << 9 else 0)
        self.set("XPSR", frame[7] & ~(1 << 9))
        self.set("IPSR", frame[7] & 0x1FF)
        for register, value in zip(self._frame[:6], frame, strict=False):
            self._engine.reg_write(register, value)
        self.set("SP", sp)
        control = self.get("CONTROL")
        self.set("CONTROL", control | FPCA if floating else control & ~FPCA)
        self.set("PC", frame[6] | 1)
