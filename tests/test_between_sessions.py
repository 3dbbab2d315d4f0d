"""Level, drift, steps and scatter of one number over sessions: against REML, Student's t, quadrature, and draws with a known truth."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2, norm, t

from tinygc.estimation.between_sessions import (
    CHANCE,
    FEWEST_WITH_DRIFT,
    LEAST_SCATTER,
    LOOKED_AT,
    ONE_SIGMA,
    Between,
    candidates,
    contrasts,
    course,
    jump,
    scatter_variance,
    variance_where,
)
from tinygc.noise import reml

RNG = np.random.default_rng(37)
DRIFT = np.array([0.0, 1.0])


def drifting(n):
    return np.column_stack([np.ones(n), np.arange(n) - n + 1.0])


@pytest.mark.parametrize("scatter", [0.0, 0.7, 5.0])
def test_the_scatter_is_that_of_restricted_likelihood(scatter):
    n = 9
    own = RNG.uniform(0.3, 3, n) ** 2
    values = 4 + 0.3 * np.arange(n) + RNG.normal(size=n) * np.sqrt(own + scatter**2)
    found = Between(values, own, drifting(n))
    wide = 1e4 * drifting(n)
    expected = reml.estimate(values, wide, np.diag(own), [np.eye(n)], np.ones(1), [None], [np.arange(n)], steps=80).s
    assert found.scatter == pytest.approx(expected[0], abs=3e-3)


def test_contrasts_hold_the_residuals_with_their_variances():
    """Q at any s is the weighted sum of squares about the weighted line, as any text on least squares has it."""
    n = 7
    own, values, design = RNG.uniform(0.5, 2, n), RNG.normal(size=n), drifting(n)
    variance, z = contrasts(values, own, design)
    assert len(z) == n - 2
    for square in (0.0, 0.8):
        weight = np.diag(1 / (own + square))
        beta = np.linalg.solve(design.T @ weight @ design, design.T @ weight @ values)
        left = values - design @ beta
        assert np.sum(z**2 / (variance + square)) == pytest.approx(left @ weight @ left, rel=1e-10)


def test_equal_errors_leave_the_sample_variance_less_their_own():
    values = np.array([1.0, 4.0, -2.0, 3.0])
    variance, z = contrasts(values, np.full(4, 0.5), np.ones((4, 1)))
    assert scatter_variance(variance, z) == pytest.approx(np.var(values, ddof=1) - 0.5)
    pivot = np.array([1.0, 3.0, 1e6])
    found = variance_where(variance, z, pivot)
    np.testing.assert_allclose(found, np.maximum(3 * np.var(values, ddof=1) / pivot - 0.5, 0.0), rtol=1e-9, atol=1e-12)


def test_the_pivot_is_met_whatever_the_own_errors_are():
    variance, z = np.array([0.01, 1.0, 30.0]), np.array([2.0, -9.0, 4.0])
    pivot = np.array([1e-3, 0.3, 4.0, 40.0, 400.0])
    found = variance_where(variance, z, pivot)
    np.testing.assert_allclose(np.sum(z**2 / (variance + found[:, None]), axis=1), pivot, rtol=1e-9)
    assert (np.diff(found) < 0).all()


def test_the_interval_of_the_scatter_is_that_of_chi_square():
    values = RNG.normal(size=6)
    low, high = Between(values, np.zeros(6), np.ones((6, 1))).scatter_interval
    expected = np.sqrt(np.sum((values - values.mean()) ** 2) / chi2.ppf([0.975, 0.025], 5))
    np.testing.assert_allclose([low, high], expected, rtol=1e-9)


def test_a_scatter_that_does_not_show_has_an_upper_limit_that_agreement_by_chance_does_not_shrink():
    own = np.ones(6)
    ordinary, too_good = np.array([1.0, -1, 1, -1, 1, -1]) * np.sqrt(5 / 6), np.zeros(6)
    expected = np.sqrt(5 / chi2.ppf(0.05, 5) - 1)
    for values in (ordinary, 0.1 * ordinary, too_good):
        low, high = Between(values, own, np.ones((6, 1))).scatter_interval
        assert low == 0
        assert high == pytest.approx(expected)


def test_without_own_errors_a_drift_is_that_of_students_t():
    n = 8
    values, design = RNG.normal(size=n) + 0.2 * np.arange(n), drifting(n)
    found = Between(values, np.zeros(n), design)
    beta, (rest,), *_ = np.linalg.lstsq(design, values, rcond=None)
    error = np.sqrt(rest / (n - 2) * np.linalg.inv(design.T @ design)[1, 1])
    np.testing.assert_allclose(found.interval(DRIFT), beta[1] + error * t.ppf([0.025, 0.975], n - 2), rtol=1e-6)
    assert found.sigma(DRIFT) == pytest.approx(error * t.ppf((1 + ONE_SIGMA) / 2, n - 2), rel=1e-6)
    assert found.p_value(DRIFT) == pytest.approx(2 * t.sf(abs(beta[1] / error), n - 2), rel=1e-6)
    assert found.coefficients == pytest.approx(beta)
    assert found.counted == found.scatter


def test_with_own_errors_it_is_the_normal_over_the_distribution_of_the_scatter():
    """The same by quadrature over the pivot itself."""
    n = 5
    own, design = np.array([0.3, 1.0, 0.5, 0.2, 0.8]), drifting(5)
    values = np.array([0.0, 0.4, 2.6, 2.1, 5.0])
    found = Between(values, own, design)
    variance, z = contrasts(values, own, design)

    def below(u):
        square = variance_where(variance, z, np.array([u]))
        to_coefficients, covariance = found.weighted(square)
        beta = (to_coefficients @ values)[0, 1]
        return chi2.pdf(u, 3) * norm.cdf(-beta / np.sqrt(covariance[0, 1, 1]))

    expected = quad(below, 0, np.sum(z**2 / variance), limit=200)[0] + quad(below, np.sum(z**2 / variance), np.inf)[0]
    assert found.p_value(DRIFT) == pytest.approx(2 * min(expected, 1 - expected), rel=1e-3)
    assert n - found.freedom == 2


def test_the_scatter_that_counts_is_no_less_than_a_share_of_the_sample():
    values, own = np.array([1.0, -1.0, 1.0, -1.0]), np.full(4, 100.0)
    assert Between(values, own, np.ones((4, 1))).counted == pytest.approx(np.sqrt(LEAST_SCATTER * 4 / 3))


# Steps, drift and temperature.


def test_a_step_is_judged_over_all_intervals_and_numbers():
    """Without own errors the p-value of the one that is found is Student's t, corrected for all that was looked at."""
    at = np.array([0.0, 0.3, 1.1, 1.6, 2.4, 2.9, 3.7, 4.1])
    values = np.array([0.01, -0.02, 0.015, 0.0, 3.0, 3.02, 2.99, 3.01])
    found = course(values, np.zeros(8), at)
    (step,) = found.steps
    assert step.before == 3
    design = np.column_stack([np.ones(8), jump(8, 3), at - at[-1]])
    beta, (rest,), *_ = np.linalg.lstsq(design, values, rcond=None)
    error = np.sqrt(rest / 5 * np.linalg.inv(design.T @ design)[1, 1])
    one = 2 * t.sf(beta[1] / error, 5)
    assert step.p_value == pytest.approx(1 - (1 - one) ** (7 * LOOKED_AT), rel=1e-4)
    assert found.model.coefficients @ found.step_column(0) == pytest.approx(beta[1])
    assert beta[1] == pytest.approx(3.0, abs=0.1)


def test_candidates_are_the_steps_beside_the_design_at_its_scatter():
    n, own, values = 7, RNG.uniform(0.2, 2, 7), RNG.normal(size=7)
    found = Between(values, own, drifting(n))
    size, sigma = candidates(values, own, found.design, [3])
    assert np.flatnonzero(np.isnan(size)).tolist() == np.flatnonzero(np.isnan(sigma)).tolist() == [3]
    for before in (0, 2, 5):
        to_coefficients, covariance = Between(values, own, np.column_stack([found.design, jump(n, before)])).weighted(
            np.array([found.scatter**2])
        )
        assert size[before] == pytest.approx((to_coefficients @ values)[0, 2])
        assert sigma[before] == pytest.approx(np.sqrt(covariance[0, 2, 2]))


def test_a_step_is_found_from_the_chance_that_is_stated():
    """Just more and just less significant than 5 % over all: the bar is where it is said to be."""
    n, at = 12, np.arange(12.0)
    noise = np.random.default_rng(2).normal(size=n)
    design = np.column_stack([np.ones(n), jump(n, 5), at - at[-1]])
    noise -= design @ np.linalg.lstsq(design, noise, rcond=None)[0]
    error = np.sqrt(noise @ noise / (n - 3) * np.linalg.inv(design.T @ design)[1, 1])
    bar = error * t.isf((1 - (1 - CHANCE) ** (1 / (11 * LOOKED_AT))) / 2, n - 3)
    for factor, count in ((0.98, 0), (1.02, 1)):
        found = course(noise + factor * bar * jump(n, 5), np.zeros(n), at)
        assert len(found.steps) == count, factor


def test_a_drift_is_no_step_and_no_scatter():
    at = np.sort(np.random.default_rng(1).uniform(0, 4, 9))
    own = np.full(9, 1e-4)
    values = 2.0 * at + np.random.default_rng(2).normal(size=9) * 0.01
    found = course(values, own, at)
    assert found.steps == ()
    assert found.drifts
    assert found.drift_p < CHANCE / LOOKED_AT
    assert found.model.coefficients @ found.drift_column == pytest.approx(2.0, abs=0.02)
    assert found.model.scatter < 0.02


def test_a_drift_is_significant_from_the_chance_that_is_stated():
    n, at = 8, np.arange(8.0)
    noise, design = np.random.default_rng(3).normal(size=n), drifting(n)
    noise -= design @ np.linalg.lstsq(design, noise, rcond=None)[0]
    error = np.sqrt(noise @ noise / (n - 2) * np.linalg.inv(design.T @ design)[1, 1])
    bar = error * t.isf(CHANCE / LOOKED_AT / 2, n - 2)
    found = [course(noise + factor * bar * at, np.zeros(n), at) for factor in (0.99, 1.01)]
    assert [each.drifts for each in found] == [False, True]
    assert [each.steps for each in found] == [(), ()]


@pytest.mark.parametrize("count", [2, 3])
def test_too_few_sessions_show_neither_drift_nor_step(count):
    found = course(np.arange(count) * 100.0, np.full(count, 1e-6), np.arange(count) * 1.0)
    assert (found.steps, found.has_drift, found.drifts, found.drift_p) == ((), False, False, 1.0)
    assert not found.drift_column.any()
    assert found.model.freedom == count - 1 < FEWEST_WITH_DRIFT - 1


def test_two_steps_are_found_one_after_the_other():
    at, own = np.arange(15.0), np.full(15, 1e-4)
    values = np.where(at > 4, 1.0, 0.0) - np.where(at > 9, 2.0, 0.0) + np.random.default_rng(8).normal(size=15) * 0.01
    found = course(values, own, at)
    assert sorted(step.before for step in found.steps) == [4, 9]
    sizes = {step.before: found.model.coefficients @ found.step_column(k) for k, step in enumerate(found.steps)}
    assert sizes == pytest.approx({4: 1.0, 9: -2.0}, abs=0.05)
    assert found.model.coefficients[0] == pytest.approx(-1.0, abs=0.05)  # the level is the last session's


def test_an_effect_of_temperature_is_taken_off_where_it_shows():
    rng = np.random.default_rng(4)
    at, warmth = np.arange(10.0), 25 + rng.uniform(-8, 8, 10)
    noise = 0.01 * rng.normal(size=10)
    found = course(0.2 * warmth + noise, np.full(10, 1e-6), at, warmth)
    assert found.warms
    assert found.warming is not None
    assert found.warming.coefficients[2] == pytest.approx(0.2, abs=0.005)
    assert found.model.scatter < 0.03
    assert not course(noise, np.full(10, 1e-6), at, warmth).warms
    assert course(0.2 * warmth, np.full(10, 1e-6), at, 25 + 0.1 * rng.normal(size=10)).warming is None  # it did not vary
    assert course(noise[:4], np.full(4, 1e-6), at[:4], warmth[:4]).warming is None


def test_temperature_is_told_from_two_kelvin_and_significant_from_the_chance_that_is_stated():
    n, at = 9, np.arange(9.0)
    warmth = 25 + 2.01 * np.array([0.1, 0.9, 0.3, 1.0, 0.0, 0.6, 0.2, 0.7, 0.4])
    noise, design = np.random.default_rng(12).normal(size=n), np.column_stack([np.ones(n), at - at[-1], warmth - warmth[-1]])
    noise -= design @ np.linalg.lstsq(design, noise, rcond=None)[0]
    error = np.sqrt(noise @ noise / (n - 3) * np.linalg.inv(design.T @ design)[2, 2])
    bar = error * t.isf(CHANCE / LOOKED_AT / 2, n - 3)
    found = [course(noise + factor * bar * warmth, np.zeros(n), at, warmth) for factor in (0.99, 1.01)]
    assert [each.warms for each in found] == [False, True]
    assert all(each.warming is not None for each in found)
    assert course(noise, np.zeros(n), at, 25 + 0.99 * (warmth - 25)).warming is None
