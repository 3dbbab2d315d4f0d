"""The register model of the ASM330LHH: what silicon may do, each a parameter; its sibling; settling by ST's table, typed here anew."""

from __future__ import annotations

import argparse
import re

import numpy as np
import pytest
from asm330lhh_wire import ACCEL, GYRO, RATE_HZ, READY_S, SETTLED, Wire, counting, data, level, words
from conftest import ROOT

from tinygc.annexes.emulated import command
from tinygc.annexes.emulated.readings import JITTERS, KINDS, LSM6DSO, AtRest, Fault, Oscillator, Silicon
from tinygc.annexes.emulated.sensor import Asm330lhh

TIMESTAMP = 4
GYRO_BIT, ACCEL_BIT, GYRO_MASKED, ACCEL_MASKED = 1, 2, 4, 8
LEVEL = AtRest()
ALL_OF_THEM = range(1, 8)  # codes of 12.5 to 833 Hz


def started(silicon: Silicon, code: int = 7, motion=LEVEL, ctrl=(), faults=(), fine: int = 0, ctrl4: int = 0x46) -> Wire:
    """Both sensors on at one rate, each stamp in the FIFO; ctrl: registers written before them, (address, value)."""
    link = Wire(Asm330lhh(motion, Oscillator(fine, fine), faults, keep=True, silicon=silicon))
    for address, value in ((0x12, 0x44), (0x19, 0x20), (0x09, code * 17), (0x0A, ctrl4), *ctrl):
        link.write(address, value)
    link.write(0x10, code << 4 | 2 << 2 | (2 if any(address == 0x17 for address, _ in ctrl) else 0))
    link.write(0x11, code << 4 | 4)
    return link


def stamps(link: Wire) -> np.ndarray:
    table = words(link)
    return table[table[:, 0] >> 3 == TIMESTAMP, 1:5].copy().view("<u4").ravel().astype(int)


def unsettled(link: Wire, bit: int) -> int:
    """The samples at the beginning with that bit: none later has it."""
    bits = [made.unsettled & bit for made in link.sensor.kept]
    count = bits.index(0)
    assert not any(bits[count:])
    return count


# Time: the stamp and the sample clock


@pytest.mark.parametrize("ticks", [40000 / 6667, 6.0, 6.0003])
@pytest.mark.parametrize("fine", [-20, 0, 35])
def test_a_period_is_so_many_ticks_whatever_the_oscillator(ticks, fine):
    link = started(Silicon(ticks, settling=0.0), 10, fine=fine)
    total = []
    while len(total) < 20_000:
        link.wait(0.012)
        total += list(stamps(link))
    assert (total[20_000 - 1] - total[0]) / 19_999 == pytest.approx(ticks, abs=1 / 19_999)
    assert max(np.diff(total)) - min(np.diff(total)) <= 1


def test_a_period_of_six_ticks_has_no_other():
    link = started(SETTLED, 10)
    link.wait(0.02)
    assert set(np.diff(stamps(link))) == {6}


def test_jitter_moves_a_stamp_either_way_and_never_backwards():
    def heard(**how) -> np.ndarray:
        link, found = started(Silicon(settling=0.0, **how), 9), []
        for _ in range(40):
            link.wait(0.025)
            found.append(stamps(link))
        return np.concatenate(found)

    exact, one, two = heard(), heard(stamp_jitter_ticks=1), heard(stamp_jitter_ticks=2, seed=3)
    assert set(one - exact) == {-1, 0, 1}
    assert set(two - exact) == {-2, -1, 0, 1, 2}
    assert np.bincount(one - exact + 1).min() > len(exact) / 4
    np.testing.assert_array_equal(one, heard(stamp_jitter_ticks=1))
    assert (one != heard(stamp_jitter_ticks=1, seed=1)).any()
    wild = heard(stamp_jitter_ticks=30)
    assert np.diff(wild).min() == 0


def offs(ticks: int, kind: str, count: int = 20_000) -> np.ndarray:
    return np.fromiter(Silicon(stamp_jitter_ticks=ticks, jitter=kind).stamps_off(), int, count)


def test_jitter_has_kinds():
    assert list(offs(2, "alternating", 4)) == [2, -2, 2, -2]
    assert set(offs(2, "late")) == {0, 1, 2}
    blocks = offs(2, "blocks")
    assert set(blocks) == {-2, 2}
    lengths = np.diff(np.flatnonzero(np.diff(blocks)))
    assert lengths.max() > 64
    assert np.median(lengths) > 20
    for kind in JITTERS:
        assert not offs(0, kind, 100).any()


def test_jitter_of_each_kind_reaches_the_fifo():
    def heard(**how) -> np.ndarray:
        link = started(Silicon(settling=0.0, **how), 9)
        link.wait(0.03)
        return stamps(link)[2:]

    for kind in JITTERS[1:]:
        off = heard(stamp_jitter_ticks=2, jitter=kind) - heard()
        assert set(off) <= set(offs(2, kind)), kind
        assert off.any(), kind


@pytest.mark.parametrize("ppm_s", [-200.0, 200.0])
def test_an_oscillator_that_drifts_takes_rate_and_ticks_along(ppm_s):
    link = Wire(Asm330lhh(LEVEL, Oscillator(drift_ppm_s=ppm_s), keep=True, silicon=SETTLED))
    for address, value in ((0x12, 0x44), (0x19, 0x20), (0x09, 0x77), (0x0A, 0x46), (0x10, 0x78), (0x11, 0x74)):
        link.write(address, value)
    heard = []
    for _ in range(50):
        link.wait(0.1)
        heard.append(stamps(link))
    assert set(np.diff(np.concatenate(heard))) == {48}
    times = np.array([made.t_s for made in link.sensor.kept])
    first, last = np.diff(times[:100]).mean(), np.diff(times[-100:]).mean()
    assert first / last - 1 == pytest.approx(1e-6 * ppm_s * (times[-50] - times[50]), rel=0.02)
    ticks = int.from_bytes(link.read(0x40, 4), "little")
    assert ticks == pytest.approx(40000 * (link.t_s - READY_S) * (1 + 0.5e-6 * ppm_s * (link.t_s + READY_S)), abs=2)
    link.write(0x42, 0xAA)
    began_s = link.t_s
    link.wait(0.5)
    ticks = int.from_bytes(link.read(0x40, 4), "little")
    assert ticks == pytest.approx(40000 * (link.t_s - began_s) * (1 + 1e-6 * ppm_s * (began_s + 0.25)), abs=2)


@pytest.mark.parametrize("capacity", [416, 438, 512])
def test_the_fifo_holds_so_many_words(capacity):
    link = started(Silicon(settling=0.0, fifo_words=capacity), 7, counting)
    link.wait(1.0)
    assert level(link) == capacity
    assert link.sensor.fifo.lost == 3 * len(link.sensor.kept) - capacity
    gyro = data(words(link), GYRO)[:, 0]
    assert set(np.diff(gyro)) == {1}
    assert gyro[-1] == pytest.approx(link.t_s * RATE_HZ, abs=8)


@pytest.mark.parametrize(
    "how",
    [
        {"fifo_words": 0},
        {"fifo_words": 1024},
        {"ticks_per_period": 0.0},
        {"settling": -1.0},
        {"gyro_off_s": -1.0},
        {"jitter": "wild"},
        {"order": (1, 2)},
    ],
)
def test_what_no_chip_can_be_is_refused(how):
    with pytest.raises(ValueError, match="expected"):
        Silicon(**how)


# Settling


@pytest.mark.parametrize(("code", "discarded"), list(zip(ALL_OF_THEM, (2 + 1, 3 + 2, 3 + 4, 3 + 7, 3 + 15, 3 + 30, 3 + 58), strict=True)))
def test_a_gyroscope_settles_as_the_table_says(code, discarded):
    """70 ms are whole samples in the table; here they are 70 ms."""
    link = started(Silicon(), code)
    link.sensor.advance(1.0)
    rate_hz = 40000 / 6 / 2 ** (10 - code)
    exact = (2 if code == 1 else 3) + int(0.070 * rate_hz)
    assert unsettled(link, GYRO_BIT) == exact
    assert discarded - 1 <= exact <= discarded
    assert unsettled(link, ACCEL_BIT) == 2


@pytest.mark.parametrize(
    ("ftype", "table"),
    [
        (0, (0, 0, 0, 0, 0, 2, 3)),
        (1, (0, 0, 0, 0, 1, 2, 4)),
        (2, (0, 0, 0, 1, 1, 3, 5)),
        (3, (0, 0, 0, 0, 0, 1, 2)),
        (4, (0, 0, 1, 1, 2, 4, 9)),
        (5, (0, 1, 1, 2, 4, 9, 18)),
        (6, (0, 1, 2, 3, 6, 12, 24)),
        (7, (1, 2, 3, 6, 12, 24, 48)),
    ],
)
def test_lpf1_adds_what_the_table_says(ftype, table):
    for code, more in (*zip(ALL_OF_THEM, table, strict=True), (8, 2 * table[-1]), (9, 4 * table[-1]), (10, 8 * table[-1])):
        plain, filtered = started(Silicon(), code), started(Silicon(), code, ctrl=[(0x13, 0x02), (0x15, ftype)])
        for link in (plain, filtered):
            link.sensor.advance(0.7 if code < 4 else 0.2)
        assert unsettled(filtered, GYRO_BIT) - unsettled(plain, GYRO_BIT) == more


def test_lpf2_adds_what_the_table_says_at_every_rate():
    for hpcf, more in enumerate((0, 10, 19, 38, 75, 150, 296, 595)):
        for code in (7, 10):
            link = started(Silicon(), code, ctrl=[(0x17, hpcf << 5)])
            link.sensor.advance(0.8)
            assert unsettled(link, ACCEL_BIT) == 2 + more


@pytest.mark.parametrize("factor", [0.0, 0.5, 2.0])
def test_all_times_have_one_factor(factor):
    link = started(Silicon(settling=factor), 7, ctrl=[(0x13, 0x02), (0x15, 7), (0x17, 2 << 5)])
    link.sensor.advance(0.5)
    gyro = int(factor * 0.070 * RATE_HZ) + np.ceil(3 * factor) + 48 * factor
    assert unsettled(link, GYRO_BIT) == gyro
    assert unsettled(link, ACCEL_BIT) == 2 * factor + np.ceil(19 * factor)


def test_70_ms_are_true_time_though_the_oscillator_is_quick():
    link = started(Silicon(), 10, fine=100)
    link.sensor.advance(0.2)
    assert unsettled(link, GYRO_BIT) == 3 + int(0.070 * 1.15 * 40000 / 6)


def test_an_unsettled_output_is_off_by_more_than_one_percent_up_to_the_last():
    link = started(Silicon(fifo_words=1023), 7, ctrl=[(0x13, 0x02), (0x15, 7), (0x17, 3 << 5)])
    link.sensor.advance(0.3)
    made = np.array([np.frombuffer(made.registers, "<i2") for made in link.sensor.kept]).astype(int)
    for place, bit in ((slice(1, 4), GYRO_BIT), (slice(4, 7), ACCEL_BIT)):
        count = unsettled(link, bit)
        off = made[-1, place] - made[:count, place]
        assert off.min() > 0.0125 * 32768
        assert (np.diff(off, axis=0) <= 0).all()
        assert (made[count:, place] == made[-1, place]).all()
    np.testing.assert_array_equal(data(words(link), GYRO)[: len(made)], made[:, 1:4])  # without the mask the FIFO holds the same


@pytest.mark.parametrize("covers_all", [False, True])
def test_the_mask_stands_for_samples_that_it_covers(covers_all):
    link = started(Silicon(mask_covers_all=covers_all), 7, ctrl=[(0x13, 0x0A), (0x15, 7), (0x17, 1 << 5)])
    link.wait(0.16)
    table = words(link)
    base = 3 + int(0.070 * RATE_HZ)
    for tag, masked, all_of_it in ((GYRO, base, base + 48), (ACCEL, 2, 12)):
        values = data(table, tag)
        count = all_of_it if covers_all else masked
        assert set(values[:count].ravel()) <= {0x7FFD, 0x7FFE, 0x7FFF}
        assert (values[count:] < 0x7FFD).all()
        off = values[-1] - values[count:all_of_it]
        assert (off > 400).all()  # what it does not cover is there, and wrong
        assert (values[all_of_it:] == values[-1]).all()
    assert unsettled(link, GYRO_MASKED) == (base + 48 if covers_all else base)
    assert unsettled(link, ACCEL_MASKED) == (12 if covers_all else 2)


def test_discards_may_be_counted_behind_the_masked_samples():
    """As st_asm330lhhx counts: it throws the masked words away, and then so many samples as its table says, 70 ms among them."""
    link = started(Silicon(mask_first=True, fifo_words=1023), 7, ctrl=[(0x13, 0x0A), (0x15, 7), (0x17, 1 << 5)])
    link.wait(0.27)
    base = 3 + int(0.070 * RATE_HZ)
    gyro = data(words(link), GYRO)
    assert unsettled(link, GYRO_MASKED) == base
    assert unsettled(link, GYRO_BIT) == 2 * base + 48
    assert unsettled(link, ACCEL_MASKED) == 2
    assert unsettled(link, ACCEL_BIT) == 2 * 2 + 10
    assert (gyro[:base] >= 0x7FFD).all()
    assert (gyro[base : 2 * base + 48] < gyro[-1] - 400).all()


def test_a_filter_that_is_set_while_the_mask_holds_settles_behind_it():
    """20 ms from switching on, LPF1: its 48 samples begin where the drive's 70 ms and 3 samples end."""
    link = started(Silicon(), 7, ctrl=[(0x15, 7)])
    link.wait(0.02)
    link.write(0x13, 0x0A)
    link.sensor.advance(0.3)
    assert unsettled(link, GYRO_BIT) == 3 + int(0.070 * RATE_HZ) + 48
    assert sum(bool(made.unsettled & GYRO_MASKED) for made in link.sensor.kept) < 3 + int(0.050 * RATE_HZ) + 2


def test_a_clock_of_samples_that_begins_anew_has_another_number():
    link = started(SETTLED, 7, faults=[Fault("reset", 0.5)])
    link.wait(0.1)
    link.write(0x13, 0x02)
    link.wait(0.1)
    link.write(0x10, 0x00)  # the gyroscope goes on
    link.write(0x10, 0x78)
    link.sensor.advance(0.6)
    assert {made.grid for made in link.sensor.kept} == {1}
    link.t_s = 0.6
    link.write(0x11, 0x74)
    link.wait(0.1)
    link.write(0x11, 0x00)
    link.wait(0.02)
    link.write(0x11, 0x74)
    link.sensor.advance(0.8)
    grids = np.array([made.grid for made in link.sensor.kept])
    assert set(grids) == {1, 2, 3}
    assert set(np.diff(grids)) == {0, 1}


@pytest.mark.parametrize("mask", [0x00, 0x08])
def test_a_masked_sample_is_not_said_to_be_ready(mask):
    link = started(Silicon(), 7, ctrl=[(0x13, mask)])
    link.wait(0.05)
    assert link.read(0x1E)[0] & 3 == (1 if mask else 3)
    link.wait(0.05)
    assert link.read(0x1E)[0] & 3 == 3


def test_another_rate_or_filter_settles_anew_but_the_drive_runs_on():
    link = started(Silicon(), 7)
    for address, value, gyro, accel in (
        (0x11, 0x64, 3, 0),  # the gyroscope at half the rate
        (0x13, 0x02, 2, 0),  # LPF1, FTYPE 0, at 417 Hz
        (0x15, 0x07, 24, 0),
        (0x10, 0x6A, 0, 2),  # the accelerometer too, its LPF2 at ODR/4
        (0x17, 0x20, 0, 10),
    ):
        link.wait(0.2)
        link.sensor.advance(link.t_s)
        del link.sensor.kept[:]
        link.write(address, value)
        link.wait(0.2)
        link.sensor.advance(link.t_s)
        times = 833 / 417 if address in (0x11, 0x13, 0x15) else 1  # rows are made for the quicker of the two
        assert sum(made.unsettled & GYRO_BIT for made in link.sensor.kept) == pytest.approx(gyro * times, abs=1)
        assert sum(bool(made.unsettled & ACCEL_BIT) for made in link.sensor.kept) == accel


def test_what_is_written_again_as_it_was_unsettles_nothing():
    link = started(Silicon(), 7)
    link.wait(0.2)
    link.sensor.advance(link.t_s)
    del link.sensor.kept[:]
    for address in (0x10, 0x11, 0x13, 0x15, 0x17):
        link.write(address, link.read(address)[0])
    link.wait(0.1)
    link.sensor.advance(link.t_s)
    assert not any(made.unsettled for made in link.sensor.kept)


# Switching


@pytest.mark.parametrize(("off_s", "objected"), [(0.0099, True), (0.0101, False)])
@pytest.mark.parametrize("by", [(0x11, 0x00), (0x12, 0x05)])
def test_a_gyroscope_stays_off_for_ten_milliseconds(off_s, objected, by):
    link = started(Silicon())
    assert not link.sensor.objections
    link.write(*by)
    link.wait(off_s)
    link.write(0x11, 0x74)
    assert bool(link.sensor.objections) == objected


def test_a_gyroscope_that_sleeps_is_not_off():
    link = started(Silicon())
    link.write(0x13, 0x40)
    link.wait(0.001)
    link.write(0x13, 0x00)
    link.sensor.advance(0.3)
    assert not link.sensor.objections


def test_the_pull_up_of_the_chip_select_goes_with_both_bits():
    for i2c, conf, on in ((0, 0, True), (4, 0, True), (0, 2, True), (4, 2, False)):
        link = Wire(Asm330lhh(AtRest()))
        link.write(0x13, i2c)
        link.write(0x18, 0xE0 | conf)
        assert link.sensor.cs_pull_up == on
        assert not link.sensor.objections


@pytest.mark.parametrize(("trigger", "counted"), [(0x00, ACCEL), (0x20, GYRO)])
def test_what_the_counter_of_batches_counts(trigger, counted):
    """The accelerometer at a quarter of the gyroscope's rate: the flag comes with the tenth word of the one that is counted."""
    link = started(SETTLED, 7, ctrl=[(0x0B, trigger), (0x0C, 10), (0x09, 0x75)])
    while not link.read(0x3B)[0] & 0x10:
        link.wait(0.0002)
    assert len(data(words(link), counted)) == 10


# The sibling


def test_the_lsm6dso_is_another_chip_of_the_same_family():
    link = started(Silicon(settling=0.0, chip=LSM6DSO), 7, counting, ctrl=[(0x18, 0xE2), (0x13, 0x08)])
    link.wait(0.02)
    assert link.read(0x0F) == b"\x6c"
    assert set(np.diff(data(words(link), GYRO)[:, 0])) == {1}
    assert not link.sensor.objections


def test_the_lsm6dso_has_no_4000_dps():
    link = Wire(Asm330lhh(AtRest(), silicon=Silicon(chip=LSM6DSO)))
    link.write(0x11, 0x71)
    assert link.read(0x11) == b"\x70"
    assert list(link.sensor.objections) == ["reserved bits of 0x11 were written: 0x01"]
    for code in (0, 2, 4, 8, 12):
        link.write(0x11, 0x70 | code)
    assert len(link.sensor.objections) == 1


@pytest.mark.parametrize(
    ("address", "bit"), [(0x08, 0x40), (0x08, 0x06), (0x14, 0x80), (0x15, 0x10), (0x16, 0x80), (0x16, 0x05), (0x17, 0x02)]
)
def test_bits_that_only_the_lsm6dso_has(address, bit):
    for chip, said in ((Silicon(), "reserved bits"), (Silicon(chip=LSM6DSO), "not modelled")):
        link = Wire(Asm330lhh(AtRest(), silicon=chip))
        link.write(address, bit)
        (objection,) = link.sensor.objections
        assert said in objection
        assert link.read(address)[0] == (bit if "not" in said else 0)


@pytest.mark.parametrize(("silicon", "most"), [(Silicon(), 1023), (Silicon(chip=LSM6DSO), 2047)])
def test_the_counters_threshold_has_ten_bits_or_eleven(silicon, most):
    link = Wire(Asm330lhh(AtRest(), silicon=silicon))
    link.write(0x0B, 0x07)
    link.write(0x0C, 0xFF)
    assert link.sensor._flags.threshold == most


# Faults


def test_a_register_that_changes_by_itself():
    """By default the stamps' decimation goes off, as a flipped bit would have it."""
    link = started(SETTLED, 7, faults=[Fault("register", 0.1)])
    link.t_s = 0.0999
    assert len(stamps(link)) > 50
    link.t_s = 0.2
    stamps(link)
    link.wait(0.1)
    assert len(stamps(link)) == 0
    assert link.read(0x0A) == b"\x06"
    assert not link.sensor.objections


@pytest.mark.parametrize(("mask", "gone", "left"), [(0x70, GYRO, ACCEL), (0x07, ACCEL, GYRO)])
def test_a_batch_rate_that_changes_by_itself(mask, gone, left):
    link = started(SETTLED, 7, faults=[Fault("register", 0.1, address=0x09, mask=mask)])
    link.t_s = 0.11
    words(link)
    link.wait(0.1)
    table = words(link)
    assert len(data(table, gone)) == 0
    assert len(data(table, left)) == pytest.approx(0.1 * RATE_HZ, abs=4)


def test_words_at_half_the_rate_while_the_registers_read_as_set():
    link = started(SETTLED, 7, counting, faults=[Fault("rate", 0.1, 0.1)])
    counts = []
    for until_s in (0.1, 0.2, 0.3):
        link.t_s = until_s
        counts.append(words(link))
        assert link.read(0x09) == b"\x77"
    assert [round(len(data(table, GYRO)) / 83.3, 1) for table in counts[1:]] == [0.5, 1.0]
    half = counts[1]
    assert set(np.diff(data(half, GYRO)[3:-3, 0])) == {2}
    assert set(np.diff((half[half[:, 0] >> 3 == GYRO, 0] >> 1 & 3).astype(int)) % 4) == {1}  # TAG_CNT has no gap


def test_a_sensor_that_is_late_is_not_there_before():
    sensor = Asm330lhh(AtRest(), faults=[Fault("late", 0.3)])
    link = Wire(sensor)
    link.t_s = 0.2999
    assert link.read(0x0F) == b"\0"
    link.t_s = 0.3001
    assert link.read(0x0F) == b"\x6b"
    link.write(0x12, 0x05)  # a reset is as quick as ever
    link.wait(0.001)
    assert link.read(0x0F) == b"\x6b"


def test_two_false_bits_of_a_tag_leave_its_parity_even():
    faults = [Fault("tag_pair", READY_S + 0.01 * n, spared=n % 3) for n in range(28)]
    found = []
    for link in (started(SETTLED, 7), started(SETTLED, 7, faults=faults)):
        rows = []
        for _ in range(8):
            link.wait(0.04)
            rows.append(words(link))
        found.append(np.concatenate(rows))
    flipped = found[0][:, 0] ^ found[1][:, 0]
    np.testing.assert_array_equal(found[0][:, 1:], found[1][:, 1:])
    masks = flipped[flipped > 0]
    assert len(set(masks)) == len(masks) == 28
    assert {int(mask).bit_count() for mask in masks} == {2}
    assert {int(tag).bit_count() % 2 for tag in found[1][:, 0]} == {0}
    assert set(found[0][flipped > 0, 0] >> 3) == {GYRO, ACCEL, TIMESTAMP}


def test_a_gyroscopes_word_that_passes_for_a_temperature():
    link = started(SETTLED, 7, faults=[Fault("tag_pair", 0.1, mask=0x11, spared=1)])
    link.t_s = 0.12
    assert list(words(link)[:, 0] >> 3).count(3) == 1


def test_a_fault_is_said_with_its_register_and_bits():
    assert Fault.parse("register@20") == Fault("register", 20.0)
    assert Fault.parse("register:09^77@20") == Fault("register", 20.0, address=0x09, mask=0x77)
    assert Fault.parse("tag_pair^18@5x2") == Fault("tag_pair", 5.0, words=2, mask=0x18)
    assert Fault.parse("rate@3+1.5") == Fault("rate", 3.0, 1.5)
    assert Fault.parse("late@.3") == Fault("late", 0.3)


def test_every_kind_of_fault_is_named_in_the_help_and_on_the_page():
    parser = argparse.ArgumentParser()
    command.add_board_arguments(parser)
    page = (ROOT / "docs" / "emulated-board.md").read_text()
    for kind in KINDS:
        assert re.search(rf"\b{kind}\b", parser.format_help())
        assert f"`{kind}`" in page


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("register:0F@3", "0x0F is no register that can be written"),
        ("hang^10@3", "bits are of register and tag_pair only"),
        ("hang:0A@3", "an address is of register only"),
        ("tag_pair^07@3", "0x07 is not two bits"),
        ("register@.", "expected KIND@S"),
        ("register@1.2.3", "expected KIND@S"),
    ],
)
def test_a_fault_that_cannot_be_is_refused(text, said):
    with pytest.raises(ValueError, match=said):
        Fault.parse(text)
