"""Selection among hypotheses: p-values over a family, evidence by direct integration, and the search that goes through them."""

from dataclasses import make_dataclass, replace
from itertools import combinations
from types import SimpleNamespace
from unittest.mock import patch

import numpy as np
import pytest
from linear_twin import PRIORS, effect, linear_twin, minus_twice_log, stepped
from numpy.testing import assert_allclose
from scipy import optimize, special, stats
from small_sessions import small_session

from tinygc.effects import Convention
from tinygc.explanation import decision
from tinygc.explanation.decision import _beyond_the_catalogue
from tinygc.explanation.evidence import Guess, selection_of, sharpened, spacing
from tinygc.explanation.search import detection_limits, exchanged, search, without_idle
from tinygc.inference.choose import Selection, least_gain, linear_estimate, price, probabilities, rivals_of
from tinygc.inference.solve import orthonormal
from tinygc.noise.components import known_whitener
from tinygc.noise.refit import Replay, candidates, refit
from tinygc.noise.twin import Twin

N = 90
A, B, C = effect("a", 2), effect("b", 3), effect("c", 1)


def without(columns, r):
    """What least squares leaves of r."""
    return r - columns @ np.linalg.lstsq(columns, r, rcond=None)[0]


def design(seed=0, groups=9):
    """Seven nuisance columns, and groups that resemble one another, as delays and lags do."""
    rng = np.random.default_rng(seed)
    shared = rng.normal(size=(N, 3))
    of = {f"g{i}": rng.normal(size=(N, 1 + i % 4)) + (shared[:, : 1 + i % 4] if i % 4 < 3 else 0) for i in range(groups)}
    return rng.normal(size=(N, 7)), of


def residuals(*shape):
    return np.random.default_rng(3).standard_normal((N, *shape))


# P-values of a family.


def test_the_lowest_p_value_is_that_of_fishers_f_whatever_the_scale():
    """Where the tail underflows it is, of two numbers, exactly the power (1 + gain / rest)^(-freedom / 2)."""
    nuisance, groups = design()
    r, log_p, selection = residuals(), [], Selection(nuisance, groups, 1)
    least, gains = np.sum(without(nuisance, r) ** 2), selection.gains(r)
    for name, columns in groups.items():
        left, rank = np.sum(without(np.hstack([nuisance, columns]), r) ** 2), columns.shape[1]
        log_p.append(stats.f.logsf((least - left) / rank / (left / (N - 7 - rank)), rank, N - 7 - rank))
        assert gains[name] == pytest.approx(least - left, rel=1e-9)
        alone = Selection(nuisance, {name: columns}, 1)
        assert alone.lowest_log_p(np.stack([0.01 * r, -2 * r + nuisance @ np.arange(7)], axis=1)) == pytest.approx(log_p[-1], rel=1e-9)
    signal = groups["g1"].sum(axis=1)
    strong = 1e5 * signal + r
    left = [np.sum(without(columns, strong) ** 2) for columns in (nuisance, np.hstack([nuisance, groups["g1"]]))]
    power = -(N - 9) / 2 * np.log(left[0] / left[1])
    assert power < -745
    # Where nothing is left, a part in a million million counts as left.
    found = selection.lowest_log_p(np.stack([r, strong, 1e-5 * signal], axis=1))
    assert found[0] == pytest.approx(min(log_p), rel=1e-9)
    assert found[1:] == pytest.approx([power, -(N - 9) / 2 * np.log1p(1e12)], rel=1e-6)


def test_the_allowances_of_the_covariance_are_taken_out_but_for_the_groups_along_them():
    """Scale and its degrees of freedom from some of the rows alone."""
    nuisance, groups = design(groups=2)
    rng = np.random.default_rng(8)
    allowances, r, rows = rng.normal(size=(N, 5)), rng.standard_normal(N), np.arange(10, 70)
    for along in ("g0", "g1", "none"):
        selection = Selection(nuisance, groups, 1, allowances=1e-5 * allowances, scale_rows=rows, along=frozenset({along}))
        wide = np.hstack([nuisance, allowances])
        q = np.linalg.qr(wide)[0]
        scale, freedom = np.sum(without(wide, r)[rows] ** 2), len(rows) - np.sum(q[rows] ** 2)
        expected = []
        for name, columns in groups.items():
            taken, rank = nuisance if name == along else wide, columns.shape[1]
            gain = np.sum(without(taken, r) ** 2) - np.sum(without(np.hstack([taken, columns]), r) ** 2)
            rest, left = (scale, freedom) if name == along else (scale - gain, freedom - rank)
            expected.append(stats.f.logsf(gain / rank / (rest / left), rank, left))
        assert selection.lowest_log_p(r[:, None])[0] == pytest.approx(min(expected), rel=1e-9)
    assert selection.p_value(r + 50 * allowances @ np.arange(5)) == pytest.approx(selection.p_value(r), rel=1e-6)


@pytest.mark.parametrize(("n", "tested"), [(5, True), (4, False)])
def test_one_degree_of_freedom_of_the_scale_is_enough(n, tested):
    """However its count, a difference of sums, is rounded."""
    drawn = np.random.default_rng(0).normal(size=(30, n, 5))
    lowest = [Selection(part[:, :2], {"two": part[:, 2:4]}, 0).lowest_log_p(part[:, 4:])[0] for part in drawn]
    assert all((log_p < 0) == tested for log_p in lowest)


@pytest.mark.parametrize("seed", [4, 10])  # Sidak's formula begins above the draws' share, or below
def test_family_wise_p_counts_draws_and_beyond_them_is_sidaks(seed):
    """Against the same draws, of one group with two numbers: the tail of F is then a power."""
    rng = np.random.default_rng(5)
    nuisance, columns = rng.normal(size=(N, 3)), rng.normal(size=(N, 2))
    selection = Selection(nuisance, {"two": columns}, seed)
    draws = np.random.default_rng(seed).standard_normal((N, 1000))
    rss = [np.sum(without(some, draws) ** 2, axis=0) for some in (nuisance, np.hstack([nuisance, columns]))]
    lowest = np.sort((N - 5) / 2 * np.log(rss[1] / rss[0]))
    tests = np.log(0.9) / np.log(1 - np.exp(lowest[100]))

    def sidak(log_p):
        return -np.expm1(tests * np.log1p(-np.exp(log_p)))

    for number in (10, 11, 300, 999):
        assert selection.family_wise(lowest[number] + 1e-9) == pytest.approx((number + 2) / 1001)
    assert selection.family_wise(lowest[10] + 1e-9) > selection.family_wise(lowest[10] - 1e-6)
    for log_p in (-20.0, -300.0):
        assert selection.family_wise(log_p) == pytest.approx(sidak(log_p), rel=1e-9)
    assert selection.family_wise(lowest[10] - 1e-6) == pytest.approx(min(11 / 1001, sidak(lowest[10])), 1e-4)
    assert selection.family_wise(-1e6) == pytest.approx(tests * np.exp(-700), rel=1e-6)
    assert selection.p_value(residuals()) == selection.family_wise(float(selection.lowest_log_p(residuals(1))[0]))


def leaning(share, onto):
    """A column of which ``share`` stands beside the columns."""
    free = without(onto, np.random.default_rng(6).normal(size=len(onto)))
    return (onto[:, 0] / np.linalg.norm(onto[:, 0]) + share * free / np.linalg.norm(free))[:, None]


def test_a_direction_of_which_too_little_remains_is_unobservable():
    nuisance, _ = design()
    allowances, free = (np.random.default_rng(seed).normal(size=(N, 2)) for seed in (9, 5))
    for share, kept in ((0.9e-4, []), (1.1e-4, [1])):
        assert [basis.shape[1] for basis in Selection(nuisance, {"one": leaning(share, nuisance)}, 0).groups.values()] == kept
    both = np.hstack([allowances, nuisance])
    for share, along, tested in ((0.9e-3, (), False), (1.1e-3, (), True), (0.9e-3, ("one",), True)):
        selection = Selection(nuisance, {"one": leaning(share, both)}, 0, allowances=allowances, along=frozenset(along))
        assert (selection.lowest_log_p(residuals(1))[0] < 0) == tested
    assert orthonormal(np.diag([1e-10, 1.0])).shape == (2, 2)  # whatever the columns' units
    groups = {"nothing": np.zeros((N, 3)), "half": np.hstack([nuisance[:, :1], 1e-7 * free]), "twice": np.hstack([free, free])}
    assert {name: basis.shape[1] for name, basis in Selection(1e5 * nuisance, groups, seed=0).groups.items()} == {"half": 2, "twice": 2}


def test_the_noise_scale_comes_from_known_angles_and_stills_rates():
    """Not from the length of gravity, nor from an angle that no reference observes; a bent accelerometer is tested along the allowances."""
    twin = linear_twin(wide=True)
    twin.batch.known[[2, 5], 1] = False
    tried = [effect("a", 2), effect("b", 1, kind="force", bends=lambda force: None)]
    found = twin.evidence().nothing
    whiten, fit = found.whiten, found.fit
    selection = selection_of(twin, whiten, fit, tried, 3)
    rows = np.delete(np.arange(16 + 27), [5, 11])
    by_hand = Selection(
        fit.J,
        {i: whiten(twin.columns_of(each)) for i, each in enumerate(tried)},
        3,
        allowances=whiten(twin._allowed),
        scale_rows=rows,
        along=frozenset({1}),
    )
    r = np.random.default_rng(1).normal(size=(twin.n, 5))
    assert_allclose(selection.lowest_log_p(r), by_hand.lowest_log_p(r), rtol=1e-6)


def bump(center, n, width=6.0):
    return np.exp(-(((np.arange(n) - center) / width) ** 2))[:, None]


def test_a_replay_is_of_its_fit_and_of_fits_with_the_same_states_alone():
    fit = linear_twin().evidence().nothing.fit
    replay = Replay(linear_twin(), fit)  # whose rates are its state
    other = fit.state.with_vector(fit.state.vector + 1.0)
    assert replay.of(replace(fit, chi_square=0.0)) is replay
    assert replay.of(replace(fit, state=other)).rates is other
    assert replay.of(replace(fit, columns_at=other)).fit.columns_at is other


@pytest.mark.parametrize(("grid", "truth"), [(np.array([8.0, 20.0, 30.0]), 27.3), (np.array([8.0, 20.0, 22.0]), 11.1)])
def test_a_scanned_shape_is_refined_between_its_neighbours_to_a_five_hundredth(grid, truth):
    columns = lambda each: bump(each.shape["at_s"] * 1e-3, columns.rows)  # noqa: E731
    twin = linear_twin(columns=columns)
    step = stepped("step", grid)
    twin.recorded = 0.01 * twin.recorded
    twin.spoil(step.at(truth), 1.0)
    nothing = twin.evidence().nothing
    found = sharpened(twin, nothing.whiten, nothing.fit, step.at(20.0), Replay(twin, nothing.fit))
    # Noise of a hundredth moves it by less than the grid's own step.
    assert found.shape["at_s"] * 1e-3 == pytest.approx(truth, abs=spacing(grid, 20.0) / 504 + 0.02)
    plain = effect("plain")
    assert sharpened(twin, nothing.whiten, nothing.fit, plain, None) is plain


@pytest.mark.parametrize(
    ("values", "at", "reach"),
    [([1, 2, 4, 8], 4, 3.6), ([1, 2, 4, 8], 1, 0.9), ([10, 11, 13], 11, 2), ([10, 11, 13], 13, 2), ([-1, 0, 2], 0, 2), ([5], 5, 0)],
)  # fmt: skip
def test_a_grid_reaches_to_the_farther_neighbour_and_not_to_zero(values, at, reach):
    assert spacing(np.array(values, dtype=float), at) == pytest.approx(reach)


def test_the_linear_estimate_is_a_ridge_regression():
    """Prior of ten plausible sizes, beside columns without a prior."""
    rng = np.random.default_rng(0)
    r, J, columns = rng.normal(size=20), rng.normal(size=(20, 4)) * [1e-6, 1, 10, 1e5], rng.normal(size=(20, 2))
    theta, covariance = linear_estimate(r, J, columns, 0.03)
    prior = np.hstack([np.zeros((2, 4)), np.eye(2) / 0.3])
    both = np.vstack([np.hstack([J / np.linalg.norm(J, axis=0), columns]), prior])
    assert_allclose(theta, -np.linalg.lstsq(both, np.r_[r, 0, 0], rcond=None)[0][4:], rtol=1e-9)
    assert_allclose(covariance, np.linalg.inv(both.T @ both)[4:, 4:], rtol=1e-9)


# Evidence.


def of_scale(P):
    """-2 log of the best scale's share in the integral over all scales: Laplace's formula, which takes it for 1."""
    return -2 * ((P / 2) * np.log(P) - P / 2 - (P / 2 - 1) * np.log(2) - special.gammaln(P / 2))


def spoilt_twin(*spoilt, seed=0):
    twin = linear_twin(seed=seed)
    for each, theta in spoilt:
        twin.spoil(each, theta)
    return twin


def sizes(hypothesis):
    return [claim.theta for claim in hypothesis.fit.state.claims]


def of_calibration(twin, hypothesis):
    """What the wide prior of the calibration takes off the density: the score leaves it out."""
    moved = (hypothesis.fit.state.vector[:15] - twin.start().vector) / PRIORS
    return float(moved @ moved - moved[12:14] @ moved[12:14])


@pytest.mark.parametrize(("size", "shapes"), [(1, 1), (3, 40)])
def test_the_least_gain_is_that_at_which_an_effect_is_as_probable_as_none(size, shapes):
    gain = least_gain(size, shapes)
    ratio = np.exp(gain / 2) * (gain / size) ** (-size / 2) * np.exp(-size / 2) / 10 / 30 / shapes
    assert ratio == pytest.approx(1, rel=1e-9)
    assert gain > size  # the larger root: a smaller gain is no more than chance gives


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
    assert_allclose(sizes(found)[0], theta, atol=0.6)
    for each, one in ((evidence.nothing, ()), (found, (name,))):  # the noise is estimated anew for each
        sigma = [evidence.prior(each.fit)[-1]] * len(one)
        best = optimize.minimize(
            lambda s, one=one, sigma=sigma: minus_twice_log(twin, s, one, sigma), each.noise.s + 0.5, method="Nelder-Mead"
        )
        left = best.fun - of_calibration(twin, each) - sum(map(len, sizes(each)))
        assert each.score - sum(map(evidence.price, one)) == pytest.approx(left, abs=0.1)


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


def test_a_guess_by_linear_columns_is_the_score_where_all_is_linear_and_nothing_is_weighed_twice():
    twin = spoilt_twin((A, [6.0, -4.0]), (B, [5.0, 4.0, -6.0]), (C, [4.0]))
    evidence, exact = twin.evidence(), twin.evidence()
    both = evidence.of((A, B), evidence.nothing)
    for how, effects in (({"add": C}, (A, B, C)), ({"without": A}, (B,)), ({"without": B, "add": C}, (A, C))):
        guess = evidence.guess(both, **how)
        assert guess.effects == effects
        assert guess.score == pytest.approx(exact.of(effects, exact.nothing).score, abs=1.5)
        assert evidence.guess(both, **how) is guess
    assert evidence.guess(both, without=B).score == pytest.approx(evidence.of((A,), both).score, abs=1.5)
    assert evidence.guess(both, without=B).score == evidence.of((A,), both).score  # known by now
    assert evidence.of((B, A), evidence.nothing) is both
    everything = {"", "a", "b", "ab", "ac", "abc"}
    assert {"".join(sorted(name[-1] for name in h.ids)) for h in evidence.weighed} == everything
    evidence.forget(frozenset({B.id}))
    assert {"".join(sorted(name[-1] for name in h.ids)) for h in evidence.weighed} == {"", "a", "ac"}
    np.testing.assert_array_equal(evidence.columns(A), twin.columns_of(A))


def test_an_effect_pays_for_every_shape_that_was_tried_under_its_name():
    """Shapes at values that differ are different hypotheses."""
    step = stepped("step", np.array([1.0, 2.0, 5.0]))
    twin = spoilt_twin((step.at(1.0), [5.0]))
    evidence = twin.evidence()
    assert evidence.price(C) == price(C.parameter.size, 1)
    evidence.will_try([C, effect("c", 1, equation="another"), *step.variants(np.array([1.0, 2.0, 5.0]))])
    assert evidence.price(C) - price(C.parameter.size, 1) == pytest.approx(2 * np.log(2))
    assert evidence.price(step) == price(step.parameter.size, 3)
    right, wrong = (evidence.of((step.at(at),), evidence.nothing) for at in (1.0, 2.0))
    assert right is evidence.of((step.at(1.0),), evidence.nothing)
    assert right.score < min(evidence.nothing.score, wrong.score) - 20


# The search, by tables of scores.


NAMES = "abcdef"
EFFECTS = {name: effect(name) for name in NAMES}
LATE = Convention(lambda theta: theta, lambda theta: np.eye(1), delays=(0,))
DELAYS = {name: effect(name, gauge_convention=LATE) for name in NAMES}


Fit = make_dataclass("Fit", ["r", "J", "state"])


class Scores:
    """Evidence by tables: exact scores of sets of names, 1000 where none is given; guesses differ from them by ``off``."""

    def __init__(self, scores, off=None, effects=EFFECTS):
        self.scores, self.off, self.effects, self.weighed, self.removed = scores, off or {}, effects, [], []
        self.basis = np.linalg.qr(np.random.default_rng(0).normal(size=(30, 21)))[0]
        self.whiten = self.first_whiten = SimpleNamespace(each=iter)
        self.twin = None

    def named(self, names):
        return self.of(tuple(self.effects[name] for name in names), None)

    def _key(self, effects):
        return "".join(sorted(each.id[-1] for each in effects))

    def of(self, effects, begin):
        key = self._key(effects)
        self.weighed.append(key)
        found = Guess(tuple(effects), self.scores.get(key, 1000.0))
        claims = tuple(SimpleNamespace(effect=each, theta=np.ones(1)) for each in effects)
        # Every effect promises as much as the others: its column, of length one, is hit by a hundred sigmas.
        columns = np.stack([self.columns(each)[:, 0] for each in effects], axis=1) if effects else np.zeros((30, 0))
        J = np.hstack([self.basis[:, 6:], columns])
        fit = Fit(100 * self.basis[:, :6].sum(axis=1), J, SimpleNamespace(claims=claims))
        return _Hypothesis(found.effects, found.score, fit, self.whiten)

    def guess(self, have, *, without=None, add=None):
        effects = tuple(e for e in have.effects if e is not without) + ((add,) if add else ())
        key = self._key(effects)
        return Guess(effects, self.scores.get(key, 1000.0) + self.off.get(key, 0.0))

    def columns(self, each):
        return self.basis[:, [NAMES.index(each.id[-1])]]

    def price(self, each):
        return 0.0

    def will_try(self, tried):
        self.tried = tried


class _Hypothesis(Guess):
    def __init__(self, effects, score, fit, whiten):
        self.__dict__ |= {"effects": effects, "score": score, "fit": fit, "whiten": whiten}


def names_of(hypothesis):
    return "".join(sorted(name[-1] for name in hypothesis.ids))


def table_of(scores, off=None, effects=EFFECTS):
    return Scores({"": 0.0, **scores}, off, effects)


def found(scores, tried="abc", off=None, effects=EFFECTS, **options):
    table = table_of(scores, off, effects)
    best = search(table, [effects[name] for name in tried], table.named(""), **options)
    return names_of(best), table.weighed[1:]


def kept(names, *scores):
    table = table_of(*scores)
    return names_of(without_idle(table, table.named(names)))


def in_place_of(names, *scores):
    table = table_of(*scores)
    return names_of(exchanged(table, list(table.effects.values()), table.named(names)))


def test_effects_are_added_while_each_adds_evidence():
    chain = {"a": -10.0, "ab": -20.0, "abc": -30.0, "abcd": -40.0, "abcde": -50.0, "abcdef": -60.0}
    assert found(chain, NAMES)[0] == "abcde"
    assert found(chain, NAMES, most=2)[0] == "ab"
    assert found({"a": -10.0, "ab": -10.0})[0] == "a"
    assert found({"a": 0.0})[0] == ""
    third = {"a": -40.0, "b": -39.0, "c": -38.0, "ab": -30.0, "ac": -30.0, "bc": 0.0, "cd": -90.0}
    assert found(third, "abcd")[0] == "a"  # a third beginning is not followed
    assert found(chain, "")[0] == ""


@pytest.mark.parametrize(("second", "expected"), [(-28.1, "bc"), (-28.0, "a")])
def test_a_second_best_beginning_is_followed_if_it_is_near(second, expected):
    """Within 12; the best has no better continuation, the second has."""
    scores = {"a": -40.0, "b": second, "c": 0.0, "bc": -90.0, "ac": -38.0, "ab": -38.0}
    assert found(scores, off={"b": -10.0})[0] == expected


def test_the_best_by_linear_columns_and_those_near_it_are_evaluated_exactly():
    """Up to three, and within 8 of the best guess."""
    far = {"a": -40.0, "b": -20.0, "c": -10.0}
    for scores, tried, effects, weighed in (
        ({"a": -40.0, "b": -32.1, "c": -32.0}, "abc", EFFECTS, "ab"),
        ({name: -40.0 + k for k, name in enumerate(NAMES)}, NAMES, EFFECTS, "abc"),
        (far, "abc", DELAYS, "abc"),  # of delays, all, if one is near: linear columns rank them poorly
        (far, "abc", {**EFFECTS, "b": DELAYS["b"]}, "a"),
    ):
        assert set(found(scores, tried, most=1, effects=effects)[1]) == set(weighed)
    assert found({"a": -40.0, "b": -30.0}, off={"b": -15.0})[0] == "a"  # what counts is the exact score


def test_what_others_make_redundant_is_taken_out():
    """Where the guess without it is within 4 of the best; of two delays each is tried without; one effect alone stays."""
    scores = {"abc": -100.0, "ab": -120.0, "a": -50.0, "b": -50.0}
    assert [kept("abc", scores, {"ab": off}) for off in (23.9, 24.0)] == ["ab", "abc"]
    assert kept("a", {"": -500.0, "a": -10.0}) == "a"
    two = {"ab": -100.0, "a": -110.0}, {"a": 200.0, "b": 200.0}
    assert kept("ab", *two, DELAYS) == "a"
    assert kept("ab", *two, {**EFFECTS, "b": DELAYS["b"]}) == "ab"


def test_an_effect_gives_place_to_one_that_fits_in_its_place():
    """Where the guess is within 8 of the best, or of two delays; the exact score decides."""
    scores = {"a": -100.0, "c": -110.0}
    assert [in_place_of("a", scores, {"c": off}) for off in (17.9, 18.0)] == ["c", "a"]
    assert in_place_of("a", scores, {"c": 110.0}, DELAYS) == "c"
    assert in_place_of("a", scores, {"c": 110.0}, {**EFFECTS, "c": DELAYS["c"]}) == "a"
    chain = {"ab": -100.0, "bc": -110.0, "cd": -120.0, "c": -130.0}  # exchanges go on while they gain, and take out what is idle
    assert in_place_of("ab", chain) == "c"


@pytest.mark.parametrize(
    ("best", "scores", "known", "expected"),
    [
        ("a", {"a": -50.0, "ae": -60.0}, {}, "ae"),
        ("a", {"a": -50.0, "ae": -60.0, "abe": -80.0}, {}, "abe"),  # beside a shape another name may enter
        ("a", {"a": -100.0, "ae": -50.0, "e": -120.0}, {"off": 79.9}, "e"),  # in its place, where the guess is within 60
        ("a", {"a": -100.0, "ae": -50.0, "e": -120.0}, {"off": 80.1}, "a"),
        ("", {"f": -40.0}, {"first_p": 0.049}, "f"),  # lines, if something is left that nothing explains
        ("", {"f": -40.0}, {"first_p": 0.051}, ""),
        ("", {"f": -40.0}, {"first_p": 0.051, "unusual": True}, "f"),
        ("a", {"a": -50.0, "af": -90.0}, {"first_p": 0.0}, "a"),
        ("a", {"a": -50.0, "af": -90.0}, {"unusual": True}, "af"),
    ],
)
def test_shapes_without_a_name_are_tried_beside_the_names_and_in_their_place(best, scores, known, expected):
    shapes = {name: effect(name) for name in "ef"}
    for name, shape in shapes.items():
        object.__setattr__(shape, "id", f"unknown.{name}")
    table = Scores({"": 0.0, **scores}, {"e": known.get("off", 0.0)}, {**EFFECTS, **shapes})
    table.nothing = table.named("")
    with (
        patch.object(decision, "slow_candidates", lambda twin: [shapes["e"]]),
        patch.object(decision, "unknown_candidates", lambda twin: list(shapes.values())),
        patch.object(_Hypothesis, "noise", SimpleNamespace(unusual=known.get("unusual", False)), create=True),
    ):
        tried = [EFFECTS[name] for name in "abc"]
        assert names_of(_beyond_the_catalogue(table, tried, table.named(best), known.get("first_p", 1.0))) == expected


def test_the_search_finds_the_best_of_all_subsets_and_their_probabilities():
    """The headline of naming, in a recording small enough to try everything: each name has the share of the subsets that have it."""
    tried, true = {name: effect(name, 1 + (name == "b")) for name in "abc"}, "ac"
    twin = spoilt_twin(*((tried[name], [6.0]) for name in true), seed=11)
    evidence, everything = twin.evidence(), twin.evidence()
    best = search(evidence, list(tried.values()), evidence.nothing)
    subsets = [some for size in range(4) for some in combinations(tried, size)]
    everything.will_try(list(tried.values()))
    exact = [everything.of(tuple(tried[name] for name in some), everything.nothing) for some in subsets]
    assert names_of(best) == names_of(min(exact, key=lambda h: h.score)) == true
    weights = np.exp(-np.array([h.score - best.score for h in exact]) / 2)
    chance = probabilities(evidence.weighed)
    for name in tried:
        by_hand = weights[[name in some for some in subsets]].sum() / weights.sum()
        assert chance.get(f"test.{name}", 0.0) == pytest.approx(by_hand, abs=0.03)
        assert (by_hand > 0.5) == (name in true)


def test_the_detection_limit_removes_the_least_gain_along_half_of_the_directions():
    """Of every candidate, up to its plausible size; a scanned one by its best shape."""
    twin = Twin(small_session())
    whiten = known_whitener(twin)
    fit = refit(twin, whiten, [], twin.start())
    q, replay, tried, sizes = np.linalg.qr(fit.J)[0], Replay(twin, fit), candidates(twin), {}
    for each in tried:
        own = whiten(replay.columns(each).stacked())
        strength = np.median(np.linalg.svd(own - q @ (q.T @ own), compute_uv=False)) * each.parameter.plausible
        least = np.sqrt(least_gain(each.parameter.size, sum(other.id == each.id for other in tried)))
        size = least / strength * each.parameter.plausible / each.parameter.si if strength > least else np.inf
        sizes[each.id] = min(size, sizes.get(each.id, np.inf))
    assert detection_limits(twin, whiten, fit) == pytest.approx(sizes)
    assert 0 < np.isfinite(list(sizes.values())).sum() < len(sizes) < len(tried)


def guess(score, *names):
    return Guess(tuple(SimpleNamespace(id=name) for name in names), score)


def test_probabilities_are_those_of_the_hypotheses_that_have_the_name():
    shares = (0.4, "a"), (0.3, "b"), (0.2, "ab"), (0.1, "")
    for shift in (-1e5, 0.0, 1e5):
        odds = [guess(shift - 2 * np.log(share), *names) for share, names in shares]
        assert probabilities(odds) == pytest.approx({"a": 0.6, "b": 0.5, "": 0.1})  # both at once are counted twice
    assert probabilities([guess(0.0, "a"), guess(5000.0)]) == pytest.approx({"a": 1.0, "": 0.0})


def test_a_rival_is_what_stands_in_the_same_place_beside_the_same_others():
    best = guess(10.0, "a", "b")
    others = ((13.0, "cb"), (12.0, "cb"), (12.5, "cb"), (11.0, "c"), (11.5, "b"), (10.5, "ad"), (9, "abd"), (8, "cdb"))
    weighed = [best, *(guess(score, *names) for score, names in others)]
    assert rivals_of(weighed, best, best.effects[0].id) == {"c": 2.0}
    assert rivals_of(weighed, best, best.effects[1].id) == {"d": 0.5}
