"""From the FIFO's words to samples: the clock, the tags, the stamps.  No sample is ever made of two time slots."""

import itertools

import numpy as np
import pytest
from driver_under_test import (
    CONFIGURATION,
    ORDERS,
    RATES_HZ,
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


#: what it may be as well, or what nobody expects
PERIODS = (5.9976, 5.9997, 6.0024)


#: of MASKED_MOST and MASKED_LEAST
MASKED_MOST, MASKED_LEAST = 512, 8


def ticks_of(slots, period=PERIOD, first=1000.3):
    return np.floor(first + slots * period).astype(np.int64)


def ticks_off(samples, ticks, exact, fine=0):
    """How far the samples' time is from that of their slots, in ticks, if the first one has the middle of the tick that its stamp names."""
    steps_us = np.diff(samples["t_us"]).astype(np.int32)
    t_us = np.cumsum(np.concatenate([[0], steps_us]))
    return t_us / (25 / (1 + 0.0015 * fine)) + ticks[0] + 0.5 - exact[: len(samples)]


def test_the_true_rate_and_the_true_tick_of_all_256_values():
    """6667 (1 + 0.0015 f) / coefficient, and 25 us / (1 + 0.0015 f): to 1 ppm, where 10 are asked for."""
    for fine in range(-128, 128, 5):
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


@pytest.mark.parametrize(("order", "flipped"), [(ORDERS[0], 1), (ORDERS[3], 2)])
def test_whatever_bits_of_a_tag_are_turned_no_sample_is_falsified(order, flipped):
    """Every one and every two bits of each of the twelve words of four slots.  What comes out is exactly a slot, under its own number."""
    slots = np.arange(40)
    whole = words_of(slots, ticks_of(slots), order)
    masks = [mask for mask in range(1, 256) if mask.bit_count() == flipped]
    fewest = len(slots)
    for at in range(30, 42, 3 * flipped - 2):
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


def absent(ratio, odr, before, absent_s, jitter=0, clock=1.0):
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
@pytest.mark.parametrize(("odr", "jitter"), [(1, 2), (10, 0), (10, 2)])
def test_after_an_absence_the_count_is_right_or_a_fault_says_that_it_need_not_be(ratio, odr, jitter):
    """Whatever the period is and however well it is known by then: no good sample is dropped, and the time goes on by the sensor's."""
    certain = 0
    for before, absent_s in itertools.product([2, 100, 10000], [0.01, 0.1, 0.6, 4.0, 30.0, 100.0]):
        missing, off, ticks, fault = absent(ratio, odr, before, absent_s, jitter)
        assert missing == 0
        assert off == 0 or fault
        assert off % 4 == 0
        assert ticks <= jitter + 1.04
        certain += not fault
        period_s = ratio * 2 ** (10 - odr) / 40000
        assert not fault or absent_s > min(0.35, before * period_s)  # as long an absence as the sensor ran before is certain
    assert certain >= 6


@pytest.mark.parametrize(("late", "ratio"), [(0, 5.9997), (1, 6.0)])
def test_time_does_not_drift_and_goes_on_evenly(ratio, late):
    slots = np.arange(100_000)
    exact = 2**32 - 600_000.3 + slots * ratio
    ticks = np.floor(exact + np.random.default_rng(1).integers(-late, late + 1, len(slots))).astype(np.int64)
    samples, faults = take_words(words_of(slots, ticks), fine=-20)
    assert not faults
    off = ticks_off(samples, ticks, exact, -20)
    assert np.abs(off).max() <= late + 1
    assert np.ptp(off[50_000:]) <= 0.2 + 0.1 * late  # once the period is known
    steps_us = np.diff(samples["t_us"]).astype(np.int32)
    uneven_us = np.abs(steps_us - ratio * 25 / (1 - 0.0015 * 20))
    assert uneven_us.max() <= 1.5
    assert uneven_us[4000:].max() <= 1.2  # whole microseconds, and next to nothing


@pytest.mark.parametrize("odr", [8, 10])
def test_no_single_bit_of_any_stamp_makes_a_false_number_for_good(odr):
    """Each bit again and again, one stamp in some forty, whatever the stamps do otherwise: it costs its own sample at most, and the next
    one if that is before it."""
    rng = np.random.default_rng(1)
    slots = np.arange(8_000)
    exact = 1000.3 + slots * 6.0 * 2 ** (10 - odr)
    spoilt = np.arange(20, len(slots) - 20, 40)
    spoilt += rng.integers(0, 20, len(spoilt))
    for name, late in patterns(len(slots), 1).items():
        ticks = np.floor(exact + late).astype(np.int64)
        ticks[spoilt] ^= 1 << rng.permutation(len(spoilt)) % 32
        samples, faults = take_words(words_of(slots, ticks), odr=odr)
        numbers = samples["number"].astype(int) - 1
        assert faults.keys() <= {"stamp", "lost"}, name
        assert np.isin(np.setdiff1d(slots[:-1], numbers), [spoilt, spoilt + 1]).all(), name
        np.testing.assert_array_equal(samples["registers"][:, :6], registers_of(numbers), err_msg=name)
        assert np.abs(ticks_off(samples, ticks[numbers], exact[numbers])).max() <= np.abs(late).max() + 1.04 + 0.75, name


@pytest.mark.parametrize(("odr", "unsettled"), [(10, 470), (1, 600)])
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
