"""DMA2, SPI1 as a master of bytes, and the serial ports: each takes the time of its bytes on the line."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from typing import Protocol

from emulator.bus import CORE_HZ, NEVER, Bus, CycleClock, TimedCall
from emulator.core import Gpio, Nvic
from emulator.cpu import CCM, MEMORIES, Cpu, ProgramError

# DMA2: streams between memory and a peripheral's data register.  The requesting peripheral makes its transfers in bulk.

IRQS = (56, 57, 58, 59, 60, 68, 69, 70)
FLAG_BITS = (0, 6, 16, 22)
ERROR, COMPLETE = 1 << 3, 1 << 4 | 1 << 5  #: complete: and half of it
EN, TCIE, MINC = 1 << 0, 1 << 4, 1 << 10
TO_MEMORY, TO_PERIPHERAL = 0, 1


class DmaStream:
    """ndtr: remaining items; flags: as in LISR, from bit 0."""

    def __init__(self, number: int, cpu: Cpu, nvic: Nvic, object_to: Callable[[str], None]):
        self.number, self._cpu, self._nvic, self._object = number, cpu, nvic, object_to
        self.cr = self.ndtr = self.peripheral = self.memory = self.flags = 0
        self.place = 0  # bytes moved so far

    def serves(self, peripheral: int, direction: int, channel: int) -> bool:
        """Whether it serves a data register's requests, in a direction."""
        wired = self.peripheral == peripheral and self.cr >> 6 & 3 == direction and self.cr >> 25 & 7 == channel
        return wired and bool(self.cr & EN) and self.ndtr > 0

    def enable(self) -> None:
        self.place = 0
        if self.flags:
            self._object(f"DMA2 stream {self.number} is enabled while its flags of the last transfer stand")
        if not any(start <= self.memory < start + size for start, size in MEMORIES.items() if start != CCM):
            self._object(f"DMA2 stream {self.number} cannot reach 0x{self.memory:08x}")
            self.cr &= ~EN
            self.flags |= ERROR

    def fetch(self, count: int) -> bytes:
        """The next bytes of the memory, without counting them."""
        if not self.cr & MINC:
            return self._cpu.memory(self.memory, 1) * count
        return self._cpu.memory(self.memory + self.place, count)

    def store(self, data: bytes) -> None:
        """Write the next bytes to the memory."""
        try:
            self._cpu.set_memory(self.memory + self.place, data)
        except ProgramError:
            self._object(f"DMA2 stream {self.number} runs out of the memory")
        self.count(len(data))

    def count(self, items: int) -> None:
        """Count items as moved; the last of them ends the stream."""
        self.place += items
        self.ndtr -= items
        if items and not self.ndtr:
            self.cr &= ~EN
            self.flags |= COMPLETE
            self.set_line()

    def set_line(self) -> None:
        self._nvic.line(IRQS[self.number], bool(self.cr & TCIE and self.flags & COMPLETE))


class Dma:
    """started: functions that are called when a stream is switched on or off."""

    def __init__(self, cpu: Cpu, nvic: Nvic, object_to: Callable[[str], None]):
        self.streams = [DmaStream(number, cpu, nvic, object_to) for number in range(8)]
        self.started: list[Callable[[], None]] = []

    def read(self, offset: int) -> int:
        if offset < 0x08:
            return sum(stream.flags << FLAG_BITS[n] for n, stream in enumerate(self.streams[offset : offset + 4]))
        stream, place = self.streams[(offset - 0x10) // 24], (offset - 0x10) % 24
        return (stream.cr, stream.ndtr, stream.peripheral, stream.memory, 0, 0)[place // 4]

    def write(self, offset: int, value: int) -> None:
        if offset in (0x08, 0x0C):
            for n, stream in enumerate(self.streams[offset - 8 : offset - 4]):
                stream.flags &= ~(value >> FLAG_BITS[n])
                stream.set_line()
        elif offset >= 0x10:
            self._set(self.streams[(offset - 0x10) // 24], (offset - 0x10) % 24, value)

    def _set(self, stream: DmaStream, place: int, value: int) -> None:
        if place == 0:
            changed = (stream.cr ^ value) & EN
            stream.cr = value
            if changed and value & EN:
                stream.enable()
            elif changed:
                stream.flags |= COMPLETE  # RM0090, 10.3.15: a stream that is switched off sets this flag
            stream.set_line()
            for started in self.started if changed else ():
                started()
        elif place in (4, 8, 12):
            setattr(stream, {4: "ndtr", 8: "peripheral", 12: "memory"}[place], value)


# SPI1 as a master of bytes: by the core, or by DMA in both directions.

SPI, PINS, FUNCTION = 0x40013000, (5, 6, 7), 5
MOST_HZ = 10_000_000  #: of the sensor
RXNE, TXE, BSY = 1 << 0, 1 << 1, 1 << 7
BY_DMA, MSTR, SPE, SSI, SSM, DFF = 3, 1 << 2, 1 << 6, 1 << 8, 1 << 9, 1 << 11
TURN = 60  #: cycles: a waiting loop for the status has shorter iterations, one with other work has longer ones


class SpiDevice(Protocol):
    """What is on the bus."""

    def transfer(self, out: bytes, t_s: float, byte_s: float) -> bytes:
        """Send bytes from a time on, each with a duration, and return the bytes received."""


class Spi:
    """A transfer by DMA is exchanged at its end, each byte at its own time."""

    def __init__(self, clock: CycleClock, bus: Bus, dma: Dma, pins: Gpio, device: SpiDevice):
        self._clock, self._bus, self._pins, self._device = clock, bus, pins, device
        self._into, self._out = dma.streams[0], dma.streams[3]
        self._cr1 = self._cr2 = 0
        self._received: deque[tuple[float, int]] = deque()  # (cycle of its last bit, byte)
        self._last, self._free_at, self._taken_at = 0, 0.0, 0.0
        self._seen, self._seen_at = -1, -NEVER  # the status that was read last
        self._end: TimedCall | None = None  # of the transfer by DMA
        dma.started.append(self._serve)

    @property
    def _byte_cycles(self) -> int:
        return 8 * (2 << (self._cr1 >> 3 & 7)) * self._bus.rcc.divider(2)

    def _exchange(self, out: bytes, cycle: float) -> bytes:
        if CORE_HZ * 8 / self._byte_cycles > MOST_HZ:
            self._bus.object(f"SPI1 runs at {CORE_HZ * 8 / self._byte_cycles / 1e6:g} MHz; the sensor takes {MOST_HZ / 1e6:g}")
        if self._cr1 & 3 not in (0, 3) or self._cr1 & (DFF | SPE << 1) or self._cr1 & (MSTR | SSM | SSI) != MSTR | SSM | SSI:
            self._bus.object("SPI1 is no master in mode 0 or 3, 8 bits, highest bit first, with its chip select by hand")
            return bytes([0xFF]) * len(out)
        if any(self._pins.alternate(pin) != FUNCTION for pin in PINS):
            self._bus.object("PA5, PA6, PA7 are not SPI1's (alternate function 5)")
            return bytes([0xFF]) * len(out)
        return self._device.transfer(out, cycle / CORE_HZ, self._byte_cycles / CORE_HZ)

    @property
    def busy(self) -> bool:
        """Whether a byte is being transferred."""
        return self._clock.now() < self._free_at

    def read(self, offset: int) -> int:
        now = self._clock.now()
        while len(self._received) > 1 and self._received[1][0] <= now:
            del self._received[1]  # a byte that was not fetched stays, and the next one is lost
        there = bool(self._received) and self._received[0][0] <= now
        if offset == 0x08:
            status = (RXNE if there else 0) | (TXE if now >= self._taken_at else 0) | (BSY if self.busy else 0)
            if status == self._seen and now - self._seen_at < TURN:
                times = (self._taken_at, self._free_at, self._received[0][0] if self._received else 0.0)
                self._clock.skip_to(min((cycle for cycle in times if cycle > now), default=NEVER))
            self._seen, self._seen_at = status, now
            return status
        self._seen = -1
        if offset == 0x0C and there:
            self._last = self._received.popleft()[1]
        return {0x00: self._cr1, 0x04: self._cr2, 0x0C: self._last}.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        self._seen = -1
        if offset == 0x00:
            self._cr1 = value
        elif offset == 0x04:
            self._cr2 = value
        elif offset == 0x0C:
            self._send(value & 0xFF)
        self._serve()

    def _send(self, byte: int) -> None:
        now = self._clock.now()
        if not self._cr1 & SPE or self._end or now < self._taken_at:
            self._bus.object("SPI1's data register is written while it is off, served by DMA or full")
            return
        start = max(now, self._free_at)
        self._taken_at, self._free_at = start, start + self._byte_cycles
        self._received.append((self._free_at, self._exchange(bytes((byte,)), start)[0]))

    def _serve(self) -> None:
        """Begin a transfer that DMA requests, or stop one that it no longer serves."""
        both = self._out.serves(SPI + 0x0C, TO_PERIPHERAL, 3) and self._into.serves(SPI + 0x0C, TO_MEMORY, 3)
        serves = both and self._cr2 & BY_DMA == BY_DMA and bool(self._cr1 & SPE)
        if self._end and not serves:
            self._end.do = None
            self._finish(max(0, math.ceil((self._clock.now() - self._began) / self._byte_cycles)))
        elif serves and not self._end:
            self._began = max(self._clock.now(), self._free_at)
            self._free_at = self._taken_at = self._began + self._out.ndtr * self._byte_cycles
            self._end = self._clock.at(self._free_at, lambda: self._finish(self._out.ndtr))

    def _finish(self, count: int) -> None:
        """End the transfer behind so many bytes."""
        self._end = None
        count = min(count, self._out.ndtr)
        self._free_at = self._taken_at = min(self._clock.now(), self._began + count * self._byte_cycles)
        answers = self._exchange(self._out.fetch(count), self._began)
        self._out.count(count)
        self._into.store(answers)


# USART1 and USART2: serial input and output, at the baud rate.

SR, DR, BRR, CR1, CR2, CR3 = range(0, 24, 4)
ORE, RX_FULL, TC, TX_EMPTY = 1 << 3, 1 << 5, 1 << 6, 1 << 7
RE, TE, RXNEIE, UE, DMAT = 1 << 2, 1 << 3, 1 << 5, 1 << 13, 1 << 7
LEAST_DIVIDER = 16  #: of the clock, at 16 samples a bit (RM0090: USARTDIV is at least 1)
BITS = 10  #: per byte: start, eight, stop


class Usart:
    """sent: bytes sent since they were last taken; lost: bytes that the program did not fetch in time.

    stream: of DMA2, channel 4, for sending; apb: index of the clock; pin: of port A that sends.
    """

    def __init__(self, address: int, irq: int, apb: int, pin: int, stream: DmaStream | None, clock: CycleClock, bus: Bus, nvic: Nvic,
                 dma: Dma, pins: Gpio):  # fmt: skip
        self._address, self._irq, self._apb, self._pin, self._stream = address, irq, apb, pin, stream
        self._clock, self._bus, self._nvic, self._pins = clock, bus, nvic, pins
        self._words = {BRR: 0, CR1: 0, CR2: 0, CR3: 0}
        self.sent, self.lost = bytearray(), 0
        self._free_at = self._taken_at = 0.0  # end of the last byte; when the data register is empty again
        self._coming: deque[int] = deque()  # bytes on their way to the board
        self._status, self._data = 0, 0
        self._completed = True  # TC, apart from a write of 0 to it
        self._flying: tuple[TimedCall, bytes] | None = None  # what DMA sends
        dma.started.append(self._serve)

    @property
    def baud(self) -> float:
        """As the registers set it; 0 before."""
        return CORE_HZ / self._bus.rcc.divider(self._apb) / self._words[BRR] if self._words[BRR] else 0.0

    @property
    def _byte_cycles(self) -> int:
        return BITS * self._words[BRR] * self._bus.rcc.divider(self._apb)

    def take(self) -> bytes:
        """The bytes sent since the last call."""
        data, self.sent = bytes(self.sent), bytearray()
        return data

    def feed(self, data: bytes) -> None:
        """Receive bytes from the other end, at the board's own speed; they are lost while the receiver is off."""
        if self._words[CR1] & (UE | RE) != UE | RE or not self._byte_cycles:
            self.lost += len(data)
            return
        if data and not self._coming:
            self._clock.at(self._clock.now() + self._byte_cycles, self._arrive)
        self._coming.extend(data)

    def _arrive(self) -> None:
        byte = self._coming.popleft()
        if self._status & RX_FULL:
            self._status |= ORE
            self.lost += 1
        else:
            self._status |= RX_FULL
            self._data = byte
        self._set_line()
        if self._coming:
            self._clock.at(self._clock.now() + self._byte_cycles, self._arrive)

    def read(self, offset: int) -> int:
        now = self._clock.now()
        if offset == SR:
            empty, complete = now >= self._taken_at, now >= self._free_at and self._completed
            return self._status | (0 if self._flying else TX_EMPTY * empty | TC * complete)
        if offset == DR:
            self._status &= ~(RX_FULL | ORE)
            self._set_line()
            return self._data
        return self._words.get(offset, 0)

    def write(self, offset: int, value: int) -> None:
        if offset == SR:
            self._completed = self._completed and bool(value & TC)
        elif offset == DR:
            self._send(value & 0xFF)
        elif offset in self._words:
            self._words[offset] = value
            self._serve()
        self._set_line()

    def _ready(self) -> bool:
        if self._words[CR1] & (UE | TE) != UE | TE or self._words[BRR] < LEAST_DIVIDER:
            self._bus.object(f"0x{self._address:08x} sends while it is off, or with a divider BRR below the {LEAST_DIVIDER} that it takes")
            return False
        self._bus.check_clock()
        if self._pins.alternate(self._pin) != 7:
            self._bus.object(f"PA{self._pin} is not the serial port's (alternate function 7)")
            return False
        return True

    def _send(self, byte: int) -> None:
        now = self._clock.now()
        if not self._ready():
            return
        if now < self._taken_at or self._flying:
            self._bus.object(f"0x{self._address:08x}: the data register is written before it was empty")
            return
        start = max(now, self._free_at)
        self._taken_at, self._free_at, self._completed = start, start + self._byte_cycles, True
        self.sent.append(byte)

    def cut_off(self) -> None:
        """A reset: keep what has been sent up to now of a transfer by DMA; what is on its way to the board is lost."""
        if self._flying:
            left = math.ceil(max(0.0, self._free_at - self._clock.now()) / self._byte_cycles)
            self.sent += self._flying[1][: max(0, len(self._flying[1]) - left)]
        self.lost += len(self._coming)

    def _set_line(self) -> None:
        self._nvic.line(self._irq, bool(self._words[CR1] & RXNEIE and self._status & (RX_FULL | ORE)))

    def _serve(self) -> None:
        """Begin what DMA wants to send, or object to an early end."""
        stream = self._stream
        serves = stream is not None and self._words[CR3] & DMAT and stream.serves(self._address + DR, TO_PERIPHERAL, 4)
        if self._flying and not serves:
            self._flying[0].do, self._flying = None, None
            self._bus.object(f"0x{self._address:08x}: DMA was stopped before its end")
        if stream is None or not serves or self._flying or not self._ready():
            return
        data, start = stream.fetch(stream.ndtr), max(self._clock.now(), self._free_at)
        self._free_at = start + len(data) * self._byte_cycles
        self._taken_at = self._free_at - self._byte_cycles
        self._flying = self._clock.at(self._taken_at, lambda: self._sent_all(stream, data)), data

    def _sent_all(self, stream: DmaStream, data: bytes) -> None:
        """Finish after the last byte was taken."""
        if stream.fetch(len(data)) != data:
            self._bus.object(f"0x{self._address:08x}: what DMA sends was changed before it was sent")
        self.sent += data
        self._flying, self._completed = None, True
        stream.count(len(data))
