"""Least squares: its answer is the minimum that scipy's rotations have, its covariance the curvature there; what no turn sees stays."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import DEG, Turns
from scipy import linalg
from small_turns import PERFECT, TRUE, TYPICAL, angles_by_scipy, numeric_jacobian, small_turns, turned_ends, with_known_angles

from session.io.errors import FitError
from tinygc import closure
from tinygc.closure import least_squares
from tinygc.closure.least_squares import (
    HELD,
    TOLERANCE,
    NotSettled,
    StillRates,
    combination,
    fit_least_squares,
    inverse_lower,
    naming_segments,
    solve_lower,
)
from tinygc.closure.prior import GaussianPrior
from tinygc.models.linear import BIAS, MATRIX, NAMES, PRIOR_SIGMA, LinearModel, bias_only

RNG = np.random.default_rng(11)
START = bias_only(np.array([0.01, -0.02, 0.03]))
REST = np.array([0.02, -0.015, 0.01])
AT_REST = replace(TRUE, B=-TRUE.E @ REST)


def some_covariance(size: np.ndarray) -> np.ndarray:
    root = np.random.default_rng(3).normal(size=(len(size), len(size))) + 2 * np.eye(len(size))
    return root @ root.T / 8 * np.outer(size, size)


STILL_RATE, STILL_SIGMA = 0.02 * RNG.normal(size=(3, 3)), RNG.uniform(1e-4, 3e-4, (3, 3))
STILLS = StillRates(STILL_RATE, TRUE(STILL_RATE) + STILL_SIGMA * RNG.normal(size=(3, 3)), STILL_SIGMA)
LOT = GaussianPrior(TRUE.vector + 1e-4, some_covariance(np.full(12, 3e-4)), np.ones(12, dtype=bool), weight=2.5)
UNEVEN = RNG.uniform(0.5e-4, 2e-4, (8, 3))

#: turns, sigma, and what else is given
CASES = {
    "tilt": (small_turns(noise_rad=1e-4), UNEVEN[:, 0], {}),
    "dials": (small_turns(yaw_known=True, noise_rad=1e-4), UNEVEN, {}),
    "known angles": (with_known_angles(small_turns(noise_rad=1e-4)), UNEVEN, {}),
    "first order": (small_turns(noise_rad=1e-4, samples=120, integrator="first-order"), UNEVEN[:, :2], {"integrator": "first-order"}),
    "still rates": (small_turns(noise_rad=1e-4), UNEVEN[:, :2], {"still_rates": STILLS}),
    "a prior": (small_turns(noise_rad=1e-4), UNEVEN[:, :2], {"prior": LOT}),
    "bias at rest": (small_turns(8, AT_REST, noise_rad=1e-4), UNEVEN[:, :2], {"rest_rps": REST}),
    "bias at rest and a prior": (small_turns(8, AT_REST, noise_rad=1e-4), UNEVEN[:, :2], {"rest_rps": REST, "prior": LOT}),
}


def whitened(parameters, batch, sigma, still_rates=None, integrator="exact", rest_rps=None, prior=None):
    """All residuals in sigmas: ends, stills and prior, of 12 parameters, or of the 9 of E where B = -E rest."""
    own = slice(0, len(parameters))
    vector = parameters if rest_rps is None else np.append(parameters, -parameters.reshape(3, 3) @ rest_rps)
    rows = [(angles_by_scipy(batch, vector, integrator) / sigma.reshape(len(batch), -1)).ravel()]
    if still_rates is not None:
        model = LinearModel.from_vector(vector)
        rows.append(((still_rates.rate @ model.E.T + model.B - still_rates.earth) / still_rates.sigma).ravel())
    if prior is None:
        rows.append((parameters - START.vector[own]) / PRIOR_SIGMA[own])
    else:
        root = np.linalg.cholesky(prior.covariance[own, own] / prior.weight)
        rows.append(np.linalg.solve(root, parameters - prior.centre[own]))
    return np.concatenate(rows)


@pytest.mark.parametrize("name", CASES)
def test_the_answer_is_the_minimum_and_the_covariance_the_curvature(name):
    """By derivatives of residuals that scipy's rotations give.  The columns are exact to the square of a sample's angle, a thousandth."""
    batch, sigma, given = CASES[name]
    found = fit_least_squares(batch, sigma, START, **given)
    own = MATRIX if "rest_rps" in given else slice(0, 12)

    def residuals(parameters):
        return whitened(parameters, batch, sigma, **given)

    jacobian = numeric_jacobian(residuals, found.model.vector[own])
    expected = np.linalg.inv(jacobian.T @ jacobian)
    error = np.sqrt(np.diag(expected))
    shift = np.linalg.solve(jacobian.T @ jacobian, jacobian.T @ residuals(found.model.vector[own]))
    assert np.abs(shift / error).max() < 5e-3
    np.testing.assert_allclose(found.covariance[own, own] / np.outer(error, error), expected / np.outer(error, error), atol=5e-3)
    assert found.unobserved == ()
    if "rest_rps" in given:
        np.testing.assert_allclose(found.model.B, -found.model.E @ REST, rtol=1e-12)
        np.testing.assert_allclose(np.diag(found.covariance)[BIAS], (HELD * PRIOR_SIGMA[BIAS]) ** 2, rtol=1e-3)


@pytest.mark.parametrize("name", ["tilt", "bias at rest"])
def test_where_the_search_begins_changes_how_long_it_takes_and_nothing_else(name):
    batch, sigma, given = CASES[name]
    cold = fit_least_squares(batch, sigma, START, **given)
    sigmas = np.sqrt(np.diag(cold.covariance))[MATRIX]
    near = replace(cold.model, E=cold.model.E + 1e-3)
    from_model, from_rows = (fit_least_squares(batch, sigma, START, begin=begin, **given) for begin in (near, cold.rows))
    for found in (from_model, from_rows):
        np.testing.assert_allclose(found.model.vector[MATRIX], cold.model.vector[MATRIX], rtol=0, atol=1e-4 * sigmas.min())
        np.testing.assert_allclose(found.covariance, cold.covariance, rtol=0, atol=1e-3 * sigmas.min() ** 2)
    assert 1 == from_rows.steps < from_model.steps <= cold.steps
    moved = from_rows.model.vector - cold.rows.vector
    assert np.abs(cold.rows.columns[..., MATRIX] @ moved[MATRIX]).max() < TOLERANCE


def test_a_bias_measured_at_rest_is_taken_out_of_the_model_that_the_search_begins_at():
    """B = -E rest is held, so what B the first model has is nothing to the search: as many steps, the same answer to the last digit."""
    batch, sigma, given = CASES["bias at rest"]
    one, other = (fit_least_squares(batch, sigma, START, begin=LinearModel(TRUE.E, B), **given) for B in (np.zeros(3), np.ones(3)))
    assert one.steps == other.steps
    np.testing.assert_array_equal(one.model.vector, other.model.vector)


def test_rows_are_those_of_the_last_step_and_can_be_picked():
    batch, sigma, _ = CASES["tilt"]
    rows = fit_least_squares(batch, sigma, START).rows
    np.testing.assert_allclose(rows.angles, angles_by_scipy(batch, rows.vector), atol=1e-12)
    some = rows.pick(np.arange(8) > 4)
    np.testing.assert_array_equal(some.angles, rows.angles[5:])
    np.testing.assert_array_equal(some.columns, rows.columns[5:])


# Lower triangular systems.


@pytest.mark.parametrize("count", [1, 48, 49, 99, 200])
def test_lower_systems_of_rows_of_any_unit(count):
    """Each element as exactly as substitution gives it: rows differ by ten powers of ten."""
    rng = np.random.default_rng(count)
    factor = np.tril(rng.normal(size=(count, count))) / np.sqrt(count) + np.eye(count)
    factor *= 10.0 ** rng.uniform(-5, 5, (count, 1))
    right = rng.normal(size=(count, 3))
    expected = linalg.solve_triangular(factor, right, lower=True)
    np.testing.assert_allclose(solve_lower(factor, right), expected, rtol=1e-8)
    np.testing.assert_allclose(solve_lower(factor, right[:, 0]), expected[:, 0], rtol=1e-8)
    np.testing.assert_allclose(solve_lower(np.stack([factor, 2 * factor]), np.stack([right, right])), [expected, expected / 2], rtol=1e-8)
    inverse = inverse_lower(factor)
    assert not np.triu(inverse, 1).any()
    np.testing.assert_allclose(inverse @ factor, np.eye(count), atol=1e-8)


# What is observed, and what is not.


def weakest(batch, about):
    """(3,): strength of the direction that the ends of sigma 1 rad observe least, in units of the prior; the direction (12,)."""
    columns = fit_least_squares(batch, np.full(len(batch), 1e-6), about, begin=about).rows.columns
    _, strength, right = np.linalg.svd(columns.reshape(-1, 12) * PRIOR_SIGMA)
    return strength[-1], right[-1]


@pytest.mark.parametrize(("square", "share"), [(99 * 1.004, 0.99), (99 * 0.996, 0.0)])
def test_a_direction_moves_if_its_sigma_is_below_a_tenth_of_the_priors(square, share):
    """That is from a square of its strength of 99 on: it then goes 99 % of the way from the prior, and else not at all."""
    batch = small_turns()
    strength, direction = weakest(batch, TRUE)
    off = 1e-3 * direction
    start = LinearModel.from_vector(TRUE.vector + off * PRIOR_SIGMA)
    sigma = np.full(len(batch), strength / np.sqrt(square))
    found = fit_least_squares(batch, sigma, start, begin=TRUE)
    moved = direction @ ((found.model.vector - start.vector) / PRIOR_SIGMA)
    assert moved == pytest.approx(-share * 1e-3, abs=1e-6)
    with_prior = fit_least_squares(batch, sigma, start, begin=TRUE, prior=GaussianPrior(start.vector, np.diag(PRIOR_SIGMA**2), NAMES))
    moved = direction @ ((with_prior.model.vector - start.vector) / PRIOR_SIGMA)
    assert moved == pytest.approx(-square / (square + 1) * 1e-3, abs=1e-6)  # what is known beforehand counts in every direction


@pytest.mark.parametrize(("factor", "hidden"), [(0.998, ()), (1.002, ("E_xy",))])
def test_a_parameter_is_observed_if_its_sigma_is_below_a_tenth_of_the_priors(factor, hidden):
    batch = small_turns()
    columns = fit_least_squares(batch, np.full(len(batch), 1e-6), TRUE, begin=TRUE).rows.columns.reshape(-1, 12)

    def worst(sigma):
        covariance = np.linalg.inv(columns.T @ columns / sigma**2 + np.diag(PRIOR_SIGMA**-2.0))
        return np.sqrt(np.diag(covariance)) / PRIOR_SIGMA

    low, high = 1e-6, 1.0
    for _ in range(60):
        middle = np.sqrt(low * high)
        low, high = (low, middle) if worst(middle).max() > 0.1 else (middle, high)
    assert NAMES[np.argmax(worst(low))] == "E_xy"
    assert fit_least_squares(batch, np.full(len(batch), factor * low), TRUE, begin=TRUE).unobserved == hidden


# Searches that do not end.


def torn(batch, count, sigma_rad, **given):
    """The refusal of a fit to turns whose first ``count`` end anywhere."""
    by = np.zeros((len(batch), 3))
    by[:count] = 1.5 * np.random.default_rng(0).normal(size=(count, 3))
    with pytest.raises(NotSettled) as refused:
        fit_least_squares(turned_ends(batch, by), np.full(len(batch), sigma_rad), START, **given)
    return refused.value


def test_a_search_that_does_not_end_tells_what_each_turn_is_off_by():
    """By the model that it begins with; beyond a tenth of what the turn turned, or of two circles, it is beyond any gyroscope."""
    batch = small_turns(8)
    batch = replace(batch, rate=np.where(np.arange(8)[:, None, None] > 5, 12.0, 1.0) * batch.rate)
    steps = np.linalg.norm(START(batch.rate)[:, 1:], axis=2) * batch.dt
    limit = 0.1 * np.minimum(steps.sum(axis=1), 4 * np.pi)
    assert (steps.sum(axis=1) > 4 * np.pi).tolist() == [False] * 6 + [True] * 2
    here = replace(batch, end=closure.end_attitude(batch, START(batch.rate)))
    off = np.zeros((8, 3))
    off[4:, 1] = 4 * np.arcsin(limit[4:] / 4 * [0.999, 1.001, 0.999, 1.001])
    refused = torn(turned_ends(here, off), 4, 1e-5)
    np.testing.assert_allclose(refused.off_rad[4:], limit[4:] * [0.999, 1.001, 0.999, 1.001], rtol=1e-9)
    assert refused.too_far[4:].tolist() == [False, True, False, True]
    assert refused.loose == ""
    assert "did not settle in 50 steps" in str(refused)


def test_a_search_ends_in_its_last_step_and_not_after(monkeypatch):
    batch, sigma, _ = CASES["tilt"]
    steps = fit_least_squares(batch, sigma, START).steps
    monkeypatch.setattr(least_squares, "MAX_STEPS", steps)
    assert fit_least_squares(batch, sigma, START).steps == steps
    monkeypatch.setattr(least_squares, "MAX_STEPS", steps - 1)
    with pytest.raises(NotSettled):
        fit_least_squares(batch, sigma, START)


def test_turns_that_bind_a_direction_loosely_are_not_blamed_one_by_one():
    refused = torn(small_turns(seed=1), 3, 0.02)
    assert refused.loose.startswith("E_")
    assert f"the turns hardly bind {refused.loose}; turn about more axes" in str(refused)


def test_a_direction_is_named_by_the_parameters_with_half_its_size():
    direction = np.zeros(12)
    direction[[0, 4, 8, 9, 10]] = -0.4, 0.2, 0.21, -0.4, -0.19
    assert combination(direction) == "E_xx - E_zz + B_x"
    assert combination(-direction) == "E_xx - E_zz + B_x"


@pytest.mark.parametrize(
    ("off_deg", "too_far", "says"),
    [
        ([20, 30, 1, 2], [0, 1], "gravity is missed in turn 1 of those used by 30.0 deg, turn 0 of those used by 20.0 deg, in the median"),
        ([20, 30, 40, 2], [0, 1, 2], "3 of 4 turns miss gravity by more than 10% of their angle, the median turn by 25.0 deg"),
        ([3, 1, 4, 2], [], "gravity is missed in turn 2 of those used by 4.0 deg, in the median turn by 2.5 deg"),
        ([9, 8, 7, 6, 30, 0, 0, 0], [0, 1, 2, 3], "turn 0 of those used by 9.0 deg, turn 1 of those used by 8.0 deg, turn 2 of those used"),
    ],
)
def test_what_does_not_fit_is_named_the_worst_first_and_three_at_most(off_deg, too_far, says):
    words = str(NotSettled(np.multiply(off_deg, DEG), np.isin(np.arange(len(off_deg)), too_far), ""))
    assert says in words
    assert "turn 3" not in words.partition("gravity")[2]


def test_the_turns_are_named_by_their_segments():
    segments = [SimpleNamespace(number=number, start_s=5.4 * number) for number in (3, 7)]
    with pytest.raises(FitError, match=r"missed in segment 7 at 38 s by 20\.0 deg, in the median"), naming_segments(segments):
        raise NotSettled(np.multiply([1, 20], DEG), np.array([False, True]), "")


# Whole turns by hand, sampled as a sensor does.


@pytest.fixture(scope="module")
def turns():
    return Turns(16, seed=1)


def fit(batch, sigma=1e-4, start=PERFECT):
    return fit_least_squares(batch, np.full(len(batch), sigma), start)


@pytest.mark.parametrize(("scale", "yaw_known"), [(1.0, False), (-1.0, True), (5.0, False)])
def test_all_parameters_together_are_recovered(turns, scale, yaw_known):
    """Also when they are five times those of a typical unit: 6 % of scale, 5 dps."""
    vector = PERFECT.vector + scale * TYPICAL
    found = fit(turns.batch(LinearModel.from_vector(vector), yaw_known), sigma=1e-6)
    np.testing.assert_allclose(found.model.vector, vector, atol=1e-6)
    assert found.steps < 15
    assert found.unobserved == ()


def test_turns_about_the_vertical_only_leave_the_rest_at_the_start():
    """A level table that only yaws: gravity never moves, so most of E is not seen, and does not wander; dials show the scale about z."""
    turns = Turns(12, seed=2, axes=(0, 0, 1))
    batch = turns.batch(TRUE, gyro_noise=1e-3 * np.random.default_rng(0).standard_normal(turns.rate.shape))
    start = bias_only(batch.rate[0, 0])
    found = fit(batch, 1e-4, start)
    # No tilt in the world says how large a yaw was: the third row (what a rate about z reads) is not seen at all.
    third_row = {"E_zx", "E_zy", "E_zz", "B_z"}
    assert third_row <= set(found.unobserved)
    index = [NAMES.index(name) for name in found.unobserved]
    assert np.all(np.abs(found.model.vector - start.vector)[index] < PRIOR_SIGMA[index])
    only_third = [NAMES.index(name) for name in third_row]
    np.testing.assert_allclose(found.model.vector[only_third], start.vector[only_third], atol=1e-3)
    # What a rate about z leaks into x and y tilts the table: that is seen.
    assert {"E_xz", "E_yz"}.isdisjoint(found.unobserved)
    with_dials = fit(turns.batch(TRUE, True)).unobserved
    assert "E_zz" not in with_dials
    assert "E_xx" in with_dials


def test_no_segments_and_no_finite_rates_are_refused(turns):
    batch = turns.batch(PERFECT)
    with pytest.raises(FitError, match="no segments"):
        fit(batch.pick(slice(0, 0)))
    with pytest.raises(FitError, match="finite"):
        fit(replace(batch, rate=np.where(batch.rate == batch.rate.max(), np.nan, batch.rate)))
