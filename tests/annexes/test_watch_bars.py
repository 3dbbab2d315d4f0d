"""The bars of the watch's tests: run lengths against closed forms, limits and a simulation."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import chi2

from tinygc.annexes.watch.bars import bar_of, run_length, squares_bar_of, squares_run_length
from tinygc.annexes.watch.settings import SHIFTS


def siegmund(shift: float, bar: float) -> float:
    """Siegmund's closed form (1985, 2.56), L(0) ~ (exp(2 k b) - 2 k b - 1) / (2 k^2) with k = shift / 2 and b = bar / shift + 1.166."""
    b = bar / shift + 1.166
    return float((np.exp(shift * b) - shift * b - 1) / (shift**2 / 2))


@pytest.mark.parametrize("shift", [0.25, 0.5, 1.0])
def test_siegmunds_closed_form_agrees_for_small_shifts(shift):
    for length in (1e3, 1e6, 1e12, 1e100):
        assert siegmund(shift, bar_of(shift, length)) == pytest.approx(length, rel=0.03)


@pytest.mark.parametrize("shift", SHIFTS)
def test_without_a_bar_the_first_z_beyond_half_the_shift_alarms(shift):
    assert run_length(shift, 1e-9) == pytest.approx(1 / ndtr(-shift / 2), rel=1e-6)
    assert squares_run_length(2.0, 2, 1e-9) == pytest.approx(1 / chi2.sf(2 * np.log(2.0) / 0.375, 2), rel=1e-6)


def simulated(step, bar: float, seed: int) -> float:
    """Mean run length of 4000 sums."""
    rng, sums, length = np.random.default_rng(seed), np.zeros(4000), np.zeros(4000)
    alive = np.ones(4000, bool)
    while alive.any():
        length += alive
        sums = np.maximum(0, sums + step(rng))
        alive &= sums < bar
    return float(length.mean())


def test_bars_of_squares_grow_as_their_limit_does():
    low, high, far = (squares_bar_of(2.0, 2, length) for length in (1e8, 1e10, 1e100))
    assert (high - low, far - low) == pytest.approx((np.log(1e2), np.log(1e92)), abs=0.01)


def test_simulated_squares_run_as_long():
    bar = squares_bar_of(2.0, 2, 100.0)
    step = lambda rng: 0.375 * rng.chisquare(2, size=4000) - 2 * np.log(2.0)  # noqa: E731
    assert simulated(step, bar, 2) == pytest.approx(100, rel=4 / np.sqrt(4000))


@pytest.mark.parametrize("shift", SHIFTS)
def test_a_bar_keeps_lordens_bound(shift):
    """The run length is at least exp(bar)."""
    for length in (1e2, 1e5, 1e8):
        assert 0 < bar_of(shift, length) <= np.log(length)
        assert run_length(shift, bar_of(shift, length)) == pytest.approx(length, rel=1e-4)
