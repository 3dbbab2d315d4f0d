"""Sessions at several temperatures, and rest logs, in one model: E(T) and b(T), and how true their sigmas are."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import DEG, Table, session_of
from rest_logs import rest_log

from session.io.errors import FitError
from tinygc.annexes.temperature.model import ThermalModel
from tinygc.annexes.temperature.rest_fit import fit_rests
from tinygc.annexes.temperature.sessions_fit import SessionPoint, join, joined, of_rests_alone, parameter_names, point_of, zero_form
from tinygc.models.linear import LinearModel

RNG = np.random.default_rng(4)
E0, E1 = np.eye(3) + 0.01 * RNG.normal(size=(3, 3)), np.diag([60e-6, -30e-6, 100e-6])
SIGN = np.array([1.0, -1.0, 1.0])
#: of rest_log about 30 degC: 0.03 dps/degC and 2e-4 dps/degC^2 with the signs +, -, +
ZERO = np.array([[0.5, -0.3, 0.6], 0.03 * SIGN, 2e-4 * SIGN]) * DEG
TRUTH = ThermalModel(np.stack([E0, E1]), ZERO, np.zeros(3), 30.0, (-40.0, 105.0))
#: a root of a session's covariance: 50 ppm and 1 mdps, correlated
ROOT = np.diag([5e-5] * 9 + [1e-3 * DEG] * 3) @ (np.eye(12) + 0.2 * np.tril(RNG.normal(size=(12, 12)), -1))


def drawn_point(celsius, rng, truth=TRUTH, turn_on_dps=0.0):
    """A session as its fit would give it, without the fit."""
    there = truth.at(celsius)
    values = np.concatenate([there.E.ravel(), truth.zero(np.full((1, 3), celsius))[0]]) + ROOT @ rng.normal(size=12)
    values[9:] += turn_on_dps * DEG * rng.normal(size=3)
    return SessionPoint(f"T{celsius}", celsius, celsius - 1, celsius + 1, values, ROOT @ ROOT.T, 20)


@pytest.fixture(scope="module")
def rests():
    return fit_rests([(rest_log(11, cold_c=-10.0, warm_c=70.0), None)], with_accel=False)


def recorded(celsius, seed, warm_c=3.0):
    """A session that warms up while it is turned; its readings by the truth's own formula."""
    samples = Table().tumble(16, seed=seed).samples(seed=seed, bias_dps=(0, 0, 0), registers=False)
    temp = celsius + warm_c * (1 - np.exp(-samples.t_s / 40))
    gyro = np.einsum("nij,nj->ni", np.linalg.inv(TRUTH.E(temp)), samples.gyro) + TRUTH.zero(np.column_stack([temp] * 3))
    return replace(session_of(replace(samples, gyro=gyro, temp_c=temp)), folder=Path(f"at{celsius}"))


def test_the_zero_form_of_a_covariance_is_its_derivative():
    model, step = LinearModel(E0, np.array([0.01, -0.02, 0.03])), 1e-6
    _, covariance = zero_form(model, np.eye(12))
    slope = np.zeros((12, 12))
    for k in range(12):
        ends = [zero_form(LinearModel.from_vector(model.vector + sign * step * np.eye(12)[k]), np.eye(12))[0] for sign in (1, -1)]
        slope[:, k] = (ends[0] - ends[1]) / (2 * step)
    np.testing.assert_allclose(covariance, slope @ slope.T, atol=1e-7)
    values, _ = zero_form(model, np.eye(12))
    m = np.array([0.3, -0.1, 0.2])
    np.testing.assert_allclose(values[:9].reshape(3, 3) @ (m - values[9:]), model(m), atol=1e-15)


@pytest.mark.slow
def test_recorded_sessions_and_a_rest_log_give_E_and_zero_at_every_temperature(rests):
    shape = of_rests_alone("x", rests, {}).model
    points = [point_of(recorded(celsius, seed), shape) for seed, celsius in enumerate((-5.0, 60.0), start=1)]
    fit = joined("x", join(points, rests), rests, {})
    assert len(fit.model.E_terms) == 2
    for celsius in (-5.0, 30.0, 60.0):
        E, zero = fit.model.at(celsius).E, fit.model.zero(np.full((1, 3), celsius))[0]
        sigma_E, sigma_zero = fit.sigma_at(celsius)
        assert (np.abs(E - TRUTH.at(celsius).E) < 4 * sigma_E + 5e-6).all()
        assert np.abs(zero - TRUTH.zero(np.full((1, 3), celsius))[0]).max() < 4 * sigma_zero.max() + 5e-4 * DEG
        assert sigma_E.max() < 2e-4
    # The session's own warming, 3 degC at 0.03 dps/degC, would move its zero without the rest log.
    assert np.abs(points[0].values[9:] - TRUTH.zero(np.full((1, 3), points[0].temp_c))[0]).max() < 5e-3 * DEG


def test_two_temperatures_make_a_line_and_one_makes_a_constant(rests):
    rng = np.random.default_rng(0)
    two = join([drawn_point(celsius, rng) for celsius in (0.0, 60.0)], rests)
    assert len(two.model.E_terms) == 2
    np.testing.assert_allclose(two.model.E_terms[1], E1, atol=5e-6)
    one = join([drawn_point(celsius, rng) for celsius in (25.0, 25.5)], rests)
    assert len(one.model.E_terms) == 1
    assert one.freedom == 9


def test_where_E_does_not_follow_temperature_none_is_claimed():
    steady, rng = replace(TRUTH, E_terms=E0[None]), np.random.default_rng(1)
    claimed = [len(join([drawn_point(c, rng, steady) for c in (0.0, 25.0, 60.0)], None).model.E_terms) > 1 for _ in range(100)]
    assert sum(claimed) <= 5


def test_sigmas_of_E_and_zero_are_true_over_many_draws():
    """Two thirds within a sigma, and no bias: every coefficient, 150 times three sessions."""
    rng, z = np.random.default_rng(2), []
    for _ in range(150):
        fit = join([drawn_point(celsius, rng) for celsius in (0.0, 30.0, 60.0)], None, most_order=2)
        assert fit.model.reference_c == 30.0
        names = parameter_names(len(fit.model.E_terms) - 1, len(fit.model.zero_terms) - 1)
        found = np.concatenate([fit.model.E_terms.ravel(), fit.model.zero_terms.ravel()])
        true = np.concatenate([TRUTH.E_terms.ravel(), ZERO.ravel()])
        if len(found) != len(true):
            continue
        z.append((found - true) / np.sqrt(np.diag(fit.covariance))[: len(names) - 3])
    z = np.array(z)
    assert len(z) > 130
    # E's sigmas are widened where chi-square is above its freedom, so they are a little wide on average.
    assert 0.64 < np.mean(np.abs(z[:, :18]) < 1) < 0.76
    assert 0.62 < np.mean(np.abs(z[:, 18:]) < 1) < 0.74
    assert np.abs(z.mean(axis=0)).max() < 0.35


def test_the_zero_with_a_rest_log_is_as_well_known_as_it_says(rests):
    rng, z = np.random.default_rng(3), []
    for _ in range(100):
        fit = joined("x", join([drawn_point(c, rng, turn_on_dps=0.004) for c in (-5.0, 20.0, 40.0, 65.0)], rests), rests, {})
        for celsius in (0.0, 60.0):
            _, sigma = fit.sigma_at(celsius)
            z.append((fit.model.zero(np.full((1, 3), celsius)) - TRUTH.zero(np.full((1, 3), celsius)))[0] / sigma)
    within = np.mean(np.abs(np.array(z)) < 1)
    assert 0.55 < within < 0.85


def test_what_the_zero_changes_from_session_to_session_is_estimated(rests):
    rng, found = np.random.default_rng(6), []
    for _ in range(40):
        found.append(join([drawn_point(c, rng, turn_on_dps=0.02) for c in (0.0, 20.0, 40.0, 60.0)], rests).turn_on_rps / DEG)
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(0.02, rel=0.15)
    calm = [join([drawn_point(c, rng) for c in (0.0, 20.0, 40.0, 60.0)], rests).turn_on_rps / DEG for _ in range(20)]
    assert np.median(calm) < 0.001


def test_two_sessions_without_a_rest_log_do_not_know_the_turn_on():
    rng = np.random.default_rng(7)
    assert np.isnan(join([drawn_point(c, rng) for c in (0.0, 60.0)], None).turn_on_rps)


def test_a_session_that_disagrees_widens_the_sigmas():
    rng = np.random.default_rng(8)
    points = [drawn_point(celsius, rng) for celsius in (0.0, 20.0, 40.0, 60.0)]
    odd = points[1].values.copy()
    odd[:9] += 1e-3 * rng.normal(size=9)
    with_it = join([points[0], replace(points[1], values=odd), *points[2:]], None)
    assert with_it.p_value < 1e-6
    assert with_it.widened > 5
    assert join(points, None).widened < 2.5


def test_without_sessions_or_temperature_it_says_so(rests):
    with pytest.raises(FitError, match="no session with turns"):
        join([], rests)
    bare = recorded(20.0, 1)
    log = replace(bare.logs[0], samples=replace(bare.logs[0].samples, temp_c=None))
    with pytest.raises(FitError, match=r"log0001.csv has no temperature"):
        point_of(replace(bare, logs=(log,)), None)
