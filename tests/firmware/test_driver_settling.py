"""Which slots behind a start are no samples, by ST's own table; and what the driver says meanwhile."""

from __future__ import annotations

import ctypes

import numpy as np
import pytest
from driver_under_test import RATES_HZ, faults, library, number, period_of, poll, push, registers_of, started, warmth, words_of

#: samples to discard at 12.5, 26, 52, 104, 208, 416, 833 Hz: ST's Linux driver st_asm330lhhx
GYRO = (2 + 1, 3 + 2, 3 + 4, 3 + 7, 3 + 15, 3 + 30, 3 + 58)
LPF1 = {
    0: (0, 0, 0, 0, 0, 2, 3),
    1: (0, 0, 0, 0, 1, 2, 4),
    2: (0, 0, 0, 1, 1, 3, 5),
    3: (0, 0, 0, 0, 0, 1, 2),
    4: (0, 0, 1, 1, 2, 4, 9),
    5: (0, 1, 1, 2, 4, 9, 18),
    6: (0, 1, 2, 3, 6, 12, 24),
    7: (1, 2, 3, 6, 12, 24, 48),
    0xFF: (0,) * 7,
}
LPF2 = {2: 0, 4: 0, 10: 10, 20: 19, 45: 38, 100: 75, 200: 150, 400: 296, 800: 595}


def unsettled(odr: int, lpf1: int = 0xFF, lpf2: int = 2, fine: int = 0) -> int:
    return library().unsettled(odr, lpf1, lpf2, fine)


@pytest.mark.parametrize("lpf1", LPF1)
def test_the_gyroscopes_slots_are_no_fewer_than_sts_and_hardly_more(lpf1):
    """Two more at most: each of the two times is rounded up, where ST rounds as it likes."""
    for odr, (start, filtered) in enumerate(zip(GYRO, LPF1[lpf1], strict=True), 1):
        assert start + filtered <= unsettled(odr, lpf1) <= start + filtered + 2


@pytest.mark.parametrize("lpf1", LPF1)
def test_above_833_hz_the_time_stays_and_the_slots_double(lpf1):
    for odr in range(7, 10):
        assert unsettled(odr + 1, lpf1) == pytest.approx(2 * unsettled(odr, lpf1) - 3, abs=3)


@pytest.mark.parametrize("lpf2", LPF2)
def test_the_accelerometers_slots_are_sts_whatever_the_rate(lpf2):
    """The longer one of both sensors counts."""
    for odr in range(1, 11):
        assert unsettled(odr, lpf2=lpf2) == max(unsettled(odr), 2 + LPF2[lpf2])


def test_a_quicker_oscillator_needs_more_slots_for_the_same_time():
    assert unsettled(10, fine=127) / unsettled(10) == pytest.approx(1.19, abs=0.01)
    assert unsettled(10, fine=-128) / unsettled(10) == pytest.approx(0.81, abs=0.01)


def test_a_start_takes_26_ms_and_what_the_filters_need():
    """From the reset to a proved sensor whose FIFO runs: without a wait of its own, whatever the filters."""
    for lpf2 in (2, 800):
        lib = started(1, lpf2=lpf2, settles=False)
        began_us = number("now_us", ctypes.c_uint32).value
        lib.restart(500, 4, 1, 0xFF, lpf2)
        while lib.starting():
            poll(1)
        assert 22_000 <= number("now_us", ctypes.c_uint32).value - began_us <= 26_500
        assert (lib.running(), lib.has_settled()) == (1, 0)
    assert unsettled(1, lpf2=800) / RATES_HZ[0] == pytest.approx(48, abs=0.5)  # seconds


@pytest.mark.parametrize("odr", [3, 5, 8, 10])
@pytest.mark.parametrize("longer", [1.05, 1.2, 1.5, 2.0])
def test_a_sensor_whose_first_slots_are_irregular_is_late_and_not_dead(odr, longer):
    """The first 40 ms and three slots come at longer steps: its first sample waits for steps that follow, and nothing is restarted."""
    lib = started(odr, settles=False)
    settling, count = lib.unsettled(odr, 0xFF, 2, 0), 600
    early = 3 + int(0.04 * RATES_HZ[odr - 1])
    steps = np.where(np.arange(count) < early, longer, 1.0) * period_of(odr)
    ticks, found, each = np.floor(100.5 + np.cumsum(steps)).astype(np.int64), [], max(1, int(0.006 * RATES_HZ[odr - 1]))
    for place in range(0, count, each):
        words = words_of(np.arange(place, min(place + each, count)), ticks[place : place + each])
        push(np.concatenate([warmth(place), words]))
        found.append(poll(max(1, round(1e3 * each / RATES_HZ[odr - 1]))))
    found = np.concatenate(found)
    assert not faults()
    first = int(found["registers"][0, 0]) + 15000
    assert settling <= first <= max(settling, early) + 17
    np.testing.assert_array_equal(found["registers"][:, :6], registers_of(np.arange(first, first + len(found))))
    assert len(found) > count - first - 40
