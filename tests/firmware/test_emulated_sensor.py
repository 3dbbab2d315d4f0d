"""The test kit's ASM330LHH: map, port, outputs, clock, FIFO and faults, by the facts that the page of the sensor states."""

from __future__ import annotations

import numpy as np
import pytest
from emulator.sensor import CHIPS, STANDARD_GRAVITY, Asm330lhh, AtRest, Fault, Oscillator, SensorPort, Silicon

BYTE_S = 8 / 5.25e6
GYRO, ACCEL, TEMPERATURE, TIMESTAMP = 1, 2, 3, 4
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

    def int16(self, address: int, count: int = 1) -> list[int]:
        return np.frombuffer(self.read(address, 2 * count), "<i2").tolist()

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


@pytest.mark.parametrize("chip", CHIPS.values(), ids=CHIPS)
def test_the_sensitivities_are_the_maps_and_the_lsm6dso_has_no_4000_dps(chip):
    for fs_g, mdps in ((2, 4.375), (0, 8.75), (4, 17.5), (8, 35), (12, 70), (1, 140)):
        turn = lambda t_s, mdps=mdps: (np.tile(np.radians([0.1 * mdps, -0.2 * mdps, 0]), (len(t_s), 1)), *AtRest()(t_s)[1:])  # noqa: E731
        link = Wire(turn, Silicon(chip=chip, settles=False))
        assert link.read(0x0F)[0] == chip.identity
        link.write(0x11, 5 << 4 | fs_g)
        link.t_s += 0.02
        good = fs_g in chip.gyro_mdps
        assert (link.int16(0x22, 3) == [100, -200, 0]) == good
        assert bool(link.sensor.objections) != good
    for fs_xl, mg in ((0, 0.061), (2, 0.122), (3, 0.244), (1, 0.488)):
        link = Wire(AtRest())
        link.write(0x10, 5 << 4 | fs_xl << 2)
        link.t_s += 0.02
        assert link.int16(0x28, 3) == [0, 0, round(1000 / mg)]


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


def test_if_inc_makes_the_address_count():
    link = Wire()
    link.write(0x10, 0x50, 0x54)
    assert link.read(0x10, 2) == b"\x50\x54"
    link.write(0x12, 0x00)
    assert link.read(0x10, 3) == b"\x50\x50\x50"


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


def test_every_sample_is_in_the_fifo_once_with_its_tag_and_stamp():
    link, tables = started(ctrl4=0x76, oscillator=Oscillator(10, 10)), []
    for _ in range(50):
        link.t_s += 0.02
        tables.append(link.words())
    table = np.concatenate(tables)
    made = np.array([np.frombuffer(made.registers, "<i2") for made in link.sensor.kept])
    count = len(data(table, GYRO))
    assert count > 800
    np.testing.assert_array_equal(data(table, GYRO), made[:count, 1:4])
    np.testing.assert_array_equal(data(table, ACCEL), made[:count, 4:7])
    assert {int(tag).bit_count() % 2 for tag in table[:, 0]} == {0}
    slots = np.cumsum(np.append(0, np.diff((table[:, 0] >> 1 & 3).astype(int)) % 4))
    for sensor in (GYRO, ACCEL, TIMESTAMP):
        np.testing.assert_array_equal(np.diff(slots[table[:, 0] >> 3 == sensor]), 1)
    assert (table[:, 0] >> 3 == TEMPERATURE).sum() == pytest.approx(link.t_s * 52, abs=2)
    stamps = table[table[:, 0] >> 3 == TIMESTAMP, 1:5].copy().view("<u4").ravel()
    np.testing.assert_allclose(np.diff(stamps), 6 * 8, atol=1)  # both have the same oscillator


def test_a_burst_reads_what_single_words_read_and_an_empty_fifo_is_zeros():
    bursts, singles = started(), started()
    assert not bursts.words(3).any()
    for link in (bursts, singles):
        link.t_s = 0.05
    np.testing.assert_array_equal(bursts.words(6), np.concatenate([singles.words(1) for _ in range(6)]))


def test_the_watermark_has_nine_bits_and_bypass_empties():
    link = started(ctrl4=0x06)
    link.write(0x07, 0x2C, 0x01)  # 300
    link.t_s += 140 / RATE_HZ
    assert not link.read(0x3B)[0] & 0x80
    link.t_s += 15 / RATE_HZ
    assert link.read(0x3B)[0] & 0x80
    link.write(0x0A, 0x00)
    assert link.level() == 0


@pytest.mark.parametrize("capacity", [416, 438])
def test_a_late_host_loses_the_oldest_words_and_is_told(capacity):
    link = started(ctrl4=0x06, silicon=Silicon(fifo_words=capacity, settles=False))
    link.t_s += 1.0
    low, flags = link.read(0x3A, 2)
    assert low | (flags & 3) << 8 == capacity
    assert flags & 0x48 == 0x48  # overrun, latched
    assert link.read(0x3B)[0] & 0x48 == 0x40  # until it has been read; nobody has made room
    gyro = data(link.words(), GYRO)[:, 0]
    assert set(np.diff(gyro)) == {1}
    assert gyro[-1] == pytest.approx(round(link.t_s * RATE_HZ), abs=8)  # the newest are there
    assert not link.read(0x3B)[0] & 0x40


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


# Faults


@pytest.mark.parametrize(("kind", "changed"), [("parity", 1), ("tag_unknown", 1), ("missing", 0)])
def test_a_word_of_the_fifo_is_spoilt(kind, changed):
    tables = []
    for faults in ((), [Fault(kind, 0.1)]):
        link = started(faults=faults)
        link.t_s = 0.15
        tables.append(link.words())
    good, bad = tables
    assert len(good) - len(bad) == 1 - changed
    if changed:
        assert (good != bad).any(axis=1).sum() == 1
    assert (31 in bad[:, 0] >> 3) == (kind == "tag_unknown")
    assert sum(int(tag).bit_count() % 2 for tag in bad[:, 0]) == (kind == "parity")


@pytest.mark.parametrize(("fault", "found"), [("zeros", b"\0"), ("ones", b"\xff"), ("hang", b"\xff"), ("identity", b"\x1f")])
def test_who_answers_during_a_fault(fault, found):
    link = Wire(faults=[Fault(fault, 0.1, 0.1)])
    for t_s, said in ((0.05, b"\x6b"), (0.15, found), (0.25, b"\x6b")):
        link.t_s = t_s
        assert link.read(0x0F) == said
    link.t_s = 0.15
    link.write(0x10, 0x50)
    link.t_s = 0.25
    assert link.read(0x10) == (b"\0" if fault == "hang" else b"\x50")


def test_registers_that_change_by_themselves_and_words_at_half_the_rate():
    faults = [Fault("rate", 0.1, 0.1), Fault("register", 0.3), Fault("reset", 0.5)]
    link, tables = started(faults=faults), []
    for until_s in (0.1, 0.2, 0.3, 0.4):
        link.t_s = until_s
        tables.append(link.words())
    assert [round(len(data(table, GYRO)) / 83.3, 1) for table in tables[1:]] == [0.5, 1.0, 1.0]
    assert [len(data(table, TIMESTAMP)) > 5 for table in tables] == [True, True, True, False]
    assert link.read(0x0A) == b"\x06"
    link.t_s = 0.52
    assert (link.read(0x10), link.level()) == (b"\0", 0)
    late = Wire(faults=[Fault("late", 0.3)])
    for late.t_s, said in ((0.2999, b"\0"), (0.3001, b"\x6b")):
        assert late.read(0x0F) == said
