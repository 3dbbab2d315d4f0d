"""Evidence by direct integration: a linear recording, whose probability is an integral over sizes and over their scale."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from linear_twin import PRIORS, effect, linear_twin, minus_twice_log, stepped
from scipy import integrate, optimize, special

from tinygc.effects import Scan
from tinygc.explanation.evidence import Guess, Hypothesis, least_gain, price, settled
from tinygc.noise.components import STILL_RATE, TURN
from tinygc.noise.refit import over_shapes

A, B, C = effect("a", 2), effect("b", 3), effect("c", 1)


def of_scale(P: int) -> float:
    """-2 log of the best scale's share in the integral over all scales: Laplace's formula, which takes it for 1."""
    return -2 * ((P / 2) * np.log(P) - P / 2 - (P / 2 - 1) * np.log(2) - special.gammaln(P / 2))


def spoilt_twin(*spoilt, seed=0):
    twin = linear_twin(seed=seed)
    for each, theta in spoilt:
        twin.spoil(each, theta)
    return twin


def sizes(hypothesis) -> list[np.ndarray]:
    return [claim.theta for claim in hypothesis.fit.state.claims]


def of_calibration(twin, hypothesis) -> float:
    """What the wide prior of the calibration takes off the density: the score leaves it out."""
    moved = (hypothesis.fit.state.vector[:15] - twin.start().vector) / PRIORS
    return float(moved @ moved - moved[12:14] @ moved[12:14])


# What a name costs.


@pytest.mark.parametrize("size", [1, 3, 9])
def test_a_name_costs_its_odds_and_the_place_of_its_numbers_within_a_scale_of_any_order(size):
    """Against the integral over the scale: density 1 / 10 of its logarithm, odds 1 in 30, and as many shapes as were tried."""
    z = np.full(size, 40.0)

    def density(ln_sigma: float) -> float:
        """Of estimates z with unit noise, relative to those without any effect and to the best fit."""
        variance = 1 + np.exp(2 * ln_sigma)
        return float(variance ** (-size / 2) * np.exp(-(z @ z) / 2 / variance))

    whole = integrate.quad(density, -10, 15, points=[np.log(40)], limit=500)[0] / 10
    expected = -2 * np.log(whole * (1 / 30) / 7) - size * np.log(z[0] ** 2) + of_scale(size)
    assert price(effect("x", size), 7) == pytest.approx(expected, abs=0.02)


@pytest.mark.parametrize(("size", "shapes"), [(1, 1), (3, 40)])
def test_the_least_gain_is_that_at_which_an_effect_is_as_probable_as_none(size, shapes):
    gain = least_gain(effect("x", size), shapes)
    ratio = np.exp(gain / 2) * (gain / size) ** (-size / 2) * np.exp(-size / 2) / 10 / 30 / shapes
    assert ratio == pytest.approx(1, rel=1e-9)


# The probability of a recording.


@pytest.mark.parametrize(("name", "theta"), [(C, [5.0]), (A, [6.0, -4.0]), (B, [5.0, 4.0, -6.0])])
def test_the_score_is_the_integral_over_the_sizes_and_their_scale(name, theta):
    """Evidence beside that of no effect, each with the noise that is most probable with it."""
    twin = spoilt_twin((name, theta))
    evidence = twin.evidence()
    found = evidence.of((name,), evidence.nothing)
    s, P = found.noise.s, len(theta)
    scales = np.linspace(-1, 8, 400)
    minus = np.array([minus_twice_log(twin, s, [name], [np.exp(each)]) for each in scales])
    whole = minus.min() - 2 * np.log(np.trapezoid(np.exp((minus.min() - minus) / 2), scales) / 10 / 30)
    assert found.score == pytest.approx(whole + of_scale(P) - of_calibration(twin, found), abs=0.15)
    nothing = minus_twice_log(twin, evidence.nothing.noise.s) - of_calibration(twin, evidence.nothing)
    assert evidence.nothing.score == pytest.approx(nothing, abs=0.05)
    np.testing.assert_allclose(sizes(found)[0], theta, atol=0.6)
    for each, one in ((evidence.nothing, ()), (found, (name,))):  # the noise is estimated anew for each
        sigma = [evidence.prior(each.fit)[-1]] * len(one)
        best = optimize.minimize(
            lambda s, one=one, sigma=sigma: minus_twice_log(twin, s, one, sigma), each.noise.s + 0.5, method="Nelder-Mead"
        )
        left = best.fun - of_calibration(twin, each) - sum(map(len, sizes(each)))
        assert each.score - sum(map(evidence.price, one)) == pytest.approx(left, abs=0.1)


def test_variance_that_a_name_takes_over_counts_for_it():
    """A component absorbs what only the angles show; the name takes it from there."""
    angles = effect("angles", 2)
    twin = linear_twin(columns=lambda each: np.vstack([np.random.default_rng(1).normal(size=(16, 2)), np.zeros((36, 2))]))
    twin.spoil(angles, [30.0, -20.0])
    evidence = twin.evidence()
    found = evidence.of((angles,), evidence.nothing)
    assert evidence.nothing.noise.size(TURN) > 10 > 1 > found.noise.size(TURN)
    fixed = evidence.without(TURN)
    assert fixed.nothing.score == pytest.approx(minus_twice_log(twin, [0.0, fixed.nothing.noise.s[0]]), rel=1e-3)
    assert [c.name for c in fixed.nothing.noise.components] == [STILL_RATE]
    assert fixed.first_noise.s.shape == fixed.first_noise.sigma.shape == (1,)
    assert len(evidence.nothing.noise.components) == 2
    assert evidence.nothing.score - found.score < 0.1 * (fixed.nothing.score - fixed.of((angles,), fixed.nothing).score)


def test_the_prior_of_a_claim_is_the_rms_of_its_numbers_between_what_is_known_of_it_and_what_is_plausible():
    weak, strong = effect("weak", 2, plausible=3.0), effect("strong", 2, plausible=3.0)
    twin = spoilt_twin((A, [6.0, -4.0]), (strong, [9.0, 12.0]))
    evidence = twin.evidence()
    found = evidence.of((A, weak, strong), evidence.nothing)
    prior, theta = evidence.prior(found.fit), sizes(found)
    assert prior[15:17] == pytest.approx(np.sqrt(np.mean(theta[0] ** 2)))
    least = np.sqrt(np.linalg.eigvalsh(found.fit.covariance[17:19, 17:19])[0])
    assert prior[17:19] == pytest.approx(max(np.sqrt(np.mean(theta[1] ** 2)), least))
    assert np.sqrt(np.mean(theta[1] ** 2)) < 0.3
    assert prior[19:21] == pytest.approx(3.0)
    # theta' D^-1 theta is the number of numbers; what is larger than plausible has more.
    found = evidence.of((A, strong), evidence.nothing)
    size, sigmas = sizes(found)[1] @ sizes(found)[1] / 9, [evidence.prior(found.fit)[15], 3.0]
    assert size > 20
    density = minus_twice_log(twin, found.noise.s, found.effects, sigmas) - 2 - size - of_calibration(twin, found)
    assert found.score == pytest.approx(density + sum(map(evidence.price, found.effects)) + size - 2, abs=0.05)


def test_a_direction_that_is_hardly_known_does_not_make_a_scale_small():
    """The lower limit is the sigma of the best-known direction, where the numbers are less than that."""
    twin = spoilt_twin()
    evidence = twin.evidence()
    found = evidence.of((B,), evidence.nothing)
    fit = found.fit
    claims = (SimpleNamespace(effect=B, theta=np.full(3, 1e-3)),)
    small = SimpleNamespace(state=SimpleNamespace(claims=claims), covariance=fit.covariance)
    assert evidence.prior(small)[15:] == pytest.approx(np.sqrt(np.linalg.eigvalsh(fit.covariance[15:, 15:])[0]))
    known = SimpleNamespace(state=small.state, covariance=np.zeros((18, 18)))
    assert evidence.prior(known)[15:] == pytest.approx(1e-3)
    claims[0].theta[:] = 0
    assert evidence.prior(known)[15:] == pytest.approx(1e-6 * 100)


# Guesses, and what was evaluated.


def test_a_guess_by_linear_columns_is_the_score_where_all_is_linear():
    twin = spoilt_twin((A, [6.0, -4.0]), (B, [5.0, 4.0, -6.0]), (C, [4.0]))
    evidence, exact = twin.evidence(), twin.evidence()
    both = evidence.of((A, B), evidence.nothing)
    for guess, effects in (
        (evidence.guess(both, add=C), (A, B, C)),
        (evidence.guess(both, without=A), (B,)),
        (evidence.guess(both, without=B, add=C), (A, C)),
    ):
        assert guess.effects == effects
        assert guess.score == pytest.approx(exact.of(effects, exact.nothing).score, abs=1.5)
    assert evidence.guess(both, without=B, add=C) is evidence.guess(both, without=B, add=C)
    assert evidence.guess(both, without=B).score == pytest.approx(evidence.of((A,), both).score, abs=1.5)
    assert evidence.guess(both, without=B).score == evidence.of((A,), both).score  # known by now
    assert evidence.of((B, A), evidence.nothing) is both
    assert {h.ids for h in evidence.exact} == {frozenset(), both.ids, frozenset({A.id})}
    assert {h.ids for h in evidence.weighed} == {
        frozenset(),
        *map(frozenset, ({A.id}, {B.id}, {A.id, B.id}, {A.id, C.id}, {A.id, B.id, C.id})),
    }
    evidence.forget(frozenset({B.id}))
    assert {h.ids for h in evidence.weighed} == {frozenset(), frozenset({A.id}), frozenset({A.id, C.id})}
    assert isinstance(both, Hypothesis)
    assert repr(Guess((A, B), 1.25)) == "<test.a, test.b: 1.2>"
    assert repr(Guess((), 1.25)) == "<nothing: 1.2>"


def test_an_effect_pays_for_every_shape_that_was_tried_under_its_name():
    twin = spoilt_twin((C, [5.0]))
    evidence = twin.evidence()
    alone = evidence.price(C)
    assert alone == price(C, 1)
    evidence.will_try([C, effect("c", 1, equation="another")])
    assert evidence.price(C) - alone == pytest.approx(2 * np.log(2))
    step = stepped("step", np.array([1.0, 2.0, 5.0]))
    evidence.will_try(step.variants(np.array([1.0, 2.0, 5.0])))
    assert evidence.price(step) == price(step, 3)


def test_columns_are_those_of_the_linear_model_and_made_once():
    twin = spoilt_twin()
    evidence = twin.evidence()
    np.testing.assert_array_equal(evidence.columns(A), twin.columns_of(A))
    assert evidence.columns(A) is evidence.columns(A)


def test_shapes_at_values_that_differ_are_different_hypotheses():
    step = stepped("step", np.array([1.0, 2.0]))
    twin = spoilt_twin((step.at(1.0), [5.0]))
    evidence = twin.evidence()
    right, wrong = (evidence.of((step.at(at),), evidence.nothing) for at in (1.0, 2.0))
    assert right is evidence.of((step.at(1.0),), evidence.nothing)
    assert right.score < min(evidence.nothing.score, wrong.score) - 20


def test_a_fit_goes_back_to_the_gauge_where_that_costs_nothing(monkeypatch):
    twin = spoilt_twin((A, [5.0, 4.0]))
    found = twin.evidence().of((A,), None)
    for worse, kept in ((0.009, True), (0.011, False)):
        gauged = SimpleNamespace(state=found.fit.state, r=found.fit.r + 1, chi_square=found.fit.chi_square - worse)
        monkeypatch.setattr("tinygc.explanation.evidence.in_gauge", lambda twin, whiten, fit, gauged=gauged: gauged)
        assert (settled(twin, found.whiten, found.fit) is not gauged) == kept


def test_a_guess_of_what_is_hardly_seen_is_held_by_its_prior():
    """A step under the plausible size, one under the size so found, and the density of what it leaves: by least squares with rows for the
    prior, and the dense covariance."""
    weak = effect("weak", 2, plausible=0.05)
    twin = spoilt_twin((weak, [0.6, -0.5]))
    evidence = twin.evidence()
    nothing = evidence.nothing
    C = nothing.whiten.covariance
    root = np.linalg.cholesky(C)
    J = np.hstack([np.delete(twin.calibration * PRIORS, [12, 13], axis=1), twin.columns_of(weak)])
    r = nothing.whiten.back(nothing.fit.r)

    def step(prior):
        rows = np.vstack([np.linalg.solve(root, J * prior), np.eye(15)])
        return prior * np.linalg.lstsq(rows, np.r_[-np.linalg.solve(root, r), np.zeros(15)], rcond=None)[0]

    prior = np.r_[np.ones(13), 0.05, 0.05]
    prior[13:] = np.sqrt(np.mean(step(prior)[13:] ** 2))
    left = r + J @ step(prior)
    variance = np.diag(np.diag(twin.evidence().whiteners.white.covariance)) + (J * prior) @ (J * prior).T

    def density(s):
        whole = variance + np.diag(np.repeat([s[0] ** 2, s[1] ** 2, 0.0], twin.sizes))
        return np.linalg.slogdet(whole)[1] + left @ np.linalg.solve(whole, left)

    best = optimize.minimize(density, nothing.noise.s + 0.1, method="Powell").fun
    assert evidence.guess(nothing, add=weak).score == pytest.approx(best + evidence.price(weak), abs=0.05)


# The moment of a step is known to some time only.


@pytest.mark.parametrize(("size", "plausible"), [(2.5, 100.0), (0.45, 0.2)])
def test_a_size_has_the_uncertainty_of_its_moment(size, plausible):
    """Against the integral over the moment of the size's normal posterior at each, all else integrated out: of a large step, and of a small
    one that may be anywhere and that its prior pulls."""
    rng, grid = np.random.default_rng(3), np.arange(10.0)

    def columns(of) -> np.ndarray:
        moment = of.shape["at_s"] * 1e-3
        return early + moment * late if moment < 6 else early + 6 * late  # beyond 6 s nothing changes

    early, late = rng.normal(size=(52, 1)), 0.25 * rng.normal(size=(52, 1))

    def made(value: float):
        return effect("step", 1, plausible, equation=f"step at {value:.9f}")

    step = effect("step", 1, plausible, scan=Scan("at_s", "ms", make=made, si=1e-3, grid=lambda moves: grid))
    twin = linear_twin(columns=columns)
    twin.spoil(step.at(4.4), [size])
    evidence = twin.evidence()
    found = evidence.of((step.at(4.2),), evidence.nothing)
    (theta,), *_ = sizes(found)

    P = np.where(np.arange(15) // 2 == 6, 0.0, PRIORS) ** 2
    known = found.whiten.covariance + (twin.calibration * P) @ twin.calibration.T
    moments, weight, second = np.linspace(-0.5, 9.5, 2001), [], []
    for moment in moments.clip(0, 9):
        c = columns(step.at(moment))[:, 0]
        solved = np.linalg.solve(known, np.column_stack([c, twin.recorded]))
        variance = 1 / (c @ solved[:, 0] + plausible**-2)
        mean = -variance * (c @ solved[:, 1])
        weight.append(0.5 * (mean**2 / variance + np.log(variance)))
        second.append(variance + (mean - theta) ** 2)
    weight = np.exp(np.array(weight) - max(weight))
    by_hand = float(weight @ np.array(second) / weight.sum())

    alone = found.fit.theta_covariance(0)[0, 0]
    whole = over_shapes(twin, found.whiten, found.fit)
    assert whole.theta_covariance(0)[0, 0] == pytest.approx(by_hand, rel=0.03)
    assert by_hand > 1.3 * alone
    assert whole.state is found.fit.state
    smooth = replace(found.fit.state.claims[0], effect=replace(step.at(4.2), scan=replace(step.scan, smooth=True)))
    fitted = replace(found.fit, state=replace(found.fit.state, claims=(smooth,)))  # its shape was fitted with all else
    assert over_shapes(twin, found.whiten, fitted).covariance is fitted.covariance
