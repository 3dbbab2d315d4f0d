"""SPI1 as a master of bytes, by the core or by DMA2."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Protocol

from tinygc.annexes.emulated.bus import CORE_HZ, NEVER, Bus, CycleClock, Poll, TimedCall
from tinygc.annexes.emulated.core import Gpio, Nvic
from tinygc.annexes.emulated.cpu import CCM, MEMORIES, Cpu, ProgramError

# DMA2: streams between memory and a peripheral's data register.  The requesting peripheral makes its transfers in bulk.

IRQS = (56, 57, 58, 59, 60, 68, 69, 70)
FLAG_BITS = (0, 6, 16, 22)
ERROR, HALF, COMPLETE = 1 << 3, 1 << 4, 1 << 5
EN, TEIE, HTIE, TCIE, CIRC, MINC = 1 << 0, 1 << 2, 1 << 3, 1 << 4, 1 << 8, 1 << 10
TO_MEMORY, TO_PERIPHERAL = 0, 1


class DmaStream:
    """number; ndtr: remaining items; flags: as in LISR, from bit 0."""

    def __init__(self, number: int, cpu: Cpu, nvic: Nvic, object_to: Callable[[str], None]):
        self.number, self._cpu, self._nvic, self._object = number, cpu, nvic, object_to
        self.cr = self.ndtr = self.peripheral = self.memory = self.fcr = self.flags = 0
        self.place = 0  # bytes moved so far

    @property
    def on(self) -> bool:
        """Whether the stream serves requests."""
        return bool(self.cr & EN) and self.ndtr > 0

    @property
    def direction(self) -> int:
        """Direction: TO_MEMORY or TO_PERIPHERAL."""
        return self.cr >> 6 & 3

    @property
    def channel(self) -> int:
        """Channel, one of eight."""
        return self.cr >> 25 & 7

    def enable(self) -> bool:
        """Whether the stream can be enabled, just after a write of EN."""
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
        """Return the next bytes of the memory, without counting them."""
        if not self.cr & MINC:
            return self._cpu.memory(self.memory, 1) * count
        return self._cpu.memory(self.memory + self.place, count)

    def store(self, data: bytes) -> None:
        """Write the next bytes to the memory."""
        if data:
            where, what = (self.memory + self.place, data) if self.cr & MINC else (self.memory, data[-1:])
            try:
                self._cpu.set_memory(where, what)
            except ProgramError:
                self._object(f"DMA2 stream {self.number} runs out of the memory")
            self.count(len(data))

    def count(self, items: int) -> None:
        """Count items as moved; the last of them ends the stream."""
        if not items:
            return
        self.place += items
        self.ndtr = max(0, self.ndtr - items)
        if not self.ndtr:
            self.cr &= ~EN
            self.raise_flags(HALF | COMPLETE)

    def raise_flags(self, flags: int) -> None:
        """Set flags, as in LISR, from bit 0."""
        self.flags |= flags
        self.set_line()

    def set_line(self) -> None:
        """Update the interrupt line."""
        asked = (bit for bit, flag in ((TCIE, COMPLETE), (HTIE, HALF), (TEIE, ERROR)) if self.flags & flag)
        self._nvic.line(IRQS[self.number], any(self.cr & bit for bit in asked))


class Dma:
    """started: peripheral's address -> function called when one of its streams is enabled; settle: function called before its registers are
    read; ends: function that returns when its current transfer ends, or never."""

    def __init__(self, clock: CycleClock, cpu: Cpu, nvic: Nvic, object_to: Callable[[str], None]):
        self._clock = clock
        self.streams = [DmaStream(number, cpu, nvic, object_to) for number in range(8)]
        self.started: dict[int, Callable[[], None]] = {}
        self.settle: dict[int, Callable[[], None]] = {}
        self.ends: dict[int, Callable[[], float]] = {}
        self._poll = Poll(clock, 3)

    def serving(self, peripheral: int, direction: int, wired: tuple[tuple[int, int], ...]) -> DmaStream | None:
        """Return the stream that now serves a data register in a direction; wired: (stream, channel) that the part has for it."""
        for number, channel in wired:
            stream = self.streams[number]
            if stream.on and stream.channel == channel and stream.direction == direction and stream.peripheral == peripheral:
                return stream
        return None

    def read(self, offset: int) -> int:
        """Read a word."""
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
        """Write a word."""
        self._poll.broken()
        for settle in self.settle.values():
            settle()
        if offset in (0x08, 0x0C):
            for n, stream in enumerate(self.streams[offset - 8 : offset - 4]):
                stream.flags &= ~(value >> FLAG_BITS[n])
                stream.set_line()
        elif offset >= 0x10:
            self._set(self.streams[(offset - 0x10) // 24], (offset - 0x10) % 24, value)

    def _set(self, stream: DmaStream, place: int, value: int) -> None:
        if place == 0:
            enabled = value & EN and not stream.cr & EN
            disabled = stream.cr & EN and not value & EN
            stream.cr = value
            stream.set_line()
            if disabled:
                stream.raise_flags(COMPLETE)  # RM0090, 10.3.15: a stream that is switched off sets this flag
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


# SPI1 as a master of bytes: by the core or by DMA.

ADDRESS, IRQ = 0x40013000, 35
RX_STREAMS, TX_STREAMS = ((0, 3), (2, 3)), ((3, 3), (5, 3))
PINS, FUNCTION = (5, 6, 7), 5
MOST_HZ = 10_000_000  #: of the sensor
RXNE, TXE, OVR, BSY = 1 << 0, 1 << 1, 1 << 6, 1 << 7
RXDMAEN, TXDMAEN, RXNEIE, TXEIE = 1 << 0, 1 << 1, 1 << 6, 1 << 7
MSTR, SPE, SSI, SSM, DFF = 1 << 2, 1 << 6, 1 << 8, 1 << 9, 1 << 11


class SpiDevice(Protocol):
    """A device on the bus."""

    def transfer(self, out: bytes, t_s: float, byte_s: float) -> bytes:
        """Send bytes from a time on, each with a duration, and return the bytes received."""


class Spi:
    """bytes: number of bytes exchanged."""

    def __init__(self, clock: CycleClock, bus: Bus, nvic: Nvic, dma: Dma, pins: Gpio, device: SpiDevice):
        self._clock, self._bus, self._nvic, self._dma, self._pins, self._device = clock, bus, nvic, dma, pins, device
        self._cr1 = self._cr2 = 0
        self._received: deque[tuple[float, int]] = deque()  # (cycle of its last bit, byte)
        self._last, self._free_at, self._taken_at, self._overrun = 0, 0.0, 0.0, False
        self._poll = Poll(clock)
        self._transfer: Transfer | None = None
        self.bytes = 0
        dma.started[ADDRESS] = self._serve
        dma.settle[ADDRESS] = self.settle
        dma.ends[ADDRESS] = lambda: self._transfer.end if self._transfer else NEVER

    @property
    def _byte_cycles(self) -> int:
        return 8 * (2 << (self._cr1 >> 3 & 7)) * self._bus.rcc.divider(2)

    def _exchange(self, out: bytes, cycle: float) -> bytes:
        """Exchange bytes from a cycle on."""
        if CORE_HZ * 8 / self._byte_cycles > MOST_HZ:
            self._bus.object(f"SPI1 runs at {CORE_HZ * 8 / self._byte_cycles / 1e6:g} MHz; the sensor takes {MOST_HZ / 1e6:g}")
        if self._cr1 & 3 not in (0, 3) or self._cr1 & (DFF | SPE << 1):
            self._bus.object("SPI1 is not in mode 0 or 3, 8 bits, highest bit first")
            return bytes([0xFF]) * len(out)
        if any(self._pins.alternate(pin) != FUNCTION for pin in PINS):
            self._bus.object("PA5, PA6, PA7 are not SPI1's (alternate function 5)")
            return bytes([0xFF]) * len(out)
        self.bytes += len(out)
        return self._device.transfer(out, cycle / CORE_HZ, self._byte_cycles / CORE_HZ)

    @property
    def busy(self) -> bool:
        """Whether a byte is being transferred."""
        return self._clock.now() < self._free_at or self._transfer is not None

    # Registers

    def settle(self) -> None:
        """Update the state to the present time."""
        now = self._clock.now()
        if self._transfer:
            self._transfer.settle(now)
        while len(self._received) > 1 and self._received[1][0] <= now:
            del self._received[1]  # a byte that was not fetched stays, and the next one is lost
            self._overrun = True

    def _status(self, now: float) -> int:
        received = self._received and self._received[0][0] <= now
        busy = now < self._free_at or self._transfer is not None
        return (RXNE if received else 0) | (TXE if now >= self._taken_at else 0) | (OVR if self._overrun else 0) | (BSY if busy else 0)

    def read(self, offset: int) -> int:
        """Read a word."""
        self.settle()
        now = self._clock.now()
        if offset == 0x08:
            status = self._status(now)
            if self._poll.again(status):
                self._clock.skip_to(self._next_change(now))
            return status
        self._poll.broken()
        if offset == 0x0C:
            if self._received and self._received[0][0] <= now:
                self._last = self._received.popleft()[1]
            self._overrun = False
            self._set_line()
            return self._last
        return {0x00: self._cr1, 0x04: self._cr2, 0x10: 7}.get(offset, 0)

    def _next_change(self, now: float) -> float:
        if self._transfer:
            return self._transfer.end
        times = (self._taken_at, self._free_at, self._received[0][0] if self._received else 0.0)
        return min((cycle for cycle in times if cycle > now), default=NEVER)

    def write(self, offset: int, value: int) -> None:
        """Write a word."""
        self._poll.broken()
        self.settle()
        if offset == 0x00:
            self._cr1 = value
            if value & SPE and not (value & MSTR and value & SSM and value & SSI):
                self._bus.object("SPI1 is enabled, but no master with software chip select (MSTR, SSM, SSI)")
            self._serve()
        elif offset == 0x04:
            self._cr2 = value
            self._serve()
            self._set_line()
        elif offset == 0x0C:
            self._send(value & 0xFF)

    def _send(self, byte: int) -> None:
        now = self._clock.now()
        if not self._cr1 & SPE or self._transfer:
            self._bus.object("SPI1's data register is written while it is off or served by DMA")
            return
        if now < self._taken_at:
            self._bus.object("SPI1's data register is written before it was empty")
            return
        start = max(now, self._free_at)
        self._taken_at, self._free_at = start, start + self._byte_cycles
        self._received.append((self._free_at, self._exchange(bytes((byte,)), start)[0]))
        if self._cr2 & (RXNEIE | TXEIE | RXDMAEN):
            self._clock.at(self._free_at, self._after_byte)

    def _after_byte(self) -> None:
        self.settle()
        stream = self._dma.serving(ADDRESS + 0x0C, TO_MEMORY, RX_STREAMS) if self._cr2 & RXDMAEN else None
        if stream and self._received:
            stream.store(bytes((self._received.popleft()[1],)))
        self._set_line()

    def _set_line(self) -> None:
        status = self._status(self._clock.now())
        self._nvic.line(IRQ, bool((self._cr2 & RXNEIE and status & RXNE) or (self._cr2 & TXEIE and status & TXE)))

    # DMA

    def _serve(self) -> None:
        """Begin a transfer that DMA requests, or end one that it no longer serves."""
        transfer = self._transfer
        if transfer and not (transfer.serves() and self._cr2 & TXDMAEN and self._cr1 & SPE):
            transfer.cancel()
            self._transfer = None
        if self._transfer or not self._cr1 & SPE or not self._cr2 & TXDMAEN:
            return
        out = self._dma.serving(ADDRESS + 0x0C, TO_PERIPHERAL, TX_STREAMS)
        if out is None:
            return
        into = self._dma.serving(ADDRESS + 0x0C, TO_MEMORY, RX_STREAMS) if self._cr2 & RXDMAEN else None
        self._transfer = Transfer(self, out, into, max(self._clock.now(), self._free_at), self._byte_cycles)

    def ended(self, cycle: float, last: int, lost: bool) -> None:
        """End a transfer with its last byte; lost: whether bytes were not fetched."""
        self._transfer, self._free_at, self._taken_at = None, cycle, cycle
        if lost:
            self._received.clear()
            self._received.append((cycle, last))
            self._overrun = True
        self._serve()


class Transfer:
    """A number of bytes by DMA, from a cycle on, without pauses between them."""

    def __init__(self, spi: Spi, out: DmaStream, into: DmaStream | None, start: float, byte_cycles: int):
        self._spi, self._out, self._into, self._start, self._byte_cycles = spi, out, into, start, byte_cycles
        self._count, self._done = out.ndtr, 0
        self._bytes = out.fetch(self._count)
        self._answers = b""
        self._events: list[TimedCall] = [
            spi._clock.at(start + (self._count - 1) * byte_cycles, spi.settle),
            spi._clock.at(self.end, self._end),
        ]

    @property
    def end(self) -> float:
        """Cycle of the last bit."""
        return self._start + self._count * self._byte_cycles

    def serves(self) -> bool:
        """Whether the transfer's streams are still on."""
        return self._out.on or self._done == self._count

    def settle(self, now: float) -> None:
        """Exchange bytes that have begun, store bytes that have arrived."""
        ended = self._count if now >= self.end else max(0, int((now - self._start) // self._byte_cycles))
        begun = min(self._count, ended + 1) if now >= self._start else 0
        if begun > self._done:
            first, self._done = self._done, begun
            self._answers += self._spi._exchange(self._bytes[first:begun], self._start + first * self._byte_cycles)
            self._out.count(begun - first)
        if self._into and self._into.on:
            data = self._answers[self._into.place : ended]
            self._into.store(data[: self._into.ndtr])

    def _end(self) -> None:
        end = self.end
        self.settle(end)
        stored = self._into.place if self._into else 0
        self._spi.ended(end, self._answers[-1], stored < self._count)

    def cancel(self) -> None:
        """Stop the transfer."""
        for event in self._events:
            event.cancel()
