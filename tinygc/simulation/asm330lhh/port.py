"""The sensor's SPI port: chip select, then an address with its read bit, then data."""

from __future__ import annotations

from tinygc.simulation.asm330lhh.faults import PORT_KINDS
from tinygc.simulation.asm330lhh.registers import FIFO_DATA_OUT_LAST, FIFO_DATA_OUT_TAG, FIFO_STATUS2, OUT_FIRST, OUT_LAST
from tinygc.simulation.asm330lhh.sensor import Asm330lhh

READ = 0x80
WORD_BYTES = 7
#: what is read there can let the interrupt's pin fall
CLEARING = {FIFO_DATA_OUT_LAST, FIFO_STATUS2, *range(OUT_FIRST, OUT_LAST + 1)}
HIGH = 0xFF  #: what an undriven line reads


class Port:
    """transactions, bytes: what has passed; rises: how often INT1 was seen to rise, while it is ``watched``."""

    def __init__(self, sensor: Asm330lhh):
        self.sensor = sensor
        self._faults = [fault for fault in sensor.faults if fault.kind in PORT_KINDS]
        self._selected, self._address, self._reads = False, -1, False
        self.transactions = self.bytes = self.rises = 0
        self.watched = self._pin = False

    def select(self, selected: bool, t_s: float) -> None:
        """The chip select falls or rises."""
        self.sensor.advance(t_s)
        if selected and not self._selected:
            self.transactions += 1
            self._address = -1
        self._selected = selected

    def int1(self, t_s: float) -> bool:
        """The level of the interrupt's pin."""
        before, self._pin = self._pin, self.sensor.int1(t_s)
        self.rises += self._pin and not before
        return self._pin

    def int1_stays_until(self, t_s: float) -> float:
        """A time before which it cannot change, unless bytes pass."""
        return self.sensor.int1_stays_until(t_s)

    def transfer(self, out: bytes, t_s: float, byte_s: float) -> bytes:
        """Bytes to the sensor, the first of them at a time, each so long; what it answers meanwhile."""
        if not self._selected:
            return bytes([HIGH]) * len(out)
        self.bytes += len(out)
        answers, place = bytearray(), 0
        while place < len(out):
            if self._bursts and len(out) - place >= WORD_BYTES:
                answers += self.sensor.read_word(t_s + place * byte_s)
                place += WORD_BYTES
                if self.watched:
                    self.int1(t_s + (place - 1) * byte_s)
            else:
                answers.append(self._exchange(out[place], t_s + place * byte_s))
                place += 1
        return bytes(answers)

    @property
    def _bursts(self) -> bool:
        """Whether a whole word of the FIFO comes next, and nothing can come between its bytes."""
        return self._address == FIFO_DATA_OUT_TAG and self._reads and not self._faults and self.sensor.counts_up

    def _exchange(self, byte: int, t_s: float) -> int:
        fault = next((fault.kind for fault in self._faults if fault.holds(t_s)), "") if self._faults else ""
        if fault == "hang":
            self.sensor.advance(t_s)
            return HIGH
        answer = self._answer(byte, t_s)
        return {"zeros": 0x00, "ones": HIGH}.get(fault, answer) if fault else answer

    def _answer(self, byte: int, t_s: float) -> int:
        address = self._address
        if address < 0:
            self._address, self._reads = byte & ~READ, bool(byte & READ)
            return HIGH
        answer = HIGH
        if self._reads:
            answer = self.sensor.read(address, t_s)
            if self.watched and address in CLEARING:
                self.int1(t_s)
        else:
            self.sensor.write(address, byte, t_s)
        if self.sensor.counts_up:
            self._address = FIFO_DATA_OUT_TAG if self._reads and address == FIFO_DATA_OUT_LAST else address + 1 & 0x7F
        return answer
