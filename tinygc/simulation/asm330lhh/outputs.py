"""The output registers 0x20 to 0x2D: STATUS, and the block data update."""

from __future__ import annotations

from tinygc.simulation.asm330lhh.readings import REGISTER_BYTES
from tinygc.simulation.asm330lhh.registers import GDA, OUT_FIRST, OUTX_L_A, OUTX_L_G, TDA, XLDA

GYRO, ACCEL, TEMP = slice(2, 8), slice(8, 14), slice(0, 2)
STATUS = ((TEMP, TDA), (GYRO, GDA), (ACCEL, XLDA))


class Outputs:
    """status: STATUS_REG; bdu: whether a register that was read by half waits for its other half."""

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """As after a reset."""
        self._newest, self._shown = bytearray(REGISTER_BYTES), bytearray(REGISTER_BYTES)
        self._half_read: dict[int, int] = {}  # register -> which half
        self.status, self.bdu = 0, False

    def update(self, part: slice, sample: bytes) -> None:
        """New values of one sensor: its slice of the 14 bytes of a sample."""
        self._newest[part] = sample[part]
        for place, bit in STATUS:
            if place == part:
                self.status |= bit
        if not self._half_read:
            self._shown[part] = sample[part]
            return
        for low in range(part.start, part.stop, 2):
            if low // 2 not in self._half_read:
                self._shown[low : low + 2] = self._newest[low : low + 2]

    def read(self, address: int) -> int:
        """One byte; a high byte takes its sensor's bit of STATUS back."""
        place = address - OUT_FIRST
        value, pair, half = self._shown[place], place // 2, place % 2
        if half:
            self.status &= ~(TDA if address < OUTX_L_G else GDA if address < OUTX_L_A else XLDA)
        if self.bdu and self._half_read.get(pair, half) == half:
            self._half_read[pair] = half
        elif pair in self._half_read:
            del self._half_read[pair]
            self._shown[2 * pair : 2 * pair + 2] = self._newest[2 * pair : 2 * pair + 2]
        return value

    def set_bdu(self, bdu: bool) -> None:
        """Without it nothing waits."""
        self.bdu = bdu
        if not bdu:
            self._half_read.clear()
            self._shown[:] = self._newest
