"""The test kit's ASM330LHH: reset, what it objects to, and settling; FIFO and faults are held by what the driver makes of them."""

from __future__ import annotations

import numpy as np
import pytest
from emulator.sensor import STANDARD_GRAVITY, Asm330lhh, SensorPort, Silicon

BYTE_S = 8 / 5.25e6
GYRO = 1  #: its tag
RATE_HZ = 40000 / 6 / 8  #: of code 7, typically


def counting(t_s: np.ndarray):
    """At 833 Hz and +-500 dps the gyroscope's registers are the sample's number, its negative and itself; at 4 g the accelerometer's
    are, too."""
    number = np.rint(t_s * RATE_HZ) % 30000
    axes = [1, -1, 1]
    return np.outer(number * np.radians(0.0175), axes), np.outer(number * 0.122e-3 * STANDARD_GRAVITY, axes), np.full(len(t_s), 30.0)


class Wire:
    """A host that knows the protocol: reads and writes at a time that it keeps."""

    def __init__(self):
        self.sensor = Asm330lhh(counting, keep=True, silicon=Silicon())
        self.port, self.t_s = SensorPort(self.sensor), 0.02

    def _exchange(self, out: bytes) -> bytes:
        self.port.select(True, self.t_s)
        answer = self.port.transfer(out, self.t_s, BYTE_S)
        self.t_s += len(out) * BYTE_S
        self.port.select(False, self.t_s)
        return answer

    def read(self, address: int, count: int = 1) -> bytes:
        return self._exchange(bytes([0x80 | address]) + bytes(count))[1:]

    def write(self, address: int, *values: int) -> None:
        self._exchange(bytes([address, *values]))

    def words(self) -> np.ndarray:
        """(N, 7) uint8: all that are there, in one burst that wraps."""
        low, high = self.read(0x3A, 2)
        return np.frombuffer(self.read(0x78, 7 * (low | (high & 3) << 8)), np.uint8).reshape(-1, 7)


def test_a_reset_sets_all_registers_back_and_what_cannot_be_written_is_objected_to():
    link = Wire()
    link.write(0x10, 0x50)
    link.write(0x12, 0x05)
    assert (link.read(0x10), link.read(0x12)) == (b"\0", b"\x05")  # as long as it lasts
    link.t_s += 0.001
    assert link.read(0x12) == b"\x04"
    assert not link.sensor.objections
    link.write(0x19, 0xFF)
    link.write(0x0F, 1)
    assert len(link.sensor.objections) == 2
    assert (link.read(0x19), link.read(0x0F)) == (b"\x20", b"\x6b")


@pytest.mark.parametrize("mask", [0, 8])
def test_settling_takes_70_ms_and_3_samples_or_2_and_the_mask_says_so(mask):
    link = Wire()
    for address, value in ((0x12, 0x44), (0x13, mask), (0x19, 0x20), (0x09, 0x77), (0x0A, 0x46), (0x10, 0x78), (0x11, 0x74)):
        link.write(address, value)
    link.t_s += 0.05
    assert link.read(0x1E)[0] & 3 == (1 if mask else 3)
    link.t_s += 0.05
    table, made = link.words(), link.sensor.kept
    gyro, accel = (sum(bool(sample.unsettled & bit) for sample in made) for bit in (1, 2))
    assert (gyro, accel) == (3 + int(0.070 * RATE_HZ), 2)
    values = np.ascontiguousarray(table[table[:, 0] >> 3 == GYRO, 1:]).view("<i2").astype(int)
    assert (values[:gyro] == 0x7FFD).all() == bool(mask)
    assert set(np.diff(values[gyro:, 0])) == {1}
