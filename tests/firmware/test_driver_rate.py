"""The FIFO's configuration is proved behind each burst; and where it reads as it was set, the rate that arrives is judged all the same."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from driver_under_test import (
    ACCEL,
    GYRO,
    PERIOD,
    STAMP,
    discard,
    faults,
    library,
    number,
    patterns,
    poll,
    push,
    registers_of,
    settle,
    slots,
    started,
    streamed_by_time,
    tag,
    words_of,
)

#: samples at 1667 Hz: a window of a second, and a burst
WINDOW = 1700


def kinds(words: np.ndarray) -> np.ndarray:
    return words[:, 0] >> 3


def slot_of(words: np.ndarray) -> np.ndarray:
    """The slot of each word, counted from the first: three to a slot."""
    return np.arange(len(words)) // 3


def without(kind: int, each: int):
    """Of that kind only each so many-th word is batched."""
    return lambda words: words[(kinds(words) != kind) | (slot_of(words) % each == 0)]


def halved(words: np.ndarray) -> np.ndarray:
    """Every second slot is batched, and TAG_CNT counts those: five of them in ten slots."""
    kept = words[slot_of(words) % 2 == 0].copy()
    first = int(kept[2, 1:5].copy().view("<u4")[0] / PERIOD) // 2
    kept[:, 0] = [tag(int(kind), first + place // 3) for place, kind in enumerate(kinds(kept))]
    return kept


def one_slot_for_all(words: np.ndarray) -> np.ndarray:
    words[:, 0] = [tag(int(kind), 0) for kind in kinds(words)]
    return words


@pytest.mark.parametrize(
    "change",
    [without(GYRO, 2), without(ACCEL, 2), without(GYRO, 100), without(STAMP, 100), without(STAMP, 8), halved, one_slot_for_all],
    ids=["BDR_GY halved", "BDR_XL halved", "no gyroscope", "no stamps", "each eighth stamp", "all halved", "TAG_CNT stands"],
)
def test_another_rate_than_the_registers_say_is_counted_once_and_restarted(change):
    """Within a second and a burst.  What is delivered until then is right."""
    started()
    during, place = [streamed_by_time(0, 100)], 100
    while "starts" not in faults():
        during.append(streamed_by_time(place, 10, change))
        place += 10
        assert place < WINDOW + 100
    assert place < 200 or change is not halved  # all the stamps say so
    assert (faults()["rate"], faults()["starts"]) == (1, 1)
    assert not {"silent", "changed", "overrun", "parity", "tag"} & faults().keys()
    delivered = np.concatenate(during)
    np.testing.assert_array_equal(delivered["registers"][:, :6], registers_of(delivered["number"] - delivered["number"][0]))
    poll(25)
    settle()
    assert len(streamed_by_time(0, 100)) > 80


@pytest.mark.parametrize(
    "change",
    [without(GYRO, 2), without(ACCEL, 100), without(STAMP, 100), halved, one_slot_for_all],
    ids=["BDR_GY halved", "no accelerometer", "no stamps", "all halved", "TAG_CNT stands"],
)
def test_another_rate_from_the_start_on(change):
    """The filters may seem never to settle: that is said within a second and twice the time that they take."""
    started(settles=False)
    delivered, place = [], 0
    while "starts" not in faults():
        delivered.append(streamed_by_time(place, 10, change))
        place += 10
        assert place < WINDOW + 2 * 150
    assert (faults()["rate"], faults()["starts"]) == (1, 1)
    found = np.concatenate(delivered)
    steps = np.diff(found["registers"][:, 0].astype(int))
    np.testing.assert_array_equal(steps, np.diff(found["number"].astype(int)))


@pytest.mark.parametrize(("milliseconds", "wrong"), [(27, True), (29, False), (31, False), (33, True)])
def test_the_sensors_clock_against_the_targets(milliseconds, wrong):
    """50 slots take 30 ms: a tenth off is no rate that was set, 3 % are a target's RC oscillator at its worst."""
    started()
    for place in range(0, 2 * WINDOW, 50):
        push(slots(place, 50))
        poll(milliseconds)
    assert ("rate" in faults()) == wrong


@pytest.mark.parametrize("share", [0.05, 0.3])
def test_words_that_another_fault_explains_are_no_other_rate(share):
    """A line that spoils tags: parity says so."""
    rng = np.random.default_rng(7)

    def spoil(words: np.ndarray) -> np.ndarray:
        words[rng.random(len(words)) < share, 0] ^= 1
        return words

    started()
    streamed_by_time(0, 2 * WINDOW, spoil)
    assert faults()["parity"] > 2 * share * WINDOW
    assert "rate" not in faults()
    assert library().running()


def test_a_stamp_that_is_spoilt_at_any_place_is_no_other_rate():
    """Also the first and the last of a window."""
    for spoilt in range(0, 20):
        started()

        def spoil(words: np.ndarray, spoilt: int = spoilt) -> np.ndarray:
            words[3 * (spoilt // 2) + 2, 4] ^= 0x40 if spoilt % 2 else 0
            return words

        streamed_by_time(0, 10, spoil)
        streamed_by_time(10, WINDOW - 40)
        for place in range(WINDOW - 30, WINDOW + 30, 10):
            streamed_by_time(place, 10, spoil)
        assert "rate" not in faults()
        assert library().running()


def test_a_target_that_comes_late_is_no_other_rate():
    """The FIFO runs over again and again: that is said, and is all."""
    started()
    now_us = number("now_us", ctypes.c_uint32)
    streamed_by_time(0, 700)
    for place in range(1700, 8 * 1700 + 1, 1700):
        discard()
        now_us.value += 600_000
        number("overrun").value = 1
        push(slots(place, 30))
        poll(18)
        streamed_by_time(place + 30, 670)
    assert faults()["overrun"] == 8
    assert faults().keys() == {"overrun", "lost"}


def test_no_stamps_behind_a_gap_are_another_rate():
    """No window begins there; 64 slots without one are enough."""
    started()
    streamed_by_time(0, 100)
    number("overrun").value = 1
    streamed_by_time(200, 120, lambda words: words[kinds(words) != STAMP])
    assert (faults()["rate"], faults()["starts"]) == (1, 1)


@pytest.mark.parametrize("odr", [8, 9, 10])
@pytest.mark.parametrize("ratio", [5.9976, 40000 / 6667, 6.0, 6.0024])
def test_late_stamps_cost_nothing_in_the_whole_driver(odr, ratio):
    """At 6667 Hz two ticks either way are a third of a period, and a step of 2 or 10 ticks is none that is odd."""
    count = 4000
    for name, late in patterns(count).items():
        started(odr)
        numbers = np.arange(count)
        words = words_of(numbers, np.floor(100.5 + numbers * ratio * 2 ** (10 - odr) + late).astype(np.int64))
        each, found = 10 * 2 ** (odr - 8), []
        for place in range(0, 3 * count, 3 * each):
            push(words[place : place + 3 * each])
            found.append(poll(6))
        delivered = np.concatenate(found)
        assert not faults(), name
        assert len(delivered) >= count - 96
        np.testing.assert_array_equal(delivered["registers"][:, :6], registers_of(np.arange(len(delivered))), err_msg=name)


def test_twice_the_period_is_odd_at_the_highest_rate():
    """A step of 12 ticks is one more off than jitter can make it: that is said within 40 slots, not in a window's second."""
    started(10)
    numbers = np.arange(400)
    words = words_of(numbers, 100 + 12 * numbers)
    for place in range(0, 1200, 60):
        push(words[place : place + 60])
        poll(6)
        if "rate" in faults():
            break
    assert (faults()["rate"], place <= 3 * 100) == (1, True)
