"""What all axes have in common: gravity during the turns tells it, and the gauge of skews and lags."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter
from simulated_twins import LEVER_M, late, make_twin_of

from tinygc.effects import AppliedEffect, catalogue
from tinygc.noise.channels import in_gauge
from tinygc.noise.refit import refit
from tinygc.noise.turn_gravity import turn_gravity

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")


# Gravity during the turns


@pytest.mark.broad
def test_gravity_during_the_turns_tells_the_lever_arm(twin_of):
    twin, whiten = twin_of()
    gravity = turn_gravity(twin, refit(twin, whiten, [], twin.start()))
    np.testing.assert_allclose(gravity.lever_m, LEVER_M, atol=5e-4)
    assert gravity.after_mps2 < 0.1 * gravity.before_mps2
    assert not gravity.is_offset


@pytest.mark.broad
@pytest.mark.parametrize("seconds", [0.015, -0.02])
def test_gravity_during_the_turns_tells_a_late_gyro(twin_of, seconds):
    """Beyond the delay of the sensors' filters, which the same session has without it."""
    plain, plain_whiten = twin_of()
    twin, whiten = twin_of(lambda t, rate, force, temp: late(t, rate, [seconds] * 3))
    before = turn_gravity(plain, refit(plain, plain_whiten, [], plain.start()))
    gravity = turn_gravity(twin, refit(twin, whiten, [], twin.start()))
    assert gravity.offset_s - before.offset_s == pytest.approx(seconds, abs=2e-4)
    assert gravity.is_offset
    np.testing.assert_allclose(gravity.lever_m, LEVER_M, atol=1e-3)


# Conventions


def skewed(t_s, rate, force, temp_c):
    return late(t_s, rate, (0.006, 0.0, 0.012))


def lagging(t_s, rate, force, temp_c):
    """Euler's first-order filter on the fine grid, which is some 80 times finer than the shortest lag."""
    step = t_s[1] - t_s[0]
    share = 1 - np.exp(-step / np.array([0.004, 0.012, 0.008]))
    return np.stack([lfilter([k], [1, k - 1], rate[:, i], zi=[rate[0, i] * (1 - k)])[0] for i, k in enumerate(share)], axis=-1)


@pytest.mark.broad
def test_skew_is_counted_from_the_earliest_axis(twin_of):
    twin, whiten = twin_of(skewed, segments=16)
    fit = refit(twin, whiten, [catalogue()["timing.axis_skew"]], twin.start())
    (claim,) = in_gauge(twin, whiten, fit).state.claims
    assert claim.theta.min() == 0
    np.testing.assert_allclose(claim.theta, (0.006, 0.0, 0.012), atol=2e-4)
    np.testing.assert_allclose(np.diff(claim.theta), np.diff(fit.state.claims[0].theta), atol=1e-12)


def test_the_gauge_costs_nothing(twin_of):
    twin, whiten = twin_of(skewed, segments=16)
    fit = refit(twin, whiten, [catalogue()["timing.axis_skew"]], twin.start())
    moved = in_gauge(twin, whiten, fit)
    assert moved.r @ moved.r == pytest.approx(fit.r @ fit.r, abs=4)
    np.testing.assert_array_equal(moved.state.vector[:15], fit.state.vector[:15])


@pytest.mark.broad
def test_a_lag_is_never_negative(twin_of):
    """Axes that are late by different delays, fitted as lags: what they share has either sign as far as the closure goes."""
    twin, whiten = twin_of(skewed, segments=16)
    effect = catalogue()["gyro.bandwidth"]
    for begin in (-0.006, 0.006):
        start = replace(twin.start(), claims=(AppliedEffect(effect, np.full(3, begin)),))
        (claim,) = in_gauge(twin, whiten, refit(twin, whiten, [effect], start)).state.claims
        assert claim.theta.min() >= 0
        assert not turn_gravity(twin, in_gauge(twin, whiten, refit(twin, whiten, [effect], start))).is_offset


@pytest.mark.broad
def test_a_lag_is_found_from_zero(twin_of):
    """From a start at zero half of all searches ended at negative lags, with some 80 more of chi-square."""
    twin, whiten = twin_of(lagging, segments=16)
    effect = catalogue()["gyro.bandwidth"]
    fit = refit(twin, whiten, [effect], twin.start())
    sigma = np.sqrt(np.diag(fit.theta_covariance(0)))
    theta = fit.state.claims[0].theta
    assert (np.abs(theta - (0.004, 0.012, 0.008)) < 4 * sigma).all(), (theta, sigma)
    assert stats.chi2.cdf(fit.chi_square, len(fit.r) - 15) < 0.999


@pytest.mark.broad
def test_what_all_axes_share_of_a_lag_is_taken_from_gravity(twin_of):
    twin, whiten = twin_of(lambda t, w, f, T: w + np.gradient(w, t, axis=0) @ CROSS.T, segments=16)
    fit = refit(twin, whiten, [catalogue()["gyro.angular_acceleration"]], twin.start())
    moved = in_gauge(twin, whiten, fit)
    matrix, sigma = moved.state.claims[0].theta.reshape(3, 3), np.sqrt(np.diag(moved.theta_covariance(0))).reshape(3, 3)
    assert (np.abs(matrix - CROSS) < 4 * sigma).all(), (matrix, sigma)
    off = ~np.eye(3, dtype=bool)
    assert sigma[off].max() < 1e-4  # the closure knows these
    assert sigma[~off].min() > 5e-4  # and not these: half a sample of the filters' own delay


CROSS = np.array([[0.004, 0.002, -0.002], [0.001, 0.006, 0.0008], [0.0007, 0.0006, 0.005]])
