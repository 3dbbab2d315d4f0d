"""USART1 and USART2: serial input and output, at the baud rate."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

from tinygc.annexes.emulated.bus import CORE_HZ, NEVER, Bus, CycleClock, Poll, TimedCall
from tinygc.annexes.emulated.core import Nvic
from tinygc.annexes.emulated.spi import TO_PERIPHERAL, Dma, DmaStream

SR, DR, BRR, CR1, CR2, CR3 = range(0, 24, 4)
ORE, RXNE, TC, TXE = 1 << 3, 1 << 5, 1 << 6, 1 << 7
RE, TE, RXNEIE, TCIE, TXEIE, UE = 1 << 2, 1 << 3, 1 << 5, 1 << 6, 1 << 7, 1 << 13
DMAT = 1 << 7
LEAST_DIVIDER = 16  #: of the clock, at 16 samples a bit (RM0090: USARTDIV is at least 1)
BITS = 10  #: per byte: start, eight, stop


class Usart:
    """sent: bytes sent since they were last taken; lost: bytes that the program did not fetch in time.

    wired: (stream, channel) of DMA2 for sending; apb: index of the clock; pins_right: whether the pins are configured for it.
    """

    def __init__(
        self,
        name: str,
        address: int,
        irq: int,
        apb: int,
        wired: tuple[tuple[int, int], ...],
        clock: CycleClock,
        bus: Bus,
        nvic: Nvic,
        dma: Dma,
        pins_right: Callable[[], bool],
    ):
        self._name, self._address, self._irq, self._apb, self._wired = name, address, irq, apb, wired
        self._clock, self._bus, self._nvic, self._dma, self._pins_right = clock, bus, nvic, dma, pins_right
        self._words = {BRR: 0, CR1: 0, CR2: 0, CR3: 0}
        self.sent, self.lost = bytearray(), 0
        self._free_at = self._taken_at = 0.0  # end of the last byte; when the data register is empty again
        self._coming: deque[int] = deque()  # bytes on their way to the board
        self._arrival: TimedCall | None = None
        self._status, self._data = 0, 0
        self._completed = True  # TC, apart from a write of 0 to it
        self._sending: DmaStream | None = None
        self._ends: TimedCall | None = None
        self._poll = Poll(clock)
        dma.started[address] = self._serve
        dma.ends[address] = lambda: self._taken_at if self._sending else NEVER

    @property
    def baud(self) -> float:
        """Baud rate as the registers set it; 0 before."""
        return CORE_HZ / self._bus.rcc.divider(self._apb) / self._words[BRR] if self._words[BRR] else 0.0

    @property
    def _byte_cycles(self) -> int:
        return BITS * self._words[BRR] * self._bus.rcc.divider(self._apb)

    def take(self) -> bytes:
        """Return the bytes sent since the last call."""
        data, self.sent = bytes(self.sent), bytearray()
        return data

    def feed(self, data: bytes) -> None:
        """Receive bytes from the other end, at the board's own speed; they are lost while the receiver is off."""
        if self._words[CR1] & (UE | RE) != UE | RE or not self._byte_cycles:
            self.lost += len(data)
            return
        self._coming.extend(data)
        if self._arrival is None and self._coming:
            self._arrival = self._clock.at(self._clock.now() + self._byte_cycles, self._arrive)

    def _arrive(self) -> None:
        byte = self._coming.popleft()
        if self._status & RXNE:
            self._status |= ORE
            self.lost += 1
        else:
            self._status |= RXNE
            self._data = byte
        self._set_line()
        self._arrival = self._clock.at(self._clock.now() + self._byte_cycles, self._arrive) if self._coming else None

    # Registers

    def _flags(self, now: float) -> int:
        status = self._status
        if self._sending is None:
            status |= TXE if now >= self._taken_at else 0
            status |= TC if now >= self._free_at and self._completed else 0
        return status

    def read(self, offset: int) -> int:
        """Read a word."""
        now = self._clock.now()
        if offset == SR:
            status = self._flags(now)
            if self._poll.again(status):
                self._clock.skip_to(self._next_change(now))
            return status
        self._poll.broken()
        if offset == DR:
            self._status &= ~(RXNE | ORE)
            self._set_line()
            return self._data
        return self._words.get(offset, 0)

    def _next_change(self, now: float) -> float:
        if self._sending:
            return self._taken_at
        return min((cycle for cycle in (self._taken_at, self._free_at) if cycle > now), default=now)

    def write(self, offset: int, value: int) -> None:
        """Write a word."""
        self._poll.broken()
        if offset == SR:
            self._completed = self._completed and bool(value & TC)
        elif offset == DR:
            self._send(value & 0xFF)
        elif offset in self._words:
            self._words[offset] = value
            self._serve()
        self._set_line()

    def _ready(self) -> bool:
        if self._words[CR1] & (UE | TE) != UE | TE or not self._words[BRR]:
            self._bus.object(f"{self._name} sends while it is off")
            return False
        if self._words[BRR] < LEAST_DIVIDER:
            self._bus.object(f"{self._name}'s divider BRR is {self._words[BRR]}, below the {LEAST_DIVIDER} that it takes")
            return False
        self._bus.check_clock()
        if not self._pins_right():
            self._bus.object(f"{self._name}'s pins are not its own (alternate function 7)")
            return False
        return True

    def _send(self, byte: int) -> None:
        now = self._clock.now()
        if not self._ready():
            return
        if now < self._taken_at or self._sending:
            self._bus.object(f"{self._name}'s data register is written before it was empty")
            return
        start = max(now, self._free_at)
        self._taken_at, self._free_at, self._completed = start, start + self._byte_cycles, True
        self.sent.append(byte)

    def cut_off(self) -> None:
        """A reset: keep what has been sent up to now of a transfer by DMA; what is on its way to the board is lost."""
        if self._sending:
            count = self._sending.ndtr - math.ceil(max(0.0, self._free_at - self._clock.now()) / self._byte_cycles)
            self.sent += self._sending.fetch(max(0, count))
        self.lost += len(self._coming)

    def _set_line(self) -> None:
        control, now = self._words[CR1], self._clock.now()
        status = self._flags(now)
        asked = (control & RXNEIE and status & (RXNE | ORE)) or (control & TXEIE and status & TXE) or (control & TCIE and status & TC)
        self._nvic.line(self._irq, bool(asked))
        for enabled, cycle in ((TXEIE, self._taken_at), (TCIE, self._free_at)):
            if control & enabled and cycle > now:
                self._clock.at(cycle, self._set_line)

    # DMA

    def _serve(self) -> None:
        stream = self._dma.serving(self._address + DR, TO_PERIPHERAL, self._wired) if self._words[CR3] & DMAT else None
        if self._sending and stream is not self._sending:
            if self._ends:
                self._ends.cancel()
            self._bus.object(f"{self._name}'s DMA was stopped before its end")
            self._sending = None
        if stream is None or self._sending or not self._ready():
            return
        data = stream.fetch(stream.ndtr)
        start = max(self._clock.now(), self._free_at)
        self._sending = stream
        self._ends = self._clock.at(start + (len(data) - 1) * self._byte_cycles, lambda: self._sent_all(stream, data))
        self._free_at = start + len(data) * self._byte_cycles
        self._taken_at = self._free_at - self._byte_cycles

    def _sent_all(self, stream: DmaStream, data: bytes) -> None:
        """Finish after the last byte was taken."""
        if stream.fetch(len(data)) != data:
            self._bus.object(f"{self._name}: what DMA sends was changed before it was sent")
        self.sent += data
        self._sending, self._completed = None, True
        stream.count(len(data))
        self._set_line()
        self._serve()
