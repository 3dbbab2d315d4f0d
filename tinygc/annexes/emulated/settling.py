"""Settling: what the outputs are until the filters have settled, and what the FIFO holds instead where DRDY_MASK covers it.

The times are those of ST's Linux driver st_asm330lhhx, which throws so many samples away.  No source says what such a sample is: here it
is too low by an amount that decays, and is more than 1 % of the register's range up to the last.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

from tinygc.annexes.emulated.readings import ACCEL_OUT, COEFFICIENTS, GYRO_OUT, Silicon

# ST's discard table.

GYRO_ON_S = 0.070  #: from off to on, at every rate
GYRO_SAMPLES = {1: 2} | dict.fromkeys(range(2, 11), 3)  #: behind it, or behind a change of rate, by code of odr_g
ACCEL_SAMPLES = 2
#: LPF1 of the gyroscope: samples by FTYPE and by code of odr_g, 12.5 to 833 Hz; above, the time is that at 833 Hz
LPF1_SAMPLES = (
    (0, 0, 0, 0, 0, 2, 3),
    (0, 0, 0, 0, 1, 2, 4),
    (0, 0, 0, 1, 1, 3, 5),
    (0, 0, 0, 0, 0, 1, 2),
    (0, 0, 1, 1, 2, 4, 9),
    (0, 1, 1, 2, 4, 9, 18),
    (0, 1, 2, 3, 6, 12, 24),
    (1, 2, 3, 6, 12, 24, 48),
)
#: LPF2 of the accelerometer: samples by HPCF_XL (ODR/4, /10, /20, /45, /100, /200, /400, /800), at every rate
LPF2_SAMPLES = (0, 10, 19, 38, 75, 150, 296, 595)


def lpf1_samples(ftype: int, code: int) -> int:
    """Return the samples that LPF1 needs; code: of odr_g."""
    row = LPF1_SAMPLES[ftype]
    return row[code - 1] if code <= len(row) else row[-1] << code - len(row)


# The outputs of one sensor.

#: bits of ``Made.unsettled``: whose value is not settled, and whose word was masked
GYRO_UNSETTLED, ACCEL_UNSETTLED, GYRO_MASKED, ACCEL_MASKED = 1, 2, 4, 8
MASKS = (0x7FFF, 0x7FFE, 0x7FFD)  #: the values in place of a sample; which of them stands for what, no source says: they take turns
FIRST_LSB, LAST_LSB = 8192, 410  #: of the error: 25 % and 1.25 % of the register's range


@dataclass
class Settling:
    """Ticks of the sample clock: the first with a sample, the first that DRDY_MASK lets pass, the first that only the other filter has
    not settled, the first that is settled, one sample."""

    first: int = 0
    unmasked: int = 0
    filtered: int = 0
    settled: int = 0
    step: int = 1

    def begin(self, first: int, step: int, masked: int, behind: int, further: int) -> None:
        """Begin anew at a tick: so many samples that the mask covers, so many behind them, and so many further of the other filter."""
        self.first, self.step = first, step
        self.unmasked = first + masked * step
        self.filtered = self.unmasked + behind * step
        self.settled = self.filtered + further * step

    def refilter(self, first: int, further: int) -> None:
        """Settle another filter from a tick on; what the mask covers goes on as it was."""
        self.first = first
        self.settled = max(self.filtered, first) + further * self.step

    def error_lsb(self, tick: int) -> int:
        """Return by how much the value at a tick is too low."""
        if not self.first <= tick < self.settled:
            return 0
        return round(FIRST_LSB * (LAST_LSB / FIRST_LSB) ** ((tick - self.first) / (self.settled - self.first)))


class Filters:
    """Both sensors' settling.  until: the tick from which on everything is settled."""

    def __init__(self, silicon: Silicon):
        self._factor, self._covers_all, self._mask_first = silicon.settling, silicon.mask_covers_all, silicon.mask_first
        self.gyro, self.accel = Settling(), Settling()
        self.until = 0

    def samples(self, count: int) -> int:
        """Return a count of the table as this chip has it."""
        return math.ceil(self._factor * count)

    def set_gyro(self, first: int, code: int, on_for_s: float, clock_hz: float, lpf1: int) -> None:
        """Begin at a tick with this code of odr_g; on_for_s: time from off to on until that tick; lpf1: samples of LPF1."""
        step = COEFFICIENTS[code]
        left_s = self._factor * GYRO_ON_S - on_for_s
        starting = math.floor(left_s * clock_hz / step) + 1 if left_s >= 0 and self._factor else 0
        self._begin(self.gyro, first, step, starting + self.samples(GYRO_SAMPLES[code]), lpf1)

    def set_accel(self, first: int, step: int, lpf2: int) -> None:
        """Begin at a tick; step: ticks of a sample; lpf2: samples of LPF2."""
        self._begin(self.accel, first, step, self.samples(ACCEL_SAMPLES), lpf2)

    def _begin(self, sensor: Settling, first: int, step: int, masked: int, other: int) -> None:
        """Begin to settle a sensor; other: samples of its filter that the mask need not cover."""
        sensor.begin(first, step, masked, masked if self._mask_first else 0, self.samples(other))
        self._limit()

    def refilter_gyro(self, first: int, lpf1: int) -> None:
        """Change LPF1 alone."""
        self.gyro.refilter(first, self.samples(lpf1))
        self._limit()

    def refilter_accel(self, first: int, lpf2: int) -> None:
        """Change LPF2 alone."""
        self.accel.refilter(first, self.samples(lpf2))
        self._limit()

    def _limit(self) -> None:
        self.until = max(self.gyro.settled, self.accel.settled)

    def spoil(self, tick: int, sample: bytes, masks: bool) -> tuple[bytes, bytes, int]:
        """Return the 14 bytes of the outputs at a tick, those that the FIFO gets, and the bits of ``Made.unsettled``.

        masks: whether DRDY_MASK is set.
        """
        outputs, words, bits = bytearray(sample), bytearray(sample), 0
        for sensor, place, bit in ((self.gyro, GYRO_OUT, GYRO_UNSETTLED), (self.accel, ACCEL_OUT, ACCEL_UNSETTLED)):
            if not (error := sensor.error_lsb(tick)):
                continue
            bits |= bit
            values = struct.unpack("<3h", sample[place])
            outputs[place] = words[place] = struct.pack("<3h", *(max(-32768, value - error) for value in values))
            if masks and (self._covers_all or tick < sensor.unmasked):
                bits |= bit << 2
                turn = tick // sensor.step
                words[place] = struct.pack("<3h", *(MASKS[(turn + axis) % len(MASKS)] for axis in range(3)))
        return bytes(outputs), bytes(words), bits
