"""The true data rate and what is missing, from stamps that are incomplete, coarse or late."""

import numpy as np
import pytest

from session.bench.live import StreamHealth
from session.io.pace import pace_of
from session.io.samples import Samples

ODR_HZ = 209.56


def stamps(odr_hz: float, seconds: float = 60.0, tick_ns: int = 1000, lost: float = 0.0, late_s: float = 0.0):
    """Stamps ns of an even clock in ticks, some of them lost by chance, and how many were lost."""
    rng = np.random.default_rng(3)
    t_s = 0.0137 + np.arange(round(seconds * odr_hz)) / odr_hz
    t_s += late_s * np.clip(rng.standard_normal(len(t_s)), -2, 2)
    kept = rng.random(len(t_s)) >= lost
    kept[[0, -1]] = True
    return (t_s[kept] * 1e9 // tick_ns).astype(np.int64) * tick_ns, int(np.count_nonzero(~kept))


@pytest.mark.parametrize("lost", [0.005, 0.1])
@pytest.mark.parametrize("tick_ns", [1000, 1_000_000])
def test_lost_samples_change_neither_rate_nor_count(lost, tick_ns):
    """Of 1 ms stamps at 209.56 Hz the median step is 5 ms, and the period 4.77."""
    t_ns, missing = stamps(ODR_HZ, tick_ns=tick_ns, lost=lost)
    pace = pace_of(t_ns)
    assert pace.rate_hz == pytest.approx(ODR_HZ, rel=1e-4)
    assert pace.missing(np.diff(t_ns) * 1e-9) == missing


def test_a_burst_that_is_lost_counts_with_the_rest():
    t_ns, _ = stamps(ODR_HZ)
    t_ns = np.delete(t_ns, np.r_[100:900, 5000])
    pace = pace_of(t_ns)
    assert pace.rate_hz == pytest.approx(ODR_HZ, rel=1e-6)
    assert pace.missing(np.diff(t_ns) * 1e-9) == 801


@pytest.mark.parametrize("odr_hz", [417.0, 950.0])
def test_a_clock_hardly_finer_than_the_samples_loses_none(odr_hz):
    """Steps of 1 and 2 ms at 833 Hz are all one period."""
    t_ns, _ = stamps(odr_hz, tick_ns=1_000_000, late_s=20e-6)
    pace = pace_of(t_ns)
    assert pace.rate_hz == pytest.approx(odr_hz, rel=1e-3)
    assert pace.missing(np.diff(t_ns) * 1e-9) == 0


@pytest.mark.parametrize("late", [0.05, 0.2])
def test_late_stamps_are_no_lost_samples(late):
    t_ns, _ = stamps(ODR_HZ, late_s=late / ODR_HZ)
    pace = pace_of(t_ns)
    assert pace.rate_hz == pytest.approx(ODR_HZ, rel=1e-3)
    assert pace.missing(np.diff(t_ns) * 1e-9) <= 2


def test_health_counts_single_losses_in_portions():
    t_ns, missing = stamps(ODR_HZ, lost=0.01)
    health, pace = StreamHealth(), pace_of(t_ns[:200])
    for first in range(0, len(t_ns), 37):
        part = t_ns[first : first + 37]
        health.feed(Samples(part, np.zeros((len(part), 3)), np.zeros((len(part), 3))), pace)
    assert health.missing == missing
    assert health.odr_hz == pytest.approx(ODR_HZ, rel=1e-5)


def test_two_steps_of_which_neither_is_near_the_middle_have_the_pace_of_the_shorter():
    """Found by fuzzing a log of four rows: the mean of no steps, a warning of NumPy's, and a rate that is no number."""
    pace = pace_of(np.array([0, 9_600_000, 9_600_000 + 38_400_000]))
    assert pace.period_s == pytest.approx(0.0096)
    assert pace.missing(np.array([0.0096, 0.0384])) == 3


@pytest.mark.parametrize(("odr_hz", "tick_ns"), [(118.7, 1_000_000), (952.0, 1_000_000), (104.3, 1000), (6.6, 100_000_000)])
def test_the_period_of_samples_is_time_over_samples_though_steps_alternate_and_one_is_a_gap(odr_hz, tick_ns):
    """118.7 Hz in whole ms has steps of 8 and 9 ms: their median says 125 Hz.  Ticks as long as a period tell a gap to one of 20 000."""
    t_ns = np.delete(np.rint(np.arange(20_000) / odr_hz * 1e9 / tick_ns).astype(np.int64) * tick_ns, np.r_[70:90])
    samples = Samples(t_ns, np.zeros((len(t_ns), 3)), np.zeros((len(t_ns), 3)))
    assert samples.period_s == pytest.approx(1 / odr_hz, rel=1e-4 if tick_ns * odr_hz > 0.5e9 else 5e-6)
    even = Samples(np.arange(1000) * 9_615_384, samples.gyro, samples.accel)
    assert even.period_s == 9_615_384 * 1e-9  # to the last bit


def test_stamps_that_stand_still_have_no_period():
    assert np.isnan(pace_of(np.zeros(5, dtype=np.int64)).period_s)
