"""From the FIFO's words to samples: the clock, the tags, the stamps.  No sample is ever made of two time slots."""

from __future__ import annotations

import numpy as np
import pytest
from conftest import broad
from driver_under_test import (
    CONFIGURATION,
    GYRO,
    ORDERS,
    RATES_HZ,
    STAMP,
    TEMPERATURE,
    library,
    registers_of,
    tag,
    take_words,
    words_of,
)

#: ticks of a period at 6667 Hz
PERIOD = 40000 / 6667


def ticks_of(slots: np.ndarray, period: float = PERIOD, first: float = 1000.3) -> np.ndarray:
    return np.floor(first + slots * period).astype(np.int64)


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


@pytest.mark.parametrize("lost", [1, 2, 3, 4, 5, 146, 300])
def test_a_gap_of_many_slots_is_counted_by_the_stamps(lost):
    """Behind three lost slots, or seven, the next one has the same TAG_CNT as the last: nobody can tell their words apart, so both go."""
    slots = np.concatenate([np.arange(10), np.arange(10 + lost, 30 + lost)])
    samples, faults = take_words(words_of(slots, ticks_of(slots)))
    kept = np.setdiff1d(slots[:-1], [9, 10 + lost] if lost % 4 == 3 else [])
    np.testing.assert_array_equal(samples["number"] - 1, kept)
    np.testing.assert_array_equal(samples["registers"][:, :6], registers_of(kept))
    assert faults["lost"] == lost + 2 * (lost % 4 == 3)
    assert faults.get("order", 0) == (lost % 4 != 0)


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
    for wrong in (2, -2, 1 << 20, -(1 << 20), 1 << 31):
        spoilt = ticks.copy()
        spoilt[50] += wrong
        samples, faults = take_words(words_of(slots, spoilt))
        assert faults == {"stamp": 1, "lost": 1}
        np.testing.assert_array_equal(samples["number"] - 1, np.delete(slots[:-1], 50))


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
    assert samples["registers"][:, 6].tolist() == [0] * 5 + [0x1234] * 14


def test_the_first_slot_need_not_be_whole():
    slots = np.arange(10)
    words = words_of(slots, ticks_of(slots), (GYRO, 2, STAMP))
    samples, faults = take_words(words[1:])
    assert not faults
    np.testing.assert_array_equal(samples["registers"][:, :6], registers_of(slots[1:-1]))


def test_a_long_gap_counts_where_the_boards_clock_has_seen_it_too():
    """Otherwise it is a stamp that was spoilt on its way, in any bit."""
    slots = np.concatenate([np.arange(10), np.arange(4010, 4030)])
    words = words_of(slots, ticks_of(slots))
    samples, faults = take_words(words, word_us=50)
    assert (len(samples), faults["stamp"]) == (10, 19)
    samples, faults = take_words(words, word_us=600_000)
    assert (len(samples), faults) == (29, {"lost": 4000})


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
