"""From the FIFO's words to samples: the clock, the tags, the stamps.  No sample is ever made of two time slots."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from conftest import broad
from driver_under_test import (
    ACCEL,
    CONFIGURATION,
    GYRO,
    ORDERS,
    RATES_HZ,
    STAMP,
    TEMPERATURE,
    library,
    patterns,
    registers_of,
    tag,
    take_words,
    words_of,
)

#: ticks of a period at 6667 Hz
PERIOD = 40000 / 6667
#: what it may be as well: exactly six, or to UNKNOWN what nobody expects
PERIODS = (5.9976, 5.9994, 5.9997, 6.0, 6.0003, 6.0024)
UNKNOWN = 0.0025
#: of MASKED_MOST and MASKED_LEAST
MASKED_MOST, MASKED_LEAST = 512, 8


def ticks_of(slots: np.ndarray, period: float = PERIOD, first: float = 1000.3) -> np.ndarray:
    return np.floor(first + slots * period).astype(np.int64)


def ticks_off(samples: np.ndarray, ticks: np.ndarray, exact: np.ndarray, fine: int = 0) -> np.ndarray:
    """How far the samples' time is from that of their slots, in ticks, if the first one has the middle of the tick that its stamp names."""
    steps_us = np.diff(samples["t_us"]).astype(np.int32)
    t_us = np.cumsum(np.concatenate([[0], steps_us]))
    return t_us / (25 / (1 + 0.0015 * fine)) + ticks[0] + 0.5 - exact[: len(samples)]


def test_the_true_rate_and_the_true_tick_of_all_256_values():
    """6667 (1 + 0.0015 f) / coefficient, and 25 us / (1 + 0.0015 f): to 1 ppm, where 10 are asked for."""
    for fine in range(-128, 128):
        for odr, nominal in enumerate(RATES_HZ, 1):
            true_hz = 6667 * (1 + 0.0015 * fine) / 2 ** (10 - odr)
            assert library().fifo_rate_hz(odr, fine) == pytest.approx(true_hz, rel=1e-6)
            assert true_hz == pytest.approx(nominal * (1 + 0.0015 * fine), rel=0.05)  # the coefficient is the right one
        assert library().fifo_tick_q32(fine) / 2**32 == pytest.approx(25 / (1 + 0.0015 * fine), rel=1e-9)


def test_the_codes_of_the_rates():
    for odr, nominal in enumerate(RATES_HZ, 1):
        assert library().lsm6dsx_odr(nominal) == odr
    assert [library().lsm6dsx_odr(hz) for hz in (0.0, 1.6, 300.0, 8000.0, float("nan"), float("inf"), -833.0)] == [0] * 7


@pytest.mark.parametrize("order", ORDERS)
def test_words_in_any_order_within_their_slot_become_samples(order):
    slots = np.arange(100)
    samples, faults = take_words(words_of(slots, ticks_of(slots), order))
    assert not faults
    np.testing.assert_array_equal(samples["registers"][:, :6], registers_of(slots[:-1]))  # the last slot may have more to come
    np.testing.assert_array_equal(samples["number"], 1 + slots[:-1])


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("flipped", [1, 2])
def test_whatever_bits_of_a_tag_are_turned_no_sample_is_falsified(order, flipped):
    """Every one and every two bits of each of the twelve words of four slots.  What comes out is exactly a slot, under its own number."""
    slots = np.arange(40)
    whole = words_of(slots, ticks_of(slots), order)
    masks = [mask for mask in range(1, 256) if mask.bit_count() == flipped]
    fewest = len(slots)
    for at in range(30, 42):
        for mask in masks:
            words = whole.copy()
            words[at, 0] ^= mask
            samples, faults = take_words(words)
            kept = samples["number"].astype(int) - 1
            np.testing.assert_array_equal(samples["registers"][:, :6], registers_of(kept))
            assert np.all(np.diff(samples["t_us"].astype(int)) > 0)
            assert len(samples) + faults.get("lost", 0) == len(slots) - 1
            if flipped == 1:
                assert faults["parity"] == 1
            else:
                assert len(samples) == len(slots) - 1 or faults
            fewest = min(fewest, len(samples))
    assert fewest >= len(slots) - 1 - 3


def test_lost_words_cost_their_slots_and_the_number_goes_on():
    rng = np.random.default_rng(0)
    slots = np.arange(2000)
    words = words_of(slots, ticks_of(slots))
    kept = rng.random(len(words)) > 0.02
    kept[:3] = kept[-6:] = True
    samples, faults = take_words(words[kept])
    whole = kept.reshape(-1, 3).all(axis=1)
    np.testing.assert_array_equal(samples["number"] - 1, slots[:-1][whole[:-1]])
    np.testing.assert_array_equal(samples["registers"][:, :6], registers_of(slots[:-1][whole[:-1]]))
    assert faults["lost"] == np.count_nonzero(~whole)
    assert faults["incomplete"] == np.count_nonzero(~whole & kept.reshape(-1, 3).any(axis=1))


@pytest.mark.parametrize("lost", [1, 2, 3, 5, 7, 146, 301])
def test_a_gap_of_many_slots_is_counted_by_the_stamps(lost):
    """Behind three lost slots, or seven, the next one has the same TAG_CNT as the last: nobody can tell their words apart, so both go."""
    slots = np.concatenate([np.arange(10), np.arange(10 + lost, 30 + lost)])
    samples, faults = take_words(words_of(slots, ticks_of(slots)))
    kept = np.setdiff1d(slots[:-1], [9, 10 + lost] if lost % 4 == 3 else [])
    np.testing.assert_array_equal(samples["number"] - 1, kept)
    np.testing.assert_array_equal(samples["registers"][:, :6], registers_of(kept))
    assert faults["lost"] == lost + 2 * (lost % 4 == 3)
    assert faults.get("order", 0) == (lost % 4 != 0)


def test_lost_slots_that_nothing_shows_are_never_guessed_at():
    """Four, whose TAG_CNT goes on: they cannot be told from a stamp that was spoilt.  Where parity says that words were, they count."""
    slots = np.concatenate([np.arange(10), np.arange(14, 40)])
    samples, faults = take_words(words_of(slots, ticks_of(slots)))
    assert (len(samples), faults) == (10, {"stamp": 25})
    assert library().bad_stamps() == 25  # the driver starts the sensor again at the fourth
    words = words_of(np.arange(40), ticks_of(np.arange(40)))
    words[30:42, 0] ^= 1
    samples, faults = take_words(words)
    assert faults == {"parity": 12, "lost": 4}
    np.testing.assert_array_equal(samples["number"] - 1, slots[:-1])


@pytest.mark.parametrize(("period", "fine"), [(PERIOD, 0), broad(6.0, 0), broad(6.0, 127), broad(PERIOD, -128), (PERIOD, 35)])
def test_stamps_go_on_across_the_wrap_smoothly_and_within_the_sensors_tick(period, fine):
    """200 000 samples at 6667 Hz over the wrap of the sensor's 32 bits, and, as the stamps are microseconds, of the frame's."""
    slots = np.arange(200_000)
    exact = 2**32 - 600_000 + slots * period
    samples, faults = take_words(words_of(slots, np.floor(exact).astype(np.int64)), fine=fine)
    assert not faults
    tick_us = 25 / (1 + 0.0015 * fine)
    steps = np.diff(samples["t_us"]).astype(np.int32)
    off_us = np.abs(steps - period * tick_us)
    assert off_us.max() <= tick_us + 1
    assert off_us[4000:].max() <= 2  # once the place within the tick is known: not the 25 us that the sensor's stamps jump by
    t_us = np.cumsum(np.concatenate([[0], steps]))
    off = t_us - (exact[:-1] - exact[0]) * tick_us
    assert np.ptp(off) <= tick_us + 1
    rate_hz = 1e6 * (len(t_us) - 1) / t_us[-1]
    assert rate_hz == pytest.approx(1e6 / (period * tick_us), rel=1e-6)


@pytest.mark.parametrize("odr", range(1, 11))
def test_at_every_rate_the_number_counts_periods(odr):
    slots = np.concatenate([np.arange(300), np.arange(306, 400)])
    samples, faults = take_words(words_of(slots, ticks_of(slots, PERIOD * 2 ** (10 - odr))), odr=odr)
    assert faults == {"lost": 6, "order": 1}
    np.testing.assert_array_equal(samples["number"] - 1, slots[:-1])


def test_a_stamp_that_is_wrong_costs_one_sample():
    slots = np.arange(100)
    ticks = ticks_of(slots)
    for wrong in (7, -7, 1 << 20, -(1 << 20), 1 << 31):
        spoilt = ticks.copy()
        spoilt[50] += wrong
        samples, faults = take_words(words_of(slots, spoilt))
        assert faults == {"stamp": 1, "lost": 1}
        assert library().bad_stamps() == 0
        np.testing.assert_array_equal(samples["number"] - 1, np.delete(slots[:-1], 50))


@pytest.mark.parametrize("odr", [1, 5, 10])
@pytest.mark.parametrize("ratio", PERIODS)
def test_a_stamp_that_is_wrong_by_a_few_ticks_is_a_late_one(odr, ratio):
    """It costs no sample, and moves the time by three quarters of a tick at most, and by what the period is not known."""
    slots = np.arange(100)
    exact = 1000.3 + slots * ratio * 2 ** (10 - odr)
    for place, wrong in itertools.product((1, 5, 25, 50, 90), (1, -1, 2, -2, 4, -4)):
        ticks = np.floor(exact).astype(np.int64)
        ticks[place] += wrong
        samples, faults = take_words(words_of(slots, ticks), odr=odr)
        assert not faults
        assert np.abs(ticks_off(samples, ticks, exact)).max() <= 1.04 + 0.75 + UNKNOWN * 2 ** (10 - odr)


def test_temperature_is_that_of_before_and_other_words_change_nothing():
    slots = np.arange(20)
    words = list(words_of(slots, ticks_of(slots)))
    configuration = np.array([tag(CONFIGURATION, 0), 1, 2, 3, 4, 5, 6], np.uint8)
    warm = np.array([tag(TEMPERATURE, 5), 0x34, 0x12, 0, 0, 0, 0], np.uint8)
    words[15:15] = [warm]  # the first word of slot 5
    words[3 * 8 + 1 : 3 * 8 + 1] = [configuration]  # the last one of slot 7 is before it
    words[3 * 8 + 1][0] = tag(CONFIGURATION, 7)
    samples, faults = take_words(np.array(words))
    assert not faults
    assert samples["registers"][:, 6].tolist() == [0] * 6 + [0x1234] * 13  # a slot later, when nothing contradicts it


def test_the_first_slot_need_not_be_whole():
    slots = np.arange(10)
    words = words_of(slots, ticks_of(slots), (GYRO, 2, STAMP))
    samples, faults = take_words(words[1:])
    assert not faults
    np.testing.assert_array_equal(samples["registers"][:, :6], registers_of(slots[1:-1]))


def test_a_long_gap_counts_where_the_boards_clock_or_the_next_stamp_has_seen_it_too():
    """Otherwise it is a stamp that was spoilt on its way, in any bit.  The clock stands still where a core is held."""
    slots = np.concatenate([np.arange(10), np.arange(2011, 2031)])
    ticks = ticks_of(slots)
    samples, faults = take_words(words_of(slots, ticks), made_us=np.repeat(slots * 150, 3))
    assert (len(samples), faults) == (29, {"order": 1, "lost": 2001})
    for made_us in (np.arange(3 * len(slots)) * 50, np.repeat(slots * 300, 3)):
        samples, faults = take_words(words_of(slots, ticks), made_us=made_us)
        assert faults == {"order": 1, "stamp": 1, "lost": 2002}
        np.testing.assert_array_equal(samples["number"] - 1, np.delete(slots[:-1], 10))
    slots = np.arange(40)
    ticks = ticks_of(slots)
    ticks[10] += 4 * 6 * 500
    ticks[12] += 4 * 6 * 700
    ticks[13] += 4 * 6 * 900
    samples, faults = take_words(words_of(slots, ticks))
    assert faults == {"stamp": 3, "lost": 3}
    np.testing.assert_array_equal(samples["number"] - 1, np.delete(slots[:-1], [10, 12, 13]))


def test_the_age_of_a_full_fifos_words_need_not_be_known():
    """At 12.5 Hz it has a temperature in each slot, and is read as if it had none: it seems to begin 36 periods before it does."""
    slots = np.concatenate([np.arange(10), np.arange(411, 521)])
    words = words_of(slots, ticks_of(slots, 6.0 * 512))
    made_us = np.repeat(np.concatenate([np.arange(10), 520 - np.arange(146)[109::-1] * 4 / 3]) * 76800, 3)
    samples, faults = take_words(words, odr=1, made_us=made_us)
    assert (len(samples), faults) == (119, {"lost": 401, "order": 1})


@pytest.mark.parametrize("odr", [1, 5, 8, 10])
def test_no_single_bit_of_a_stamp_can_make_a_false_one(odr):
    slots = np.arange(60)
    ticks = ticks_of(slots, PERIOD * 2 ** (10 - odr))
    whole = take_words(words_of(slots, ticks), odr=odr)[0]
    for bit in range(32):
        spoilt = ticks.copy()
        spoilt[30] ^= 1 << bit
        samples, faults = take_words(words_of(slots, spoilt), odr=odr)
        np.testing.assert_array_equal(samples["number"] - 1, np.setdiff1d(slots[:-1], [30] if faults else []))
        assert np.abs(samples["t_us"].astype(int) - whole["t_us"][samples["number"] - 1].astype(int)).max() <= 26


def absent(ratio: float, odr: int, before: int, absent_s: float, jitter: int = 0, clock: float = 1.0) -> tuple[int, int, float, bool]:
    """An absence behind so many samples: samples that are missing, by how many the number is off behind it, ticks that the time is off,
    whether a fault was counted.  clock: of the target, against the sensor's."""
    rng = np.random.default_rng(before + odr)
    period = ratio * 2 ** (10 - odr)
    gap = round(absent_s * 40000 / period)
    gap += {0: 1, 3: 2}.get(gap % 4, 0)  # or TAG_CNT does not show it, or nobody can tell the slots on either side apart
    slots = np.concatenate([np.arange(before), np.arange(before + gap, before + gap + 40)])
    exact = 1000.3 + slots * period
    late = rng.integers(-jitter, jitter + 1, len(slots))
    late[before - 1 : before + 1] = -jitter, jitter
    ticks = np.floor(exact + late).astype(np.int64)
    samples, faults = take_words(words_of(slots, ticks), odr=odr, made_us=np.repeat(np.rint(slots * period * 25 * clock), 3))
    assert set(faults) <= {"lost", "stamp", "order"}
    assert faults.get("stamp", 0) <= 1
    assert library().bad_stamps() == 0
    off = samples["number"][before - 1 :].astype(np.int64) - 1 - slots[before - 1 : -1]
    assert len(set(off[1:])) == 1
    missing = len(slots) - 1 - len(samples)
    assert faults.get("lost", 0) == samples["number"][-1] - len(samples)
    return missing, int(off[-1]), float(np.abs(ticks_off(samples, ticks, exact)).max()), "stamp" in faults


@pytest.mark.parametrize("ratio", PERIODS)
@pytest.mark.parametrize("odr", [1, broad(2), broad(3), broad(4), 5, broad(6), 7, broad(8), 9, 10])
@pytest.mark.parametrize("jitter", [0, broad(1), 2])
def test_after_an_absence_the_count_is_right_or_a_fault_says_that_it_need_not_be(ratio, odr, jitter):
    """Whatever the period is and however well it is known by then: no good sample is dropped, and the time goes on by the sensor's."""
    certain = 0
    for before, absent_s in itertools.product([2, 10, 100, 1000, 10000], [0.01, 0.1, 0.6, 1.6, 4.0, 12.0, 30.0, 100.0]):
        missing, off, ticks, fault = absent(ratio, odr, before, absent_s, jitter)
        assert missing == 0
        assert off == 0 or fault
        assert off % 4 == 0
        assert ticks <= jitter + 1.04
        certain += not fault
        period_s = ratio * 2 ** (10 - odr) / 40000
        assert not fault or absent_s > min(0.35, before * period_s)  # as long an absence as the sensor ran before is certain
    assert certain >= 12


@pytest.mark.parametrize("ratio", [5.9997, 6.0])
@pytest.mark.parametrize("clock", [0.99, 1.01])
@pytest.mark.parametrize(("hz", "absent_s"), [(6667.0, 1.6), (3333.0, 4.0), (833.0, 12.0)])
def test_after_five_seconds_such_absences_are_certain(ratio, hz, absent_s, clock):
    assert absent(ratio, RATES_HZ.index(hz) + 1, round(5 * hz), absent_s, 1, clock)[:2] == (0, 0)
    assert not absent(ratio, RATES_HZ.index(hz) + 1, round(5 * hz), absent_s, 1, clock)[3]


@pytest.mark.parametrize("ratio", [5.9997, 6.0])
def test_twelve_seconds_at_the_highest_rate_are_said_to_be_uncertain(ratio):
    """Behind five: though the most probable number is the right one where the period is what anybody expects."""
    missing, off, _, fault = absent(ratio, 10, 33335, 12.0)
    assert (missing, off, fault) == (0, 0, True)


def runs(*lengths: int) -> np.ndarray:
    """Slots that there are: so many, so many that are absent, and so on."""
    ends = np.cumsum(lengths)
    return np.concatenate([np.arange(end - length, end) for length, end in zip(lengths[::2], ends[::2], strict=True)])


@pytest.mark.parametrize(
    ("lengths", "uncertain"),
    [
        ((10_000, 6, 10_000, 16_501, 40), 0),  # what was lost on the way does not hinder learning
        ((10_000, 16_501, 40), 1),
        ((20_000, 80_001, 6_000, 20_001, 40), 1),  # behind an absence that is uncertain what was learned holds
        ((6_000, 20_001, 40), 1),
    ],
)
def test_what_is_learned_of_the_period_is_kept(lengths, uncertain):
    slots = runs(*lengths)
    ticks = np.floor(1000.3 + slots * 5.9997).astype(np.int64)
    samples, faults = take_words(words_of(slots, ticks), made_us=np.repeat(slots * 150, 3))
    assert faults.get("stamp", 0) == uncertain
    np.testing.assert_array_equal(samples["number"] - 1, slots[:-1])


def test_days_are_counted_at_the_lowest_rate():
    """Over the wrap of the sensor's 32 bits, and of the target's."""
    slots = runs(*[20, 10_001] * 400, 20)
    ticks = np.floor(1000.3 + slots * 6.0 * 512).astype(np.int64)
    samples, faults = take_words(words_of(slots, ticks), odr=1, made_us=np.repeat(slots * 76_800, 3))
    assert faults == {"order": 400, "lost": 10_001 * 400}
    np.testing.assert_array_equal(samples["number"] - 1, slots[:-1])


@pytest.mark.parametrize("ratio", PERIODS)
@pytest.mark.parametrize("odr", range(1, 11))
def test_stamps_that_come_late_cost_nothing(ratio, odr):
    """Time is off by as much as they are, and by a tick and 1 us at most as without; where they are so at random, by less."""
    slots = np.arange(4000)
    exact = 1000.3 + slots * ratio * 2 ** (10 - odr)
    for name, late in patterns(len(slots)).items():
        ticks = np.floor(exact + late).astype(np.int64)
        samples, faults = take_words(words_of(slots, ticks), odr=odr)
        assert (len(samples), faults) == (len(slots) - 1, {})
        off = ticks_off(samples, ticks, exact)
        assert np.abs(off).max() <= np.abs(late).max() + 1.04, name
        if "random" in name:
            assert np.ptp(off[2000:]) <= 1.3, name


@pytest.mark.parametrize("late", [0, 1, broad(2)])
@pytest.mark.parametrize("ratio", [broad(5.9994), 5.9997, 6.0, broad(6.0003)])
def test_time_does_not_drift_and_goes_on_evenly(ratio, late):
    slots = np.arange(200_000)
    exact = 2**32 - 600_000.3 + slots * ratio
    ticks = np.floor(exact + np.random.default_rng(1).integers(-late, late + 1, len(slots))).astype(np.int64)
    samples, faults = take_words(words_of(slots, ticks), fine=-20)
    assert not faults
    off = ticks_off(samples, ticks, exact, -20)
    assert np.abs(off).max() <= late + 1
    assert np.ptp(off[100_000:]) <= 0.2 + 0.1 * late  # once the period is known
    steps_us = np.diff(samples["t_us"]).astype(np.int32)
    uneven_us = np.abs(steps_us - ratio * 25 / (1 - 0.0015 * 20))
    assert uneven_us.max() <= 1.5
    assert uneven_us[4000:].max() <= 1.2  # whole microseconds, and next to nothing


@pytest.mark.parametrize("odr", [1, 5, 10])
@pytest.mark.parametrize("late", [1, 2])
def test_no_single_bit_of_a_late_stamp_makes_a_false_count(odr, late):
    """Nor is the time off by more than three quarters of a further tick.  It costs its sample, and the next one if that is before it."""
    rng = np.random.default_rng(5)
    slots = np.concatenate([np.arange(40), np.arange(42, 80)])
    exact = 1000.3 + slots * 6.0 * 2 ** (10 - odr)
    for bit in range(32):
        for place in (39, 40, 60):  # before and behind a gap, too
            ticks = np.floor(exact + rng.integers(-late, late + 1, len(slots))).astype(np.int64)
            ticks[place] ^= 1 << bit
            samples, faults = take_words(words_of(slots, ticks), odr=odr)
            numbers = samples["number"].astype(int) - 1
            np.testing.assert_array_equal(samples["registers"][:, :6], registers_of(numbers))
            assert len(samples) + faults.get("stamp", 0) == len(slots) - 1
            assert faults.get("stamp", 0) <= 1
            kept = np.isin(slots, numbers)
            assert np.abs(ticks_off(samples, ticks[kept], exact[kept])).max() <= late + 1.04 + 0.75


@pytest.mark.parametrize("odr", [8, 9, 10])
@pytest.mark.parametrize("ratio", [broad(5.9994), 6.0, broad(6.0003)])
@pytest.mark.parametrize("seed", [1, broad(2), broad(3)])
def test_no_single_bit_of_any_stamp_makes_a_false_number_for_good(odr, ratio, seed):
    """Each bit again and again, one stamp in some forty, whatever the stamps do otherwise: it costs its own sample at most, and the next
    one if that is before it."""
    rng = np.random.default_rng(seed)
    slots = np.arange(30_000)
    exact = 1000.3 + slots * ratio * 2 ** (10 - odr)
    spoilt = np.arange(20, len(slots) - 20, 40)
    spoilt += rng.integers(0, 20, len(spoilt))
    for name, late in patterns(len(slots), seed).items():
        ticks = np.floor(exact + late).astype(np.int64)
        ticks[spoilt] ^= 1 << rng.permutation(len(spoilt)) % 32
        samples, faults = take_words(words_of(slots, ticks), odr=odr)
        numbers = samples["number"].astype(int) - 1
        assert faults.keys() <= {"stamp", "lost"}, name
        assert np.isin(np.setdiff1d(slots[:-1], numbers), [spoilt, spoilt + 1]).all(), name
        np.testing.assert_array_equal(samples["registers"][:, :6], registers_of(numbers), err_msg=name)
        assert np.abs(ticks_off(samples, ticks[numbers], exact[numbers])).max() <= np.abs(late).max() + 1.04 + 0.75, name


@pytest.mark.parametrize("back_us", [1, 100, 2_900_000])
def test_a_target_whose_words_seem_older_than_those_before_has_seen_no_time_pass(back_us):
    """Temperatures are not counted in the age of the FIFO's words: behind an absence that may look like 71 minutes."""
    slots = runs(1000, 301, 100)
    made_us = np.repeat(slots * 150, 3)
    made_us[3000:] -= made_us[3000] - made_us[2999] + back_us
    samples, faults = take_words(words_of(slots, ticks_of(slots)), made_us=3_000_000 + made_us)
    assert (len(samples), faults) == (len(slots) - 1, {"order": 1, "lost": 301})
    take_words(words_of(np.arange(40), 6 * np.arange(40)), made_us=3_000_000 + np.arange(120) * 50)
    warm = np.insert(words_of(np.arange(40), 6 * np.arange(40)), [0, 3], [[tag(TEMPERATURE, n), 0, 0, 0, 0, 0, 0] for n in (0, 1)], axis=0)
    again, faults = take_words(warm, made_us=3_000_000 - back_us + np.arange(122) * 5, again=True)
    assert (again["number"][0], faults) == (40, {})


@pytest.mark.parametrize(("clock", "refused"), [(0.89, 1), (0.95, 0), (1.05, 0), (1.13, 1)])
def test_the_two_clocks_may_differ_by_a_sixteenth(clock, refused):
    slots = runs(33_335, 20_001, 100)
    samples, faults = take_words(words_of(slots, ticks_of(slots)), made_us=np.repeat(slots * 150 * clock, 3))
    assert faults.get("stamp", 0) == refused
    assert len(samples) == len(slots) - 1 - refused


@pytest.mark.parametrize("ratio", [5.9976, 6.0024])
def test_before_the_period_is_known_time_lags_by_a_third_of_a_tick(ratio):
    """It may be half a one.  A quicker pull would lag less, and make steps of stamps that jitter less even."""
    slots = np.arange(1500)
    exact = 1000.5 + slots * ratio
    samples, _ = take_words(words_of(slots, np.floor(exact).astype(np.int64)))
    lag = ticks_off(samples, np.floor(exact), exact)[700:].mean()
    assert abs(lag) == pytest.approx(0.0024 * 128, abs=0.06)


def test_time_follows_stamps_that_come_later_for_good():
    """Within some 4096 periods, however well the period is known by then."""
    slots = np.arange(432_000)
    late = (slots >= 400_000).astype(np.int64)
    samples, faults = take_words(words_of(slots, 1000 + 6 * slots + late))
    assert not faults
    off = ticks_off(samples, 1000 + 6 * slots, 1000.5 + 6 * slots)
    assert off[399_000] == pytest.approx(0, abs=0.05)
    assert off[-1] == pytest.approx(1, abs=0.05)


def test_behind_an_absence_the_place_within_the_tick_is_kept():
    """Where the stamp does not contradict it: it is known better than by one stamp."""
    errors = []
    for gap in range(2001, 2081, 4):
        slots = runs(10_000, gap, 4)
        exact = 1000.3 + slots * PERIOD
        samples, _ = take_words(words_of(slots, np.floor(exact).astype(np.int64)), made_us=np.repeat(slots * 150, 3))
        off = ticks_off(samples, np.floor(exact), exact)
        errors.append(off[10_000] - off[9_999])
    assert np.abs(errors).max() < 0.1


@pytest.mark.parametrize(("absent", "refused"), [(2**30 // 3072 - 20, 1), (2**30 // 3072 + 20, 59)])
def test_an_absence_of_more_than_seven_hours_is_none(absent, refused):
    """The target's clock cannot confirm it: the stamp behind the first one does."""
    slots = runs(500_000, absent + (absent % 4 == 0), 60)
    samples, faults = take_words(words_of(slots, ticks_of(slots, 6.0 * 512)), odr=1, made_us=np.repeat(slots * 76_800, 3))
    assert faults["stamp"] == refused
    np.testing.assert_array_equal(samples["number"] - 1, np.delete(slots[:-1], np.arange(500_000, 500_000 + refused)))


@pytest.mark.parametrize("before", range(3000, 9000, 250))
def test_so_long_an_absence_as_the_sensor_ran_before_is_certain(before):
    """Learning is never more than an eighth of the time behind."""
    slots = runs(before, before + 1 + 2 * (before % 4 == 2), 40)
    samples, faults = take_words(words_of(slots, ticks_of(slots)), made_us=np.repeat(slots * 150, 3))
    assert "stamp" not in faults
    np.testing.assert_array_equal(samples["number"] - 1, slots[:-1])


@pytest.mark.parametrize("first", [1000, 5 << 24, 7 << 29])
def test_a_time_that_begins_anew_is_noticed(first):
    slots = np.arange(60)
    ticks = first + slots * 6
    ticks[30:] -= ticks[30] - 3
    samples, faults = take_words(words_of(slots, ticks))
    assert (len(samples), faults) == (30, {"stamp": 29})
    assert library().bad_stamps() == 29


def test_stamps_that_stray_by_more_than_was_thought_only_cost_what_was_learned():
    """Two learned periods that exclude each other: the driver begins to learn again."""
    slots = np.arange(100_000)
    exact = 1000.3 + slots * 6
    ticks = np.floor(exact + 3.2 * np.sin(slots * (2 * np.pi / 40_000))).astype(np.int64)
    samples, faults = take_words(words_of(slots, ticks))
    assert (len(samples), faults) == (len(slots) - 1, {})
    assert np.abs(ticks_off(samples, ticks, exact)).max() <= 3.2 + 1.04


@pytest.mark.parametrize(("odr", "unsettled"), [(10, 0), (10, 470), (7, 61), (1, 600)])
def test_slots_before_the_filters_have_settled_are_no_samples(odr, unsettled):
    slots = np.arange(unsettled + 20)
    words = words_of(slots, ticks_of(slots, PERIOD * 2 ** (10 - odr)))
    samples, faults = take_words(words, odr=odr, unsettled=unsettled)
    assert not faults
    np.testing.assert_array_equal(samples["number"], 1 + np.arange(19))
    np.testing.assert_array_equal(samples["registers"][:, :6], registers_of(slots[unsettled:-1]))
    assert library().settled() == 1
    take_words(words[: 3 * unsettled + 1], odr=odr, unsettled=unsettled)  # the last of them is over, the first sample is not
    assert library().settled() == 0


@pytest.mark.parametrize("mask", [0x7FFD, 0x7FFE, 0x7FFF])
@pytest.mark.parametrize("axis", range(6))
def test_masked_values_are_no_samples_before_the_first_one_and_clipped_ones_behind_it(mask, axis):
    slots = np.arange(60)
    words = words_of(slots, ticks_of(slots))
    place = 1 + 2 * (axis % 3)
    masked = np.concatenate([np.arange(5, 17), [30, 31]])
    words[3 * masked + axis // 3, place : place + 2] = mask & 0xFF, mask >> 8
    samples, faults = take_words(words, unsettled=5)
    assert not faults
    np.testing.assert_array_equal(samples["number"], 1 + np.arange(42))
    expected = registers_of(slots[17:-1])
    expected[[13, 14], axis] = mask
    np.testing.assert_array_equal(samples["registers"][:, :6], expected)


@pytest.mark.parametrize("first", [0, 3])
def test_masked_slots_are_not_counted_among_the_unsettled(first):
    """As ST's own driver does it: what comes behind them may be masked no more, and not have settled."""
    slots = np.arange(100)
    words = words_of(slots, ticks_of(slots))
    words[3 * np.arange(first, 20), 1:3] = 0xFD, 0x7F
    samples, faults = take_words(words, unsettled=30)
    assert not faults
    np.testing.assert_array_equal(samples["registers"][:, :6], registers_of(slots[50 - first : -1]))


@pytest.mark.parametrize("odr", range(1, 11))
def test_what_stays_masked_is_clipped(odr):
    """A sensor that is turned too fast from the start on is not waited for for ever: 77 ms at 6667 Hz, 0.7 s at 12.5."""
    slots = np.arange(700)
    words = words_of(slots, ticks_of(slots, PERIOD * 2 ** (10 - odr)))
    words[::3, 1:3] = 0xFF, 0x7F
    samples, faults = take_words(words, odr=odr, unsettled=10)
    most = MASKED_LEAST + (MASKED_MOST - MASKED_LEAST) // 2 ** (10 - odr)
    assert not faults
    assert (len(samples), samples["number"][0]) == (699 - 10 - most, 1)
    assert (samples["registers"][:, 0] == 0x7FFF).all()


def test_gaps_and_bad_stamps_before_the_first_sample_are_counted_but_nothing_is_lost():
    slots = np.concatenate([np.arange(10), np.arange(16, 60)])
    ticks = ticks_of(slots)
    ticks[20] += 1000
    samples, faults = take_words(words_of(slots, ticks), unsettled=30)
    assert faults == {"order": 1, "stamp": 1}
    np.testing.assert_array_equal(samples["number"], 1 + np.arange(23))


def test_behind_a_restart_number_and_time_go_on_by_the_targets_clock():
    """Slots of before the filters settled, and of before the first temperature, are periods without a sample, as the absence is."""
    slots = np.arange(100)
    warm = np.array([[tag(TEMPERATURE, 0), 0x34, 0x12, 0, 0, 0, 0]], np.uint8)
    made_us = np.repeat(slots * 150, 3)
    ticks = slots * 6 + 7777
    ticks[98:] += 2  # a late one is the last before, and an early one the first behind it: neither the time's
    before, _ = take_words(words_of(slots, ticks), made_us=made_us)
    ticks = slots * 6 + 11
    ticks[41] -= 2
    again = np.insert(words_of(slots, ticks), 3 * 40, warm, axis=0)
    samples, faults = take_words(again, made_us=np.insert(300_000 + made_us, 3 * 40, 306_000), unsettled=30, again=True)
    assert samples["registers"][0].tolist() == [*registers_of(slots[41:42])[0], 0x1234]
    assert samples["number"][0] - before["number"][-1] == round((300_000 + 41 * 150 - 98 * 150) / 150)
    assert int(samples["t_us"][0]) - int(before["t_us"][-1]) == pytest.approx(300_000 - 57 * 150, abs=10)  # the period is not known better
    assert faults == {"lost": int(samples["number"][0] - before["number"][-1]) - 1}
    np.testing.assert_array_equal(np.diff(samples["number"]), 1)
    assert set(np.diff(samples["t_us"])) <= {149, 150, 151}
    assert int(samples["t_us"][0]) - 300_000 - 41 * 150 == pytest.approx(0, abs=20)


def test_behind_a_restart_the_period_is_learned_anew():
    slots = np.arange(20_000)
    take_words(words_of(slots, slots * 12), odr=9)
    exact = 7.3 + slots * 5.9993 * 2
    words = words_of(slots, np.floor(exact).astype(np.int64))
    words = np.insert(words, 0, [tag(TEMPERATURE, 0), 0, 0, 0, 0, 0, 0], axis=0)
    words = np.insert(words, 4, [tag(TEMPERATURE, 1), 0, 0, 0, 0, 0, 0], axis=0)
    samples, _ = take_words(words, odr=9, again=True)
    off = ticks_off(samples, np.floor(exact[2:]), exact[2:])
    assert np.abs(off).max() <= 1.04
    assert abs(off[1000:3000].mean()) <= 0.3  # the time lags a quarter of a tick at most


def warm_words(slots: np.ndarray, order: tuple[int, ...], each: int) -> np.ndarray:
    """Words with a temperature of 100 + slot in every so-manyth slot."""
    words = words_of(slots, 1000 + 6 * slots, order).reshape(len(slots), len(order), 7)
    at = order.index(TEMPERATURE)
    words[:, at, 1:] = 0
    words[:, at, 1:3] = (100 + slots).astype("<i2").view(np.uint8).reshape(-1, 2)
    kept = np.ones(words.shape[:2], bool)
    kept[:, at] = slots % each == 0
    return words[kept]


@pytest.mark.parametrize("each", [1, 2, 7])
@pytest.mark.parametrize("order", tuple(itertools.permutations((GYRO, ACCEL, TEMPERATURE, STAMP))))
def test_no_two_bits_of_a_tag_make_a_false_temperature(order, each):
    """Nor a false sample: every two bits of the tag of every word of 28 slots, with and without a temperature."""
    masks = [mask for mask in range(1, 256) if mask.bit_count() == 2]
    block = len(warm_words(np.arange(28), order, each))
    count = 28 * (len(masks) * block + 1)
    words = warm_words(np.arange(count), order, each)
    begun = block * np.arange(1, len(masks) * block + 1)  # one fault in 28 slots, each time at another word or of other bits
    words[begun + np.tile(np.arange(block), len(masks)), 0] ^= np.repeat(np.array(masks, np.uint8), block)
    samples, faults = take_words(words)
    kept = samples["number"].astype(int) - 1
    np.testing.assert_array_equal(samples["registers"][:, :6], registers_of(kept))
    assert len(samples) >= count - 1 - 3 * len(begun)
    late = (100 + kept - samples["registers"][:, 6].astype(int)) & 0xFFFF
    warm = kept > 8
    assert np.all((kept[warm] - late[warm]) % each == 0)
    assert set(late[warm]) <= set(range(3 * each + 5))
    assert faults.get("parity", 0) == 0


@pytest.mark.slow
@pytest.mark.parametrize("odr", range(1, 11))
@pytest.mark.parametrize(("ratio", "late"), [(40000 / 6667, 0), (6.0, 1), (6.0003, 2)])
def test_a_million_samples_at_each_rate(odr, ratio, late):
    """At 12.5 Hz that is a day: nothing is lost, the numbers are the slots', and the time never strays by more than is stated."""
    slots = np.arange(1_000_001)
    period = ratio * 2 ** (10 - odr)
    exact = 2**31 + 0.3 + slots * period
    ticks = np.floor(exact).astype(np.int64) + np.random.default_rng(odr).integers(-late, late + 1, len(slots))
    words = words_of(slots, ticks)
    samples, faults = take_words(words, odr=odr, made_us=np.repeat(exact * 25, 3))
    assert not faults
    np.testing.assert_array_equal(samples["number"] - 1, slots[:-1])
    np.testing.assert_array_equal(samples["registers"][:, :6], registers_of(slots[:-1]))
    assert np.abs(ticks_off(samples, ticks, exact)).max() <= late + 1.04
