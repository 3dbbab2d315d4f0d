"""The processor core and its memory; only this file uses Unicorn."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

from session.io.files import MB, read_bytes

# Unicorn counts the instructions that it runs, but has no function that returns the count.  It is read from the engine's memory.
#
# ``emu_start(count=…)`` keeps two adjacent numbers in its ``uc_struct``: the instructions begun, and the limit.  Two short runs of
# no-operations with different counts locate them.  The first is the clock of the emulation; writing the second ends a run early, after any
# instruction, at no cost.  Where the numbers cannot be located there is no emulator, instead of a wrong clock.

WORDS = 500  #: of the engine's struct that are searched; it is much longer
RUNS = (1237, 389)


class Counter:
    """begun, given: instructions of the present or the last run of an engine, stored at ``place`` of its ``words``."""

    def __init__(self, engine: Any, place: int):
        self.words = (ctypes.c_size_t * (place + 2)).from_address(engine._uch.value)
        self.place = place

    @property
    def begun(self) -> int:
        """Instructions begun, including the current one."""
        return self.words[self.place]

    @property
    def given(self) -> int:
        """Instructions after which the run stops."""
        return self.words[self.place + 1]

    @given.setter
    def given(self, instructions: int) -> None:
        self.words[self.place + 1] = instructions


def find(engine: Any, address: int) -> int:
    """Locate the count in an engine that can run ``max(RUNS)`` no-operations from an address on.

    Raises RuntimeError where there is none, or more than one.
    """
    candidates = set(range(WORDS - 1))
    for count in RUNS:
        engine.emu_start(address | 1, 0, count=count)
        words = (ctypes.c_size_t * WORDS).from_address(engine._uch.value)
        candidates = {place for place in candidates if words[place] == count + 1 and words[place + 1] == count}
    if len(candidates) != 1:
        raise RuntimeError("this version of Unicorn keeps its count elsewhere: expected that of constraints.txt")
    return candidates.pop()


# Contents of an ELF file for the board's memory.

#: file size with debug information; the largest such controller has 2 MB of memory
MOST_PROGRAM = 64 * MB
LOAD, ARM = 1, 40


def segments(path: Path) -> list[tuple[int, bytes]]:
    """Return (load address, bytes) of each loadable part.  Raises ValueError for other than 32-bit little-endian ELF files for ARM,
    FormatError where the file cannot be read."""
    data = read_bytes(path, MOST_PROGRAM)
    if data[:6] != b"\x7fELF\x01\x01" or len(data) < 52 or struct.unpack_from("<H", data, 18)[0] != ARM:
        raise ValueError(f"{path}: is no program for ARM; expected the ELF file that the firmware's make writes")
    (table,), (size, count) = struct.unpack_from("<I", data, 28), struct.unpack_from("<HH", data, 42)
    found = []
    for number in range(count):
        kind, offset, _, address, length = struct.unpack_from("<5I", data, table + number * size)
        if kind == LOAD and length:
            if offset + length > len(data):
                raise ValueError(f"{path}: is cut off")
            found.append((address, data[offset : offset + length]))
    return found


# The processor core and its memory.

FLASH, RAM, CCM, SYSTEM = 0x08000000, 0x20000000, 0x10000000, 0x1FFF0000
#: address -> bytes, as in the linker's script; SYSTEM: the system memory with the unique id
MEMORIES = {FLASH: 1024 * 1024, RAM: 128 * 1024, CCM: 64 * 1024, SYSTEM: 32 * 1024}
UNIQUE_ID = 0x1FFF7A10
PERIPHERALS, CORE = 0x40000000, 0xE0000000
#: address -> bytes of the ranges that ``Bus`` serves
WINDOWS = {PERIPHERALS: 0x80000, CORE: 0x100000}

NOP = b"\x00\xbf"
EXCEPTION_RETURN, SUPERVISOR_CALL = 8, 2
RAN, WAITS, RETURNS, CALLS = "ran", "waits", "returns", "calls"
FPCA = 1 << 2

Read = Callable[[int, int], int]  # address, bytes -> value
Write = Callable[[int, int, int], None]  # address, bytes, value


class ProgramError(RuntimeError):
    """Raised where a processor would fault; the message has the reason and the place."""


def missing() -> str:
    """Return what to install, or an empty string."""
    try:
        import unicorn  # noqa: F401
    except ImportError:
        return "not installed: unicorn (pip install unicorn)"
    return ""


class Cpu:
    """A Cortex-M4F with the STM32F405's memories; all other addresses go through two functions.

    instructions: run so far; running: whether a run is in progress.  Raises ProgramError where Unicorn is not installed.
    """

    def __init__(self, read: Read, write: Write):
        if missing():
            raise ProgramError(missing())
        import unicorn
        from unicorn import arm_const as arm

        self._arm, self._unicorn = arm, unicorn
        self._engine: Any = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
        self._engine.ctl_set_cpu_model(arm.UC_CPU_ARM_CORTEX_M4)
        for address, size in MEMORIES.items():
            self._engine.mem_map(address, size)
        for address, size in WINDOWS.items():
            self._engine.mmio_map(address, size, self._reader(address, read), None, self._writer(address, write), None)
        self._trouble: BaseException | None = None  # an exception within an access
        self._engine.mem_write(SYSTEM, NOP * 2000)  # outside the program, because code that has run is not translated again
        self._counter = Counter(self._engine, find(self._engine, SYSTEM))
        self._engine.mem_write(SYSTEM, bytes(4000))
        self._words, self._place = self._counter.words, self._counter.place  # copied here because every access uses them
        self._engine.hook_add(unicorn.UC_HOOK_INTR, self._interrupted)
        self._interrupt: int | None = None
        self.running = False
        self.instructions = 0
        self._frame = [getattr(arm, f"UC_ARM_REG_{name}") for name in ("R0", "R1", "R2", "R3", "R12", "LR", "PC", "XPSR")]

    def _interrupted(self, engine: Any, number: int, data: Any) -> None:
        self._interrupt = number
        engine.emu_stop()

    def _reader(self, window: int, read: Read) -> Callable[[Any, int, int, Any], int]:
        def answer(engine: Any, offset: int, size: int, data: Any) -> int:
            try:
                return read(window + offset, size)
            except BaseException as trouble:  # Unicorn would print it, and go on
                self._trouble = trouble
                engine.emu_stop()
                return 0

        return answer

    def _writer(self, window: int, write: Write) -> Callable[[Any, int, int, int, Any], None]:
        def take(engine: Any, offset: int, size: int, value: int, data: Any) -> None:
            try:
                write(window + offset, size, value)
            except BaseException as trouble:
                self._trouble = trouble
                engine.emu_stop()

        return take

    # Memory

    def memory(self, address: int, count: int) -> bytes:
        """Read bytes.  Raises ProgramError where there is no memory."""
        try:
            return bytes(self._engine.mem_read(address, count))
        except self._unicorn.UcError:
            raise ProgramError(f"no memory at 0x{address:08x}") from None

    def set_memory(self, address: int, data: bytes) -> None:
        """Write bytes.  Raises ProgramError where there is no memory."""
        try:
            self._engine.mem_write(address, data)
        except self._unicorn.UcError:
            raise ProgramError(f"no memory at 0x{address:08x}") from None

    def words(self, address: int, count: int) -> tuple[int, ...]:
        """Read words of 32 bits."""
        return struct.unpack(f"<{count}I", self.memory(address, 4 * count))

    # Running

    def watch(self, address: int, call: Callable[[], None]) -> None:
        """Call a function each time that the instruction at an address is about to run."""
        self._engine.hook_add(self._unicorn.UC_HOOK_CODE, lambda *_: call(), begin=address, end=address)

    def executed(self) -> int:
        """Return the instructions of the present run, without the current one; 0 between runs."""
        return self._words[self._place] - 1 if self.running else 0

    def limit(self, instructions: int) -> None:
        """End the present run so many instructions after the current one."""
        self._counter.given = self._counter.begun + max(0, instructions)

    def run(self, instructions: int) -> tuple[str, int]:
        """Run at most so many; return why the run ended (RAN, WAITS, RETURNS, CALLS) and the number of instructions.

        Raises ProgramError for what a processor would take as a fault.
        """
        self._interrupt, self.running = None, True
        try:
            self._engine.emu_start(self.pc | 1, 0, count=instructions)
        except self._unicorn.UcError as error:
            raise ProgramError(f"{error} at 0x{self.pc:08x}, called from 0x{self.lr:08x}") from None
        finally:
            self.running = False
        begun, given = self._counter.begun, self._counter.given
        if self._trouble:
            trouble, self._trouble = self._trouble, None
            raise trouble
        if self._interrupt is not None:
            why = {EXCEPTION_RETURN: RETURNS, SUPERVISOR_CALL: CALLS}.get(self._interrupt)
            if why is None:
                raise ProgramError(f"exception {self._interrupt} of the emulator (undefined or a breakpoint) at 0x{self.pc:08x}")
            executed = begun
        elif begun > given:  # the last one was begun, and stopped
            why, executed = RAN, begun - 1
        else:
            why, executed = WAITS, begun
        self.instructions += executed
        return why, executed

    # Registers

    def get(self, name: str) -> int:
        """Return a register, by Unicorn's name for it."""
        return self._engine.reg_read(getattr(self._arm, f"UC_ARM_REG_{name}"))

    def set(self, name: str, value: int) -> None:
        """Set a register, by Unicorn's name for it."""
        self._engine.reg_write(getattr(self._arm, f"UC_ARM_REG_{name}"), value)

    @property
    def pc(self) -> int:
        """Program counter."""
        return self._engine.reg_read(self._frame[6])

    @property
    def lr(self) -> int:
        """Link register."""
        return self._engine.reg_read(self._frame[5])

    def reset(self, vectors: int) -> None:
        """Load stack and program counter from the vectors, as after a reset."""
        stack, start = self.words(vectors, 2)
        for name in ("IPSR", "PRIMASK", "BASEPRI", "FAULTMASK"):
            self.set(name, 0)
        self.set("CONTROL", 0)
        self.set("SP", stack)
        self.set("PC", start | 1)

    def enter(self, number: int, vectors: int) -> None:
        """Stack the registers of an exception and enter its handler (ARMv7-M, B1.5.6); the floating-point registers if in use."""
        engine = self._engine
        frame, sp = [engine.reg_read(register) for register in self._frame], self.get("SP")
        control, in_handler = self.get("CONTROL"), frame[7] & 0x1FF
        if control & 2:
            raise ProgramError("the process stack is not emulated")
        floating = bool(control & FPCA)
        data = struct.pack("<8I", *(value & 0xFFFFFFFF for value in frame))
        if floating:
            data += struct.pack("<18I", *(self.get(f"S{n}") for n in range(16)), self.get("FPSCR"), 0)
        padded = sp & 4
        if padded:
            data = data[:28] + struct.pack("<I", frame[7] | 1 << 9) + data[32:]
        sp -= len(data) + padded
        self.set_memory(sp, data)
        (handler,) = self.words(vectors + 4 * number, 1)
        self.set("SP", sp)
        self.set("IPSR", number)
        if floating:
            self.set("CONTROL", control & ~FPCA)
        self.set("LR", (0xFFFFFFF1 if in_handler else 0xFFFFFFF9) & ~(0x10 if floating else 0))
        self.set("PC", handler | 1)

    def leave(self) -> None:
        """Restore what ``enter`` has stacked: the program counter holds the special value (B1.5.8)."""
        sp, floating = self.get("SP"), not self.pc & 0x10
        frame = list(self.words(sp, 8))
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
