"""The register model of the ASM330LHH: its FIFO, the interrupt's pin, and what can go wrong with the words."""

from __future__ import annotations

import numpy as np
import pytest
from asm330lhh_wire import ACCEL, GYRO, RATE_HZ, READY_S, SETTLED, Wire, counting, data, level, words

from tinygc.annexes.emulated.fifo import Fifo
from tinygc.annexes.emulated.readings import Fault, Oscillator, Silicon
from tinygc.annexes.emulated.sensor import Asm330lhh

TEMPERATURE, TIMESTAMP, CHANGE = 3, 4, 5


def batching(faults=(), ctrl3=0x77, ctrl4=0x06, code=7, silicon=SETTLED, **how) -> Wire:
    """833 Hz, both sensors in the FIFO, continuous."""
    link = Wire(Asm330lhh(counting, faults=faults, keep=True, silicon=silicon, **how))
    link.write(0x12, 0x44)
    link.write(0x19, 0x20)
    link.write(0x09, ctrl3)
    link.write(0x0A, ctrl4)
    link.write(0x10, code << 4 | 2 << 2)
    link.write(0x11, code << 4 | 4)
    return link


def tags(table: np.ndarray) -> list[int]:
    return list(table[:, 0] >> 3)


def test_every_sample_of_both_sensors_is_in_the_fifo_once():
    link = batching()
    gyro, accel = [], []
    for _ in range(50):
        link.wait(0.02)
        table = words(link)
        gyro.append(data(table, GYRO))
        accel.append(data(table, ACCEL))
    gyro, accel = np.concatenate(gyro), np.concatenate(accel)
    assert len(gyro) > 800
    assert set(np.diff(gyro[:, 0])) == {1}
    np.testing.assert_array_equal(accel, gyro)
    made = np.array([np.frombuffer(sample, "<i2")[1:4] for _, sample, *_ in link.sensor.kept])
    np.testing.assert_array_equal(gyro, made[: len(gyro)])


def test_a_tag_counts_the_slots_and_its_parity_is_even():
    link = batching(ctrl4=0x76)  # temperature at 52 Hz, every timestamp
    link.wait(0.1)
    tag = words(link)[:, 0]
    assert {bin(byte).count("1") % 2 for byte in tag} == {0}
    slots = np.cumsum(np.append(0, np.diff((tag >> 1 & 3).astype(int)) % 4))
    assert set(np.diff(slots)) == {0, 1}
    for sensor in (GYRO, ACCEL, TIMESTAMP):
        np.testing.assert_array_equal(np.diff(slots[tag >> 3 == sensor]), 1)
    assert (tag >> 3 == TEMPERATURE).sum() == pytest.approx(0.1 * 52, abs=1)


@pytest.mark.parametrize(("bits", "decimation"), [(0, 0), (1, 1), (2, 8), (3, 32)])
def test_timestamps_come_with_their_decimation(bits, decimation):
    link = batching(ctrl4=0x06 | bits << 6, oscillator=Oscillator(10, 10))
    link.wait(0.15)
    table = words(link)
    found = table[table[:, 0] >> 3 == TIMESTAMP, 1:5].copy().view("<u4").ravel()
    samples = (table[:, 0] >> 3 == GYRO).sum()
    if not decimation:
        assert len(found) == 0
        return
    assert len(found) == pytest.approx(samples / decimation, abs=1)
    # both have the same oscillator: the ratio of their typical rates
    np.testing.assert_allclose(np.diff(found), decimation * 6 * 8, atol=1)


def test_different_batch_rates():
    """The accelerometer at a quarter of the gyroscope's rate."""
    link = batching(ctrl3=0x75)
    link.wait(0.1)
    found = tags(words(link))
    assert found.count(GYRO) == pytest.approx(83, abs=2)
    assert found.count(ACCEL) == pytest.approx(83 / 4, abs=1)


def test_a_batch_rate_of_zero_batches_nothing():
    link = batching(ctrl3=0x70)
    link.wait(0.1)
    assert set(tags(words(link))) == {GYRO}
    link = batching(ctrl3=0x00)
    link.wait(0.1)
    assert level(link) == 0


def test_the_burst_wraps_from_the_last_byte_to_the_tag():
    link = batching()
    link.wait(0.01)
    one = batching()
    one.wait(0.01)
    burst = words(link, 6)
    single = np.array([words(one, 1)[0] for _ in range(6)])
    np.testing.assert_array_equal(burst, single)


def test_an_empty_fifo_reads_as_zeros():
    link = batching()
    assert level(link) == 0
    assert not words(link, 3).any()


def test_the_watermark_is_a_flag_and_a_pin():
    link = batching()
    link.write(0x0D, 0x08)
    link.write(0x07, 40)
    seen = []
    while len(seen) < 150:
        link.wait(0.0003)
        there = level(link)
        flagged = bool(link.read(0x3B)[0] & 0x80)
        pin = link.sensor.int1(link.t_s)
        if level(link) == there:
            seen.append((there >= 40) == flagged == pin)
    assert all(seen)
    assert link.sensor.int1(link.t_s)
    words(link)
    assert not link.sensor.int1(link.t_s)
    assert not link.read(0x3B)[0] & 0x80


def test_the_watermark_has_nine_bits():
    link = batching()
    link.write(0x07, 0x2C, 0x01)  # 300
    link.wait(140 / RATE_HZ)
    assert level(link) < 300
    assert not link.read(0x3B)[0] & 0x80
    link.wait(15 / RATE_HZ)
    assert link.read(0x3B)[0] & 0x80


def test_the_pin_can_be_low_when_active():
    link = batching()
    link.write(0x12, 0x64)
    link.write(0x0D, 0x02)
    assert link.sensor.int1(link.t_s)
    link.wait(0.005)
    assert not link.sensor.int1(link.t_s)


def test_the_pins_next_edge_is_never_later_than_said():
    for bits in (0x01, 0x02, 0x08, 0x10, 0x20):
        link = batching(ctrl4=0x76)
        link.write(0x0D, bits)
        link.write(0x07, 30)
        sensor, t_s = link.sensor, link.t_s
        edges = 0
        for _ in range(40):
            until_s = min(sensor.int1_stays_until(t_s), t_s + 0.05)
            assert until_s > t_s
            now = sensor.int1(t_s)
            assert sensor.int1(until_s - 1e-9) == now
            edges += sensor.int1(until_s) != now
            t_s = until_s
        assert edges == 1


def test_a_late_host_loses_the_oldest_words_and_is_told():
    link = batching()
    link.wait(1.0)
    low, flags = link.read(0x3A, 2)
    assert low | (flags & 3) << 8 == 438
    assert flags & 0b0111_1000 == 0b0110_1000  # overrun, full, latched
    assert not link.read(0x3B)[0] & 0x08  # until it has been read
    assert link.read(0x3B)[0] & 0x40  # nobody has made room
    gyro = data(words(link), GYRO)[:, 0]
    assert set(np.diff(gyro)) == {1}
    assert gyro[-1] == pytest.approx(round(link.t_s * RATE_HZ), abs=8)  # the newest are there
    assert not link.read(0x3B)[0] & 0x40
    assert link.sensor.fifo.lost == 2 * len(link.sensor.kept) - 438 - len(link.sensor.fifo.words)


@pytest.mark.parametrize("capacity", [416, 417, 418, 438])
def test_it_is_full_where_the_next_slot_has_no_room(capacity):
    """Three words a slot: of the four, only 417 and 438 can be filled to the last word before one is lost."""
    link = batching(ctrl4=0x46, silicon=Silicon(settling=0.0, fifo_words=capacity))
    while not (full := link.read(0x3B)[0]) & 0x20:
        link.wait(0.2 / RATE_HZ)
    assert level(link) == capacity // 3 * 3
    assert not full & 0x40
    link.wait(1.5 / RATE_HZ)
    assert link.read(0x3B)[0] & 0x40


@pytest.mark.parametrize("order", [(4, 3, 1, 2), (1, 2, 3, 4), (2, 4, 1, 3)])
def test_the_words_of_a_slot_have_their_order(order):
    link = batching(ctrl4=0x76, code=7, silicon=Silicon(settling=0.0, order=order))
    link.wait(0.1)
    table = words(link)
    slots = np.split(table[:, 0], np.flatnonzero(np.diff(table[:, 0] >> 1 & 3)) + 1)
    said = {tuple(slot >> 3) for slot in slots}
    assert said == {order, tuple(tag for tag in order if tag != TEMPERATURE)}


@pytest.mark.parametrize("order", [(4, 3, 1, 2), (1, 2, 3, 4)])
def test_a_full_fifo_loses_whole_slots_or_single_words(order):
    def oldest(slots: bool) -> set[int]:
        """The tags that the oldest word has, overrun by one slot after the other."""
        link, found = batching(ctrl4=0x46, silicon=Silicon(settling=0.0, fifo_words=416, order=order, overrun_slots=slots)), set()
        link.wait(0.5)
        for _ in range(40):
            link.wait(0.7 / RATE_HZ)
            found.add(link.read(0x78)[0] >> 3)  # its tag alone: it stays
        assert level(link) == (414 if slots else 416)
        assert link.sensor.fifo.lost == 3 * len(link.sensor.kept) - level(link)
        return found

    assert oldest(True) == {order[0]}
    assert oldest(False) == {order[1] if order[0] == TIMESTAMP and order[1] != TEMPERATURE else {4: 1, 1: 2}[order[0]]}


def test_a_fifo_of_one_word_keeps_the_newest():
    fifo = Fifo(1, whole_slots=True)
    fifo.set_mode(6)
    for value in range(3):
        fifo.put(fifo.word(GYRO, bytes([value] * 6)))
    assert [word[1] for word in fifo.words] == [2]


def test_fifo_mode_stops_when_it_is_full():
    link = batching(ctrl4=0x01)
    link.wait(1.0)
    gyro = data(words(link, 438), GYRO)[:, 0]
    assert gyro[0] == pytest.approx(round(READY_S * RATE_HZ), abs=2)
    assert len(gyro) == 438 / 2


def test_bypass_empties_it():
    link = batching()
    link.wait(0.1)
    link.write(0x0A, 0x00)
    assert level(link) == 0
    link.wait(0.1)
    assert level(link) == 0


def test_it_can_stop_at_the_watermark():
    link = batching()
    link.write(0x07, 100, 0x80)
    link.wait(0.5)
    assert level(link) == 100


def test_a_change_of_rate_leaves_a_word_where_asked():
    link = batching()
    link.write(0x08, 0x10)
    link.wait(0.01)
    link.write(0x11, 0x64)
    link.wait(0.01)
    assert tags(words(link)).count(CHANGE) == 1


def test_the_counter_of_batches_raises_its_flag():
    link = batching()
    link.write(0x0C, 10)
    link.write(0x0D, 0x40)
    assert not link.sensor.int1(link.t_s)
    link.wait(12 / RATE_HZ)
    assert link.read(0x3B)[0] & 0x10
    assert link.sensor.int1(link.t_s)
    link.write(0x0B, 0x40)
    assert not link.sensor.int1(link.t_s)


# Faults of the words


def faulty(kind: str, **how) -> np.ndarray:
    link = batching([Fault(kind, 0.1, **how)])
    link.wait(0.2)
    return words(link)


def ones(tag: np.ndarray) -> np.ndarray:
    return np.array([int(byte).bit_count() % 2 for byte in tag])


def test_a_false_parity():
    table = faulty("parity", words=3)
    assert ones(table[:, 0]).sum() == 3
    assert set(np.diff(data(table, GYRO)[:, 0])) == {1}


def test_a_tag_out_of_order():
    table = faulty("tag_count")
    assert ones(table[:, 0]).sum() == 0
    steps = np.diff((table[:, 0] >> 1 & 3).astype(int)) % 4
    assert (steps > 1).sum() >= 1


def test_a_tag_that_is_none():
    table = faulty("tag_unknown", words=2)
    assert tags(table).count(31) == 2
    assert ones(table[:, 0]).sum() == 0


def test_two_words_that_change_places():
    good, table = faulty("int1"), faulty("swapped")
    assert sorted(map(bytes, good)) == sorted(map(bytes, table))
    assert (good != table).any(axis=1).sum() == 2


def test_a_word_that_never_comes():
    table = faulty("missing")
    assert len(data(table, GYRO)) + len(data(table, ACCEL)) == len(faulty("int1")) - 1


def test_a_dead_pin():
    link = batching([Fault("int1", 0.1, 0.2)])
    link.write(0x0D, 0x02)
    assert [link.sensor.int1(t_s) for t_s in (0.09, 0.15, 0.31)] == [True, False, True]
