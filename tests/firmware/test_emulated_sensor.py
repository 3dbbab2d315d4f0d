"""The test kit's ASM330LHH: map, port, outputs, clock, FIFO and faults, by the facts that the page of the sensor states."""

from __future__ import annotations

import numpy as np
import pytest
from emulator.sensor import STANDARD_GRAVITY, Asm330lhh, Oscillator, SensorPort, Silicon

BYTE_S = 8 / 5.25e6
GYRO = 1  #: its tag
RATE_HZ = 40000 / 6 / 8  #: of code 7, typically
SETTLED = Silicon(settles=False)


def counting(t_s: np.ndarray):
    """At 833 Hz and +-500 dps the gyroscope's registers are the sample's number, its negative and itself; at 4 g the accelerometer's
    are, too."""
    number = np.rint(t_s * RATE_HZ) % 30000
    axes = [1, -1, 1]
    return np.outer(number * np.radians(0.0175), axes), np.outer(number * 0.122e-3 * STANDARD_GRAVITY, axes), np.full(len(t_s), 30.0)


class Wire:
    """A host that knows the protocol: reads and writes at a time that it keeps."""

    def __init__(self, motion=counting, silicon=SETTLED, **how):
        self.sensor = Asm330lhh(motion, keep=True, silicon=silicon, **how)
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

    def level(self) -> int:
        low, high = self.read(0x3A, 2)
        return low | (high & 3) << 8

    def words(self, count: int | None = None) -> np.ndarray:
        """(N, 7) uint8: so many, or all that are there, in one burst that wraps."""
        count = self.level() if count is None else count
        return np.frombuffer(self.read(0x78, 7 * count), np.uint8).reshape(-1, 7)


def data(table: np.ndarray, tag: int) -> np.ndarray:
    return np.ascontiguousarray(table[table[:, 0] >> 3 == tag, 1:]).view("<i2").astype(int)


def started(code: int = 7, ctrl3: int = 0x77, ctrl4: int = 0x46, mask: int = 0, **how) -> Wire:
    """Both sensors on, in the FIFO with their stamps."""
    link = Wire(**how)
    for address, value in (
        (0x12, 0x44),
        (0x13, mask),
        (0x19, 0x20),
        (0x09, ctrl3),
        (0x0A, ctrl4),
        (0x10, code << 4 | 8),
        (0x11, code << 4 | 4),
    ):
        link.write(address, value)
    return link


@pytest.mark.parametrize("code", range(1, 11))
@pytest.mark.parametrize("ticks", [40000 / 6667, 6.0])
def test_the_true_data_rate_is_the_formulas(code, ticks):
    """6667 or 6666.67 Hz x (1 + 0.0015 f) / coefficient; FREQ_FINE is another when a sensor is on."""
    link = Wire(silicon=Silicon(ticks, settles=False), oscillator=Oscillator(7, 35))
    assert link.read(0x63) == b"\x07"
    link.write(0x11, code << 4)
    assert link.read(0x63) == b"\x23"
    link.sensor.advance(link.t_s + 300 * 2 ** (10 - code) / 6667)
    times = np.array([made.t_s for made in link.sensor.kept])
    assert len(times) > 300
    assert 1 / np.diff(times).mean() == pytest.approx(40000 / ticks * (1 + 0.0015 * 35) / 2 ** (10 - code), rel=1e-9)


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


@pytest.mark.parametrize(("off_s", "objected"), [(0.0099, True), (0.0101, False)])
def test_a_gyroscope_stays_off_for_ten_milliseconds(off_s, objected):
    link = started()
    link.write(0x11, 0x00)
    link.t_s += off_s
    link.write(0x11, 0x74)
    assert bool(link.sensor.objections) == objected


@pytest.mark.parametrize("mask", [0, 8])
def test_settling_takes_70_ms_and_3_samples_or_2_and_the_mask_says_so(mask):
    link = started(7, mask=mask, silicon=Silicon())
    link.t_s += 0.05
    assert link.read(0x1E)[0] & 3 == (1 if mask else 3)
    link.t_s += 0.05
    table, made = link.words(), link.sensor.kept
    gyro, accel = (sum(bool(sample.unsettled & bit) for sample in made) for bit in (1, 2))
    assert (gyro, accel) == (3 + int(0.070 * RATE_HZ), 2)
    values = data(table, GYRO)
    assert (values[:gyro] == 0x7FFD).all() == bool(mask)
    assert set(np.diff(values[gyro:, 0])) == {1}
