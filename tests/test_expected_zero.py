"""The variance of the zero between a session and another time, cause by cause."""

import numpy as np
import pytest
from noise_records import axis, figures, sensor

from session.io.units import DEG
from tinygc.closure.floor import BiasInstability, wander_covariance
from tinygc.estimation.expected_zero import END_S, USUAL_PER_K, USUAL_SPREAD, expected_zero, wander_variance
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


def test_within_one_switch_on_the_zero_only_wanders():
    drift = BiasInstability(2e-5, "given")
    found = expected_zero(FIT, elapsed_s=600.0, switched_on_since=False, instability=drift)
    w = wander_covariance(np.array([0.0, 600.0]), instability_rps=2e-5)
    assert found.parts["wander"] == pytest.approx(np.eye(3) * (2 * w[0, 0] - 2 * w[0, 1]), rel=1e-12)
    assert "switch-on" not in found.parts


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
