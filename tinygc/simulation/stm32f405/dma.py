"""DMA2: streams that feed and empty a peripheral's data register.  Transfers are made in bulk by the peripheral that asks for them."""

from __future__ import annotations

from collections.abc import Callable

from tinygc.simulation.stm32f405.clock import NEVER, Clock, Poll
from tinygc.simulation.stm32f405.cpu import CCM, MEMORIES, Cpu, ProgramError
from tinygc.simulation.stm32f405.nvic import Nvic

IRQS = (56, 57, 58, 59, 60, 68, 69, 70)
FLAG_BITS = (0, 6, 16, 22)
ERROR, HALF, COMPLETE = 1 << 3, 1 << 4, 1 << 5
EN, TEIE, HTIE, TCIE, CIRC, MINC = 1 << 0, 1 << 2, 1 << 3, 1 << 4, 1 << 8, 1 << 10
TO_MEMORY, TO_PERIPHERAL = 0, 1


class Stream:
    """number; ndtr: items that are left; flags: as in LISR, from bit 0."""

    def __init__(self, number: int, cpu: Cpu, nvic: Nvic, object_to: Callable[[str], None]):
        self.number, self._cpu, self._nvic, self._object = number, cpu, nvic, object_to
        self.cr = self.ndtr = self.peripheral = self.memory = self.fcr = self.flags = 0
        self.place = 0  # bytes that have been moved

    @property
    def on(self) -> bool:
        """Whether it serves requests."""
        return bool(self.cr & EN) and self.ndtr > 0

    @property
    def direction(self) -> int:
        """TO_MEMORY or TO_PERIPHERAL."""
        return self.cr >> 6 & 3

    @property
    def channel(self) -> int:
        """Of the eight."""
        return self.cr >> 25 & 7

    def enable(self) -> bool:
        """Whether it could be; it was just written with EN."""
        self.place = 0
        if self.cr >> 11 & 15 or self.cr & CIRC or self.direction > 1:
            self._object(f"DMA2 stream {self.number}: only bytes, once, to or from a peripheral are emulated")
        if self.flags:
            self._object(f"DMA2 stream {self.number} is enabled while its flags of the last transfer stand")
        if not any(start <= self.memory < start + size for start, size in MEMORIES.items() if start != CCM):
            self._object(f"DMA2 stream {self.number} cannot reach 0x{self.memory:08x}")
            self.cr &= ~EN
            self.raise_flags(ERROR)
            return False
        return True

    def fetch(self, count: int) -> bytes:
        """The next bytes of the memory; nothing is counted."""
        if not self.cr & MINC:
            return self._cpu.memory(self.memory, 1) * count
        return self._cpu.memory(self.memory + self.place, count)

    def store(self, data: bytes) -> None:
        """The next bytes to the memory."""
        if data:
            where, what = (self.memory + self.place, data) if self.cr & MINC else (self.memory, data[-1:])
            try:
                self._cpu.set_memory(where, what)
            except ProgramError:
                self._object(f"DMA2 stream {self.number} runs out of the memory")
            self.count(len(data))

    def count(self, items: int) -> None:
        """So many have been moved: with the last of them the stream ends."""
        if not items:
            return
        self.place += items
        self.ndtr = max(0, self.ndtr - items)
        if not self.ndtr:
            self.cr &= ~EN
            self.raise_flags(HALF | COMPLETE)

    def raise_flags(self, flags: int) -> None:
        """As in LISR, from bit 0."""
        self.flags |= flags
        self.set_line()

    def set_line(self) -> None:
        """Of the interrupt."""
        asked = (bit for bit, flag in ((TCIE, COMPLETE), (HTIE, HALF), (TEIE, ERROR)) if self.flags & flag)
        self._nvic.line(IRQS[self.number], any(self.cr & bit for bit in asked))


class Dma:
    """started: peripheral's address -> told that one of its streams has been enabled; settle: told before its registers are read;
    ends: says when the transfer at hand does, or never."""

    def __init__(self, clock: Clock, cpu: Cpu, nvic: Nvic, object_to: Callable[[str], None]):
        self._clock = clock
        self.streams = [Stream(number, cpu, nvic, object_to) for number in range(8)]
        self.started: dict[int, Callable[[], None]] = {}
        self.settle: dict[int, Callable[[], None]] = {}
        self.ends: dict[int, Callable[[], float]] = {}
        self._poll = Poll(clock, 3)

    def serving(self, peripheral: int, direction: int, wired: tuple[tuple[int, int], ...]) -> Stream | None:
        """The stream that serves a data register in a direction now; wired: (stream, channel) that the part has for it."""
        for number, channel in wired:
            stream = self.streams[number]
            if stream.on and stream.channel == channel and stream.direction == direction and stream.peripheral == peripheral:
                return stream
        return None

    def read(self, offset: int) -> int:
        """A word."""
        for settle in self.settle.values():
            settle()
        if offset in (0x00, 0x04):
            streams = self.streams[offset : offset + 4]
            value = sum(stream.flags << FLAG_BITS[n] for n, stream in enumerate(streams))
            if self._poll.again(value << 1 | offset >> 2):
                self._clock.skip_to(self._next_end())
            return value
        if offset < 0x10:
            return 0
        stream, place = self.streams[(offset - 0x10) // 24], (offset - 0x10) % 24
        value = (stream.cr, stream.ndtr, stream.peripheral, stream.memory, 0, stream.fcr)[place // 4]
        if place == 0 and self._poll.again(value) and stream.on:
            self._clock.skip_to(self._next_end())
        return value

    def _next_end(self) -> float:
        return min((end() for end in self.ends.values()), default=NEVER)

    def write(self, offset: int, value: int) -> None:
        """A word."""
        self._poll.broken()
        for settle in self.settle.values():
            settle()
        if offset in (0x08, 0x0C):
            for n, stream in enumerate(self.streams[offset - 8 : offset - 4]):
                stream.flags &= ~(value >> FLAG_BITS[n])
                stream.set_line()
        elif offset >= 0x10:
            self._set(self.streams[(offset - 0x10) // 24], (offset - 0x10) % 24, value)

    def _set(self, stream: Stream, place: int, value: int) -> None:
        if place == 0:
            enabled = value & EN and not stream.cr & EN
            disabled = stream.cr & EN and not value & EN
            stream.cr = value
            stream.set_line()
            if disabled:
                stream.raise_flags(COMPLETE)  # RM0090, 10.3.15: a stream that is switched off says so
            if (enabled and stream.enable()) or disabled:
                for started in self.started.values():
                    started()
        elif place == 4:
            stream.ndtr = value & 0xFFFF
        elif place == 8:
            stream.peripheral = value
        elif place == 12:
            stream.memory = value
        elif place == 20:
            stream.fcr = value
