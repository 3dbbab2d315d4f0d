"""The engine by small exact problems: evidence by quadrature, chance by counting, folds by refitting without them."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import integrate, linalg, stats

from tinygc.inference.choose import (
    LEVEL,
    ONE_VALUE,
    SCALES,
    STEPS,
    Selection,
    Standing,
    averaged,
    chance_of_any,
    chi_square_above,
    climb,
    divided,
    each_alone,
    factors_by_freedom,
    factors_by_size,
    level_of_each,
    linear_estimate,
    log_evidence,
    of_any_scale,
    penalty,
    probabilities,
    promised,
    scales_of,
    standing_of,
    tail,
    weights_of,
)
from tinygc.inference.decide import KINDS, Answer, rms_below
from tinygc.inference.noise import Banded, Cost, Sparse, Striped, estimate, lowest, where_risen
from tinygc.inference.prove import folds_of, left_out, signed_ranks_above
from tinygc.inference.solve import coverage_factor, freedom_of, left_of, orthonormal, root, solve


def density(r, covariance):
    return float(stats.multivariate_normal(np.zeros(len(r)), covariance).logpdf(r))


def test_the_evidence_is_the_density_with_the_prior_over_that_without():
    rng = np.random.default_rng(1)
    X, noise = rng.normal(size=(7, 3)), np.eye(7) * 0.5
    scales = np.array([[0.3, 0.3, 2.0], [1.0, 1.0, 1e-9]])
    r = rng.normal(size=7)
    white, w = X / np.sqrt(0.5), r / np.sqrt(0.5)
    found = log_evidence(white.T @ white, white.T @ w, scales)
    for each, of in zip(found, scales, strict=True):
        assert each == pytest.approx(density(r, noise + (X * of**2) @ X.T) - density(r, noise))


def test_scales_are_even_in_their_logarithm_over_the_range_and_one_for_each_hypothesis():
    assert STEPS[0] == 1
    assert np.log(STEPS[0] / STEPS[-1]) == pytest.approx(SCALES)
    both = scales_of([1, 2])
    assert both.shape == (len(STEPS) ** 2, 3)
    assert_allclose(both[:, 1], both[:, 2])
    assert len({tuple(row) for row in both}) == len(STEPS) ** 2
    assert scales_of([]).shape == (1, 0)


@pytest.mark.parametrize("size", [1, 3])
def test_the_mean_over_scales_is_the_gain_less_the_penalty(size):
    # y z-scores in each of ``size`` directions whose sigma is 1e-3 of the plausible size
    rng = np.random.default_rng(size)
    z = 25 * rng.normal(size=size)
    information = np.eye(size) * 1e6
    exact, _ = integrate.quad(
        lambda u: np.exp(log_evidence(information, 1e3 * z, np.full((1, size), np.exp(-u)))[0] - z @ z / 2), 0, SCALES, limit=400
    )
    gain = float(z @ z)
    assert 2 * np.log(exact / SCALES) + gain == pytest.approx(promised(gain, size) - penalty(size, 1), abs=1.5)


def test_the_evidence_of_any_scale_is_the_integral_over_the_noise():
    """Of nu readings with squares S: of s^-nu exp(-S / 2 s^2) over ln s, twice; each number in it costs the width of its prior."""
    for squares, freedom in ((3.0, 7.0), (40.0, 12.5)):
        exact, _ = integrate.quad(lambda s: s ** (-freedom - 1) * np.exp(-squares / 2 / s**2), 0, np.inf, limit=400)  # noqa: B023
        assert of_any_scale(squares, freedom, 0, 9.0) == pytest.approx(-2 * np.log(2 * exact), rel=1e-7)
        assert of_any_scale(squares, freedom, 3, 9.0) - of_any_scale(squares, freedom, 0, 9.0) == pytest.approx(3 * np.log(9))
    assert weights_of([3.0, 1.0, 1.0]) == pytest.approx(np.array([np.exp(-1), 1, 1]) / (2 + np.exp(-1)))


def test_a_promise_costs_each_parameter_the_logarithm_of_its_signal_to_noise_ratio():
    assert promised(40.0, 2) == pytest.approx(40 - 2 * np.log(20))
    assert promised(0.5, 1) == 0.5


@pytest.mark.parametrize(
    ("more", "scale"),
    [({"is_known": True}, 1.0), ({}, 3.0), ({"further": (0.0, 0.0)}, 0.2)],
    ids=["known noise", "noise larger than stated", "smaller"],
)
def test_the_chance_of_the_best_is_uniform_where_nothing_is_missing(more, scale):
    rng = np.random.default_rng(5)
    nuisance, groups = rng.normal(size=(30, 4)), {i: rng.normal(size=(30, 1 + i % 3)) for i in range(12)}
    selection = Selection(nuisance, groups, 2, **more)
    found = [selection.p_value(scale * rng.normal(size=30) + nuisance @ [5, 0, 1, 2]) for _ in range(400)]
    assert stats.kstest(found, "uniform").pvalue > 0.01


def test_known_noise_that_is_larger_than_stated_is_seen_and_own_scale_is_blind_to_it():
    rng = np.random.default_rng(7)
    groups = {i: rng.normal(size=(30, 2)) for i in range(5)}
    r = 3 * rng.normal(size=30)
    assert Selection(np.zeros((30, 0)), groups, 0, is_known=True).p_value(r) < LEVEL
    assert Selection(np.zeros((30, 0)), groups, 0).p_value(r) > LEVEL


def test_a_chance_too_small_for_a_number_has_its_logarithm():
    column = {0: np.eye(4)[:, :2]}
    r = np.array([40.0, 50.0, 1.0, 2.0])[:, None]
    known = Selection(np.zeros((4, 0)), column, 0, is_known=True).lowest_log_p(r)
    assert known[0] == pytest.approx(-(40**2 + 50**2) / 2)


def test_squares_beside_the_residuals_count_with_their_freedom():
    column = {0: np.eye(3)[:, :1]}
    r = np.array([2.0, 1.0, -1.0])
    own = float(np.exp(Selection(np.zeros((3, 0)), column, 0, further=(6.0, 4.0)).lowest_log_p(r[:, None])[0]))
    assert own == pytest.approx(stats.f.sf(4.0 / ((2.0 + 6.0) / (2 + 4)), 1, 6))


def test_only_directions_are_tested_in_which_a_plausible_change_is_seen():
    X = np.zeros((5, 2))
    X[0, 0], X[1, 1] = 3.0, 0.5
    assert left_of(np.zeros((5, 0)), X, seen=1.0).shape == (5, 1)
    assert left_of(np.zeros((5, 0)), X).shape == (5, 2)
    selection = Selection(np.zeros((5, 0)), {"x": X, "unseen": X[:, 1:]}, 0, is_known=True, seen=1.0)
    assert list(selection.groups) == ["x"]
    assert selection.gains(np.array([2.0, 9.0, 0, 0, 0])) == {"x": pytest.approx(4.0)}


def test_a_tail_with_uncertain_variances_is_that_of_fisher_and_of_chi_square():
    draws = 40_000
    part = np.eye(2)
    found = tail(9.0, np.zeros((2, 2)), [(part, factors_by_freedom(6, 3, draws))])
    assert found == pytest.approx(stats.f.sf(4.5, 2, 6), rel=0.05)
    sized = factors_by_size(1.0, 0.3, 3, draws)
    assert np.mean(sized) == pytest.approx(1 + 0.09, rel=0.02)
    assert tail(9.0, part, []) == pytest.approx(stats.chi2.sf(9, 2))
    assert tail(0.0, part, [(part, sized)]) == 1.0
    assert tail(1e9, part, [(part, sized)]) == pytest.approx(1 / (draws + 1))
    assert np.mean(factors_by_size(0.0, 0.01, 4, draws) == 0) == pytest.approx(0.5, abs=0.01)


def test_the_level_of_each_of_several_tests():
    assert 1 - (1 - level_of_each(0.05, 4)) ** 4 == pytest.approx(0.05)
    assert level_of_each(0.05, 0) == pytest.approx(0.05)
    assert chance_of_any(level_of_each(0.05, 4), 4) == pytest.approx(0.05)
    assert chance_of_any(1.0, 4) == 1.0


@dataclass(frozen=True)
class Several:
    ids: frozenset[str]
    score: float


def test_each_column_alone_is_least_squares_of_it_beside_what_is_fitted_with_it():
    rng = np.random.default_rng(7)
    r, J, columns = rng.normal(size=9), rng.normal(size=(9, 2)), rng.normal(size=(9, 3))
    columns[:, 2] = J @ [1.0, -2.0]
    pull, information = each_alone(r, J, columns)
    for k in range(2):
        design = np.column_stack([J, columns[:, k]])
        solution, (left,), *_ = np.linalg.lstsq(design, r)
        assert pull[k] / information[k] == pytest.approx(solution[-1])
        assert 1 / information[k] == pytest.approx(np.linalg.inv(design.T @ design)[-1, -1])
        assert pull[k] ** 2 / information[k] == pytest.approx(np.linalg.lstsq(J, r)[1][0] - left)
    assert np.isnan(information[2])


def test_climbing_takes_single_steps_to_the_set_of_most_evidence():
    score = {"": 10.0, "a": 6.0, "b": 7.0, "ab": 1.0, "c": 8.0, "abc": 1.5, "ac": 6.5, "bc": 9.0}

    def of(names):
        return Several(names, score["".join(sorted(names))])

    def near(best):
        return [of(best.ids ^ {name}) for name in "abc"]

    assert climb(of(frozenset()), near).ids == {"a", "b"}
    assert climb(of(frozenset("abc")), near).ids == {"a", "b"}


def test_probabilities_and_the_average_over_sets():
    sets = [Several(frozenset(), 2 * np.log(2)), Several(frozenset("a"), 0.0), Several(frozenset("ab"), 2 * np.log(2))]
    assert probabilities(sets) == pytest.approx({"": 0.25, "a": 0.75, "b": 0.25})
    mean, sigma = averaged(np.array([0.25, 0.75]), np.array([0.0, 2.0]), np.array([0.1, 0.2]))
    assert mean == pytest.approx(1.5)
    assert sigma**2 == pytest.approx(0.25 * (0.01 + 2.25) + 0.75 * (0.04 + 0.25))


def test_scoring_ends_at_the_minimum_within_its_bounds():
    def cost(x):
        return Cost(float(np.sum((x - [3.0, -1.0]) ** 2)) / 8, (x - [3.0, -1.0]) / 4, np.eye(2) / 4)

    x, found = lowest(cost, np.array([1.0, 1.0]), most=2.0)
    assert_allclose(x, [2.0, 0.0])
    assert found.value == pytest.approx(0.25)
    slow, _ = lowest(cost, np.array([0.0, 0.0]), -9.0, steps=2, farthest=0.5)
    assert_allclose(slow, [1.0, -1.0])


@pytest.mark.parametrize("step", [0.1, 1.0, 30.0])
def test_a_limit_is_where_the_likelihood_has_risen(step):
    assert where_risen(lambda s: (s - 2.0) ** 2 / 9, 2.0, step, 1.645**2) == pytest.approx(2 + 3 * 1.645, rel=2e-3)
    assert where_risen(lambda s: 1 - np.exp(-s), 0.0, step, 2.0) == np.inf


def test_rows_left_out_are_those_that_a_fit_without_them_predicts():
    rng = np.random.default_rng(3)
    J, root = rng.normal(size=(12, 3)), np.tril(0.2 * rng.normal(size=(12, 12))) + np.eye(12)
    C = root @ root.T
    y = J @ [1.0, -2.0, 0.5] + root @ rng.normal(size=12)
    P = np.linalg.inv(C)
    at = np.linalg.solve(J.T @ P @ J + np.eye(3), J.T @ P @ y)
    r = y - J @ at
    # The parameters' priors: at the optimum the rows' pull is theirs.  Rows here are about zero parameters, as priors are.
    parts = folds_of(12, 4)
    found = left_out(r, J, P, P @ r, P @ J, parts)
    for rows in parts:
        kept = np.setdiff1d(np.arange(12), rows)
        own = np.linalg.inv(C[np.ix_(kept, kept)])
        without = np.linalg.solve(J[kept].T @ own @ J[kept] + np.eye(3), J[kept].T @ own @ y[kept])
        assert_allclose(found[rows], y[rows] - J[rows] @ without, atol=1e-12)


def test_folds_are_every_tenth_part_and_hold_each_once():
    parts = folds_of(23)
    assert len(parts) == 10
    assert_allclose(parts[3], [3, 13])
    assert sorted(np.concatenate(parts).tolist()) == list(range(23))
    assert len(folds_of(4)) == 4


def test_a_root_is_of_the_nearest_covariance():
    rng = np.random.default_rng(3)
    axes, size = np.linalg.qr(rng.normal(size=(4, 4)))[0], np.array([4.0, 1.0, 0.0, -0.3])
    found = root(axes * size @ axes.T)
    assert_allclose(found, found.T)
    assert_allclose(found @ found, axes * [4.0, 1.0, 0.0, 0.0] @ axes.T, atol=1e-12)


def test_a_basis_leaves_out_what_is_not_there():
    X = np.array([[1.0, 2.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 0.0]])
    assert orthonormal(X).shape == (3, 1)


def test_a_size_is_undecided_until_it_matters():
    assert standing_of(0.5, upper=0.5) is Standing.UNDECIDED
    assert standing_of(0.5, upper=0.5, matters=0.6) is Standing.BOUNDED
    assert standing_of(0.04) is Standing.FOR
    assert standing_of(0.04, p_claimed=0.04) is Standing.AGAINST


def test_one_degree_of_freedom_is_the_least():
    assert coverage_factor(0.3) == coverage_factor(1.0) == pytest.approx(stats.t.ppf(0.975, 1))
    assert coverage_factor(2.9) == pytest.approx(stats.t.ppf(0.975, 2))


def test_a_small_variance_of_a_function_is_itself():
    assert solve(np.eye(2) * 10).variance(np.array([1.0, 2.0])) == pytest.approx(0.05)


def test_sizes_have_a_sigma_only_where_it_is_asked_for():
    r = np.array([1.0, -2.0, 0.5, 1.5])
    found = estimate(r, np.zeros((4, 0)), np.eye(4), [np.eye(4)], np.ones(1), [None], [np.arange(4)])
    assert found.s[0] ** 2 == pytest.approx(np.mean(r**2) - 1, rel=1e-4)
    assert np.isnan(found.sigma).all()


def test_every_answer_has_a_word_and_an_exit_code():
    assert {kind for kind, of in KINDS.items() if of.exit_code == 1} == {"fail", "holds with a new bias", "does not hold"}
    assert all(of.word for of in KINDS.values())
    assert KINDS["undecided"].exit_code == 5
    assert Answer("fail", "above the limit").headline == "FAIL: above the limit"


def test_kept_halves_and_bands_are_the_dense_matrices():
    rng = np.random.default_rng(11)
    root = rng.normal(size=(300, 300))
    V = root @ root.T
    striped = Striped.of(V, 310)
    whole = np.zeros((310, 310))
    whole[:300, :300] = V
    assert sum(stripe.size for stripe in striped.stripes) < 0.75 * V.size
    assert_allclose(striped.dense(), whole)
    of = rng.permutation(310)[:40]
    assert_allclose(striped.block(of), whole[np.ix_(of, of)])
    total = np.ones((310, 310))
    striped.add_to(total, 3.0)
    assert_allclose(total, 1 + 3 * whole)
    along = rng.normal(size=(310, 2))
    banded = Banded(Sparse.of_diagonal(np.arange(310.0)), along)
    dense = np.diag(np.arange(310.0)) + along @ along.T
    assert_allclose(banded.dense(), dense)
    assert_allclose(banded.block(of), dense[np.ix_(of, of)])


def test_what_is_no_number_accuses_nobody():
    groups = {0: np.random.default_rng(1).normal(size=(20, 2))}
    assert np.isnan(Selection(np.ones((20, 1)), groups, 0).p_value(np.full(20, np.nan)))
    assert np.isnan(chi_square_above(np.nan, 3))
    assert chi_square_above(np.inf, 2) == chi_square_above(np.inf, 3) == 0.0
    assert chi_square_above(0.0, 2) == 1.0
    assert signed_ranks_above(np.array([1.0, 2.0, np.nan, 3.0])) == signed_ranks_above(np.array([1.0, 2.0, 3.0]))
    assert coverage_factor(np.nan) == coverage_factor(1.0)  # the widest
    assert np.isnan(freedom_of(1.0, np.nan))


def test_a_column_without_a_direction_of_its_own_takes_none():
    r, own = np.arange(1.0, 6.0), np.eye(5)[:, :1]
    alone = linear_estimate(r, np.zeros((5, 0)), own, 1.0)
    assert_allclose(linear_estimate(r, np.zeros((5, 1)), own, 1.0)[0], alone[0])
    once, twice = (linear_estimate(r, np.ones((5, count)), own, 1.0) for count in (1, 2))
    assert_allclose(once[0], twice[0])
    assert_allclose(once[1], twice[1])
    none = np.column_stack([np.ones(5), np.ones(5), np.zeros(5)])
    assert_allclose(each_alone(r, none, np.eye(5)), each_alone(r, none[:, :1], np.eye(5)))


def test_errors_without_a_sigma_are_below_a_limit_or_not():
    assert rms_below(1.0, (0.1, 0.1, 0.1), (0.0, 0.0, 0.0)) == 1.0
    assert rms_below(0.05, (0.1, 0.1, 0.1), (0.0, 0.0, 0.0)) == 0.0


def test_units_are_divided_by_the_evidence_of_their_values():
    """Of two parameters in three units with a fifth of their errors in common, one of which is apart: by normal densities."""
    rng = np.random.default_rng(3)
    roots, values = 0.03 * rng.normal(size=(3, 2, 2)) + 0.1 * np.eye(2), np.array([[0.9, 0.4], [0.9, 0.4], [-0.7, 0.1]])
    covariances = roots @ roots.transpose(0, 2, 1)
    found = divided(values, covariances, share=0.2)
    halves = [np.linalg.cholesky(each) for each in covariances]
    errors = np.block([[(1.0 if i == j else 0.2) * a @ b.T for j, b in enumerate(halves)] for i, a in enumerate(halves)])
    nothing = density(values.ravel(), errors)
    assert found[0].ids == {ONE_VALUE, "2"}
    for each in found:
        rest = [k for k in range(3) if str(k) not in each.ids]
        apart = linalg.block_diag(*(float(str(k) in each.ids) * np.eye(2) for k in range(3)))
        one = np.kron(np.outer(*2 * [np.isin(range(3), rest)]), np.eye(2)) * (ONE_VALUE in each.ids)
        odds = [
            np.exp(density(values.ravel(), errors + s**2 * apart + t**2 * one) - nothing)
            for s in (STEPS if apart.any() else [0.0])
            for t in (STEPS if one.any() else [0.0])
        ]
        assert each.score == pytest.approx(-2 * (np.log(np.mean(odds)) - len(each.ids) * np.log(30)), rel=1e-6)
    assert not {frozenset({ONE_VALUE, "0", "1"}), frozenset({ONE_VALUE, "0", "1", "2"})} & {each.ids for each in found}
