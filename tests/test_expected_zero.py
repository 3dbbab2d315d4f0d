"""The variance of the zero between a session and another time, cause by cause."""

import numpy as np
import pytest
from noise_records import axis, figures, sensor

from session.io.units import DEG
from tinygc.closure.floor import TIMES_S, BiasInstability, wander_covariance
from tinygc.estimation.expected_zero import END_S, USUAL_PER_K, USUAL_SPREAD, drift_between, expected_zero, wander_variance
from tinygc.estimation.repeatability import BiasRepeatability

FIT = np.diag([1.0, 4.0, 9.0]) * 1e-10


def test_each_session_is_one_draw_of_the_spread():
    spread = BiasRepeatability(np.array([1.0, 2.0, 3.0]) * 1e-4, "measured")
    found = expected_zero(FIT, repeatability=spread)
    assert found.covariance == pytest.approx(FIT + np.diag(2 * spread.rps**2), rel=1e-12)
    assert found.assumed == ()


def test_an_unknown_spread_is_the_usual_one_and_said():
    found = expected_zero(FIT)
    assert found.parts["switch-on"] == pytest.approx(2 * np.diag(USUAL_SPREAD.rps**2), rel=1e-12)
    assert found.assumed == ("switch-on",)


def test_within_one_switch_on_the_zero_walks_and_the_flicker_of_the_session_is_in_the_fit():
    noise = figures(sensor(axis(K=1e-6, B=2e-5)))
    found = expected_zero(FIT, elapsed_s=600.0, switched_on_since=False, figures=noise)
    assert found.parts["wander"] == pytest.approx(np.eye(3) * 1e-12 * 600.0, rel=1e-12)
    assert set(expected_zero(FIT, elapsed_s=600.0, switched_on_since=False).parts) == {"calibration"}


def test_the_flicker_between_two_moments_is_twice_its_variance_less_its_covariance():
    w = wander_covariance(np.array([0.0, 600.0]), instability_rps=2e-5)
    found = wander_variance(600.0, None, BiasInstability(2e-5, "given"))
    assert found == pytest.approx(np.full(3, 2 * w[0, 0] - 2 * w[0, 1]), rel=1e-12)


def test_the_drift_between_two_means_by_simulated_octaves():
    """Gauss-Markov octaves of flicker noise, step by step: means over a session of two pieces and over a use."""
    rng, rps, dt, count = np.random.default_rng(3), 2e-5, 0.25, 4000
    means = np.zeros((2, count))
    for time in TIMES_S:
        state, sums = rng.normal(size=count), np.zeros((2, count))
        for k in range(200):  # 50 s: pieces of 10 s at 5 and 20 s, the use over the last 10 s
            sums[0] += state * (k < 40 or 60 <= k < 100) / 80
            sums[1] += state * (k >= 160) / 40
            state = state * np.exp(-dt / time) + np.sqrt(-np.expm1(-2 * dt / time)) * rng.normal(size=count)
        means += rps * np.sqrt(np.log(2) / np.pi) * sums
    found = drift_between(np.array([5.0, 20.0]), np.array([10.0, 10.0]), 45.0, 10.0, rps)
    drawn = np.cov(means)
    assert drawn[0, 0] == pytest.approx(found.session, rel=0.08)
    assert drawn[1, 1] == pytest.approx(found.use, rel=0.08)
    assert found.change == pytest.approx(np.var(means[1] - means[0]), rel=0.08)
    assert found.correlation == pytest.approx(np.corrcoef(means)[0, 1], abs=0.03)
    assert drift_between(np.zeros(1), np.zeros(1), 1e9, 0.0, rps).both == pytest.approx(0.0, abs=1e-30)


def test_temperature_counts_once_per_kelvin():
    found = expected_zero(FIT, warmer_k=-3.0)
    assert found.parts["temperature"] == pytest.approx(np.eye(3) * (3 * USUAL_PER_K) ** 2, rel=1e-12)
    own = expected_zero(FIT, warmer_k=2.0, per_k=np.array([1.0, 2.0, 3.0]) * 1e-3 * DEG)
    assert own.parts["temperature"] == pytest.approx(np.diag((np.array([2.0, 4.0, 6.0]) * 1e-3 * DEG) ** 2), rel=1e-12)
    assert own.assumed == ("switch-on",)
    assert "temperature" not in expected_zero(FIT, warmer_k=0.0).parts


def test_a_random_walk_grows_with_the_time_and_a_gauss_markov_saturates():
    noise = figures(sensor(axis(K=1e-6, G=2e-5, tau_s=100.0)))
    assert wander_variance(1e4, noise, None) == pytest.approx(np.full(3, 1e-12 * 1e4 + 2 * 4e-10 * -np.expm1(-100.0)), rel=1e-12)
    assert wander_variance(1e9, noise, None) == pytest.approx(wander_variance(END_S, noise, None), rel=1e-12)
    assert wander_variance(-1.0, noise, None) == pytest.approx(np.zeros(3))
