"""The core and its memory: the one file that knows Unicorn."""

from __future__ import annotations

import ctypes
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

from session.io.files import MB, read_bytes

# Unicorn counts the instructions that it runs, but has no function that tells: where in its engine the count is.
#
# ``emu_start(count=…)`` keeps two numbers side by side in its ``uc_struct``: the instructions begun, and how many it was given.  Two short
# runs of no-operations with different counts show where.  The first is the clock of everything here; writing the second ends a run early,
# after any instruction, at no cost.  Where the place cannot be found there is no emulator, rather than a wrong clock.

WORDS = 500  #: of the engine's struct that are looked at; it is longer by far
RUNS = (1237, 389)


class Counter:
    """begun, given: instructions of the present or the last run of an engine; both stand at ``place`` of its ``words``."""

    def __init__(self, engine: Any, place: int):
        self.words = (ctypes.c_size_t * (place + 2)).from_address(engine._uch.value)
        self.place = place

    @property
    def begun(self) -> int:
        """Instructions, the one at hand among them."""
        return self.words[self.place]

    @property
    def given(self) -> int:
        """Instructions after which it stops."""
        return self.words[self.place + 1]

    @given.setter
    def given(self, instructions: int) -> None:
        self.words[self.place + 1] = instructions


def find(engine: Any, address: int) -> int:
    """The place of the count in an engine that can run ``max(RUNS)`` no-operations from an address on.

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


# What an ELF file brings to the board's memory.

#: with all that a debugger wants; the memory of the largest such controller has 2 MB
MOST_PROGRAM = 64 * MB
LOAD, ARM = 1, 40


def segments(path: Path) -> list[tuple[int, bytes]]:
    """(load address, bytes) of each loadable part.  Raises ValueError where it is no 32-bit little-endian ELF file for ARM; FormatError
    where it cannot be read."""
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


# The core and its memory: the one file that knows Unicorn.

FLASH, RAM, CCM, SYSTEM = 0x08000000, 0x20000000, 0x10000000, 0x1FFF0000
#: address -> bytes, as the linker's script has them; SYSTEM: the system memory with the unique id
MEMORIES = {FLASH: 1024 * 1024, RAM: 128 * 1024, CCM: 64 * 1024, SYSTEM: 32 * 1024}
UNIQUE_ID = 0x1FFF7A10
PERIPHERALS, CORE = 0x40000000, 0xE0000000
#: address -> bytes that ``Bus`` answers for
WINDOWS = {PERIPHERALS: 0x80000, CORE: 0x100000}

NOP = b"\x00\xbf"
EXCEPTION_RETURN, SUPERVISOR_CALL = 8, 2
RAN, WAITS, RETURNS, CALLS = "ran", "waits", "returns", "calls"
FPCA = 1 << 2

Read = Callable[[int, int], int]  # address, bytes -> value
Write = Callable[[int, int, int], None]  # address, bytes, value


class ProgramError(RuntimeError):
    """The program did what a processor faults at: says what, and where."""


def missing() -> str:
    """Empty, or what to install."""
    try:
        import unicorn  # noqa: F401
    except ImportError:
        return "not installed: unicorn (pip install unicorn)"
    return ""


class Cpu:
    """A Cortex-M4F with the STM32F405's memories; all else is read and written through two functions.

    instructions: run so far; running: whether it does so now.  Raises ProgramError where Unicorn is not installed.
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
        self._trouble: BaseException | None = None  # an interruption, or worse, amid an access
        self._engine.mem_write(SYSTEM, NOP * 2000)  # where no program runs: what has run once is not translated again
        self._counter = Counter(self._engine, find(self._engine, SYSTEM))
        self._engine.mem_write(SYSTEM, bytes(4000))
        self._words, self._place = self._counter.words, self._counter.place  # asked for at every access: without a detour
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
        """Bytes.  ProgramError where there is none."""
        try:
            return bytes(self._engine.mem_read(address, count))
        except self._unicorn.UcError:
            raise ProgramError(f"no memory at 0x{address:08x}") from None

    def set_memory(self, address: int, data: bytes) -> None:
        """Write bytes.  ProgramError where there is no memory."""
        try:
            self._engine.mem_write(address, data)
        except self._unicorn.UcError:
            raise ProgramError(f"no memory at 0x{address:08x}") from None

    def words(self, address: int, count: int) -> tuple[int, ...]:
        """Of 32 bits."""
        return struct.unpack(f"<{count}I", self.memory(address, 4 * count))

    # Running

    def executed(self) -> int:
        """Instructions of the present run, the one at hand not among them; 0 between runs."""
        return self._words[self._place] - 1 if self.running else 0

    def limit(self, instructions: int) -> None:
        """End the present run so many instructions after the one at hand."""
        self._counter.given = self._counter.begun + max(0, instructions)

    def run(self, instructions: int) -> tuple[str, int]:
        """At most so many: why it ended (RAN, WAITS, RETURNS, CALLS) and how many it were.

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
        """A register, by Unicorn's name for it."""
        return self._engine.reg_read(getattr(self._arm, f"UC_ARM_REG_{name}"))

    def set(self, name: str, value: int) -> None:
        """A register, by Unicorn's name for it."""
        self._engine.reg_write(getattr(self._arm, f"UC_ARM_REG_{name}"), value)

    @property
    def pc(self) -> int:
        """The program counter."""
        return self._engine.reg_read(self._frame[6])

    @property
    def lr(self) -> int:
        """The link register."""
        return self._engine.reg_read(self._frame[5])

    def reset(self, vectors: int) -> None:
        """Stack and program counter from the vectors, as after a reset."""
        stack, start = self.words(vectors, 2)
        for name in ("IPSR", "PRIMASK", "BASEPRI", "FAULTMASK"):
            self.set(name, 0)
        self.set("CONTROL", 0)
        self.set("SP", stack)
        self.set("PC", start | 1)

    def enter(self, number: int, vectors: int) -> None:
        """Stack what an exception stacks, and go to its handler (ARMv7-M, B1.5.6); the floating-point registers where they are in use."""
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
        """Take back what ``enter`` has stacked: the program counter holds the special value (B1.5.8)."""
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
