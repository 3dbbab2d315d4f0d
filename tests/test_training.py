"""Training: the linear solution where the sensor is linear, better than it where the sensor is not, and the same every time."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import Turns

from session.io.errors import FitError
from session.io.units import DEG
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.least_squares import LinearEnds, StillRates, fit_least_squares
from tinygc.estimation import adamw
from tinygc.estimation.network import train_adamw, train_second_order
from tinygc.models.linear import LinearModel, bias_only
from tinygc.models.nets import CalibrationNet

MODEL = LinearModel(np.array([[1.01, 0.005, -0.004], [-0.006, 0.988, 0.003], [0.005, -0.002, 1.008]]), np.array([1.0, -0.7, 0.4]) * DEG)
NOISE_DPS, ODR_HZ = 0.005, 52.0


def recording(seed, asymmetry=0.0, count=24, turns_seed=11, model=MODEL, cubic=0.0, faster=1):
    """A chain of turns with the gyro's noise; its sensitivity differs by ± asymmetry for + and − rates, on every axis; ``cubic`` of the
    full scale is added at full scale (500 dps); the same turns may be run faster."""
    odr_hz = ODR_HZ * faster
    turns = Turns(count, seed=turns_seed, odr_hz=odr_hz, seconds=4.0 / faster)
    rng = np.random.default_rng(seed)
    felt = turns.rate + asymmetry * np.abs(turns.rate) + cubic * turns.rate**3 / (500 * DEG) ** 2
    measured = (felt - model.B) @ np.linalg.inv(model.E).T
    measured = measured + NOISE_DPS * DEG * np.sqrt(odr_hz / 2) * rng.standard_normal(measured.shape)
    batch = closure.Batch(measured, turns.dt, np.zeros_like(measured), turns.q[:-1], turns.q[1:], False)
    return batch, np.full(count, NOISE_DPS * DEG / np.sqrt(2) * 2)  # the angle random walk over 4 s


def rms(batch, model):
    return np.sqrt(np.mean(np.sum(closure.segment_residuals(batch, model(batch.rate)) ** 2, axis=-1))) * 2 / DEG


def test_where_the_sensor_is_linear_it_finds_least_squares():
    """With the bend tied down: the same minimum of the same loss."""
    batch, sigma = recording(0)
    trained = train_second_order(batch, sigma, ties=(0.0,))
    linear = fit_least_squares(batch, sigma, bias_only()).model
    expected = linear(batch.rate)
    assert trained.tie == 0
    np.testing.assert_allclose(trained.net(batch.rate), expected, atol=2e-5 * np.abs(expected).max())
    assert rms(batch, trained.net) == pytest.approx(rms(batch, linear), rel=1e-3)


def test_what_is_known_of_where_it_begins_need_not_be_found_again():
    """From the linear solution, whose residuals and columns between other references follow from those between the first ones."""
    batch, sigma = recording(3)
    net = CalibrationNet.from_linear(fit_least_squares(batch, sigma, bias_only()).model)
    ends, some = LinearEnds.of(net, batch, net.columns), np.arange(len(batch)) % 3 > 0
    turned = rotation.exp(np.random.default_rng(5).normal(size=(2, int(some.sum()), 3)) * 0.01 * DEG)
    other = batch.pick(some)
    other = replace(other, start=rotation.multiply(turned[0], other.start), end=rotation.multiply(turned[1], other.end))
    known, found = (train_second_order(other, sigma[some], begin=net, **more) for more in ({"begins": ends.rows(other, some)}, {}))
    assert known.tie == found.tie
    np.testing.assert_allclose(known.net.vector, found.net.vector, atol=1e-9)
    np.testing.assert_allclose(known.loss, found.loss, rtol=1e-9)


@pytest.mark.broad
def test_an_asymmetry_of_scale_is_learnt_and_least_squares_cannot():
    """0.3 % between + and − turns, judged on turns that neither fit has seen: near the noise, where the linear model is far above."""
    batch, sigma = recording(0, asymmetry=0.003, count=40)
    fresh, fresh_sigma = recording(1, asymmetry=0.003, count=40, turns_seed=12)
    trained, linear = train_second_order(batch, sigma), fit_least_squares(batch, sigma, bias_only()).model
    assert trained.tie > 0
    floor = np.sqrt(2) * fresh_sigma[0] / DEG
    assert rms(fresh, linear) > 3 * floor
    assert rms(fresh, trained.net) < 0.5 * rms(fresh, linear)
    # What it has learnt is the asymmetry: sensitivities of + and − rates about each axis.
    for axis in range(3):
        plus, minus = np.zeros((2, 3))
        plus[axis], minus[axis] = 1.5, -1.5
        zero = trained.net(np.zeros(3))[axis]
        half_difference = ((trained.net(plus)[axis] - zero) + (trained.net(minus)[axis] - zero)) / 2 / 1.5
        # omega = E m + B is what the net should undo: |omega| k is to be taken off.
        assert half_difference == pytest.approx(-0.003, abs=0.0015)


@pytest.mark.broad
def test_same_data_same_numbers(monkeypatch):
    monkeypatch.setattr(adamw, "EPOCHS", 5)
    batch, sigma = recording(3)
    first, second = train_second_order(batch, sigma), train_second_order(batch, sigma)
    np.testing.assert_array_equal(first.net.vector, second.net.vector)
    assert first.loss == second.loss
    first, second = (train_adamw(batch, sigma) for _ in range(2))
    np.testing.assert_array_equal(first.net.vector, second.net.vector)


@pytest.mark.broad
def test_still_rates_pin_the_rate_at_rest(monkeypatch):
    """With few segments the bias is loose; the stills' rates fix it, for both optimisers."""
    batch, sigma = recording(5, count=8)
    earth = np.zeros((9, 3))
    at_rest = np.tile(-np.linalg.inv(MODEL.E) @ MODEL.B, (9, 1))
    rates = StillRates(at_rest, earth, np.full((9, 3), 1e-6))
    second = train_second_order(batch, sigma, still_rates=rates, ties=(0.0,)).net
    np.testing.assert_allclose(second(at_rest), 0, atol=2e-6)
    monkeypatch.setattr(adamw, "EPOCHS", 30)
    first = train_adamw(batch, sigma, still_rates=rates)
    assert first.loss[-1] < first.loss[0]


def test_rates_that_are_not_finite_are_refused():
    batch, sigma = recording(6, count=8)
    batch.rate[2, 5, 1] = np.inf
    for train in (train_second_order, train_adamw):
        with np.errstate(invalid="ignore", over="ignore"), pytest.raises(FitError, match="finite"):
            train(batch, sigma)
