"""Selection: p-values over a family of candidates that resemble one another."""

import numpy as np
import pytest
from linear_twin import effect, linear_twin, stepped
from scipy import stats

from tinygc.explanation.evidence import (
    Selection,
    _log_f_tail,
    linear_estimate,
    orthonormal,
    selection_of,
    sharpened,
    spacing,
    without_claim,
)
from tinygc.noise.refit import Replay, refit

N = 90


def log_p_of(selection: Selection, r: np.ndarray) -> np.ndarray:
    """(groups, …) logarithm of each group's p-value for residuals r (n, …)."""
    r = r - selection.q @ (selection.q.T @ r)
    rss, found = np.sum(r**2, axis=0), []
    for group in selection.groups:
        rank = group.basis.shape[1]
        freedom, gain = selection.n - selection.q.shape[1] - rank, np.sum((group.basis.T @ r) ** 2, axis=0)
        found.append(_log_f_tail((gain / rank) / np.maximum((rss - gain) / freedom, 1e-300), rank, freedom))
    return np.array(found)


def design(seed: int = 0, n: int = N, groups: int = 9) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    rng = np.random.default_rng(seed)
    shared = rng.normal(size=(n, 3))  # groups that resemble one another, as delays and lags do
    return rng.normal(size=(n, 7)), {
        f"g{i}": rng.normal(size=(n, 1 + i % 4)) + (shared[:, : 1 + i % 4] if i % 4 < 3 else 0) for i in range(groups)
    }


def without(columns: np.ndarray, r: np.ndarray) -> np.ndarray:
    """What least squares leaves of r."""
    return r - columns @ np.linalg.lstsq(columns, r, rcond=None)[0]


@pytest.fixture(scope="module")
def selection():
    return Selection(*design(), seed=1)


@pytest.fixture(scope="module")
def residuals():
    return np.random.default_rng(3).standard_normal(N)


def test_each_group_has_the_p_value_of_fishers_f(selection, residuals):
    nuisance, groups = design()
    least = np.sum(without(nuisance, residuals) ** 2)
    gains = selection.gains(residuals)
    for (name, columns), log_p in zip(groups.items(), log_p_of(selection, 0.01 * residuals), strict=True):  # whatever the residuals' scale
        left, rank = np.sum(without(np.hstack([nuisance, columns]), residuals) ** 2), columns.shape[1]
        freedom = N - 7 - rank
        assert gains[name] == pytest.approx(least - left, rel=1e-9)
        assert log_p == pytest.approx(stats.f.logsf((least - left) / rank / (left / freedom), rank, freedom), rel=1e-9)
    pair = np.stack([residuals, residuals[::-1]], axis=1)
    np.testing.assert_allclose(log_p_of(selection, pair), np.stack([log_p_of(selection, r) for r in pair.T], axis=1), rtol=1e-9)
    np.testing.assert_allclose(
        log_p_of(selection, residuals + 1e3 * nuisance @ np.arange(7)), log_p_of(selection, residuals), rtol=1e-6, atol=1e-9
    )
    lowest = selection.lowest_log_p(np.stack([0.01 * residuals, -2 * residuals], axis=1))
    np.testing.assert_allclose(lowest, log_p_of(selection, residuals).min(), rtol=1e-9)


def test_where_the_tail_underflows_it_is_a_power(selection, residuals):
    """Of two numbers, exactly: (1 + gain / rest)^(-freedom / 2)."""
    nuisance, groups = design()
    strong = 1e5 * groups["g1"].sum(axis=1) + residuals
    left = [np.sum(without(columns, strong) ** 2) for columns in (nuisance, np.hstack([nuisance, groups["g1"]]))]
    log_p = log_p_of(selection, strong)[1]
    assert log_p == pytest.approx(-(N - 9) / 2 * np.log(left[0] / left[1]), rel=1e-6)
    assert log_p < -745  # of which the exponential is zero
    assert selection.groups[int(np.argmin(log_p_of(selection, strong)))].name == "g1"
    # Where nothing is left, a part in a million million counts as left.
    all_of_it = 1e-5 * groups["g1"].sum(axis=1)[:, None]
    assert selection.lowest_log_p(all_of_it)[0] == pytest.approx(-(N - 9) / 2 * np.log1p(1e12), rel=1e-6)


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
    rng = np.random.default_rng(0)
    selection = Selection(rng.normal(size=(n, 2)), {"two": rng.normal(size=(n, 2))}, 0)
    assert (selection.lowest_log_p(rng.normal(size=(n, 1)))[0] < 0) == tested


@pytest.mark.parametrize("seed", [4, 10])  # Sidak's formula begins above the draws' share, or below
def test_family_wise_p_counts_draws_and_beyond_them_is_sidaks(residuals, seed):
    """Against the same draws, of one group with two numbers: the tail of F is then a power."""
    rng = np.random.default_rng(5)
    nuisance, columns = rng.normal(size=(N, 3)), rng.normal(size=(N, 2))
    selection = Selection(nuisance, {"two": columns}, seed)
    draws = np.random.default_rng(seed).standard_normal((N, 1000))
    rss = [np.sum(without(some, draws) ** 2, axis=0) for some in (nuisance, np.hstack([nuisance, columns]))]
    lowest = np.sort((N - 5) / 2 * np.log(rss[1] / rss[0]))
    for number in (10, 11, 300, 999):
        assert selection.family_wise(lowest[number] + 1e-9) == pytest.approx((number + 2) / 1001)
    assert selection.family_wise(lowest[10] + 1e-9) > selection.family_wise(lowest[10] - 1e-6)
    tests = np.log(0.9) / np.log(1 - np.exp(lowest[100]))
    for log_p in (-20.0, -300.0):
        assert selection.family_wise(log_p) == pytest.approx(-np.expm1(tests * np.log1p(-np.exp(log_p))), rel=1e-9)
    assert selection.family_wise(lowest[10] - 1e-6) == pytest.approx(min(11 / 1001, -np.expm1(tests * np.log1p(-np.exp(lowest[10])))), 1e-4)
    assert selection.family_wise(-1e6) == pytest.approx(tests * np.exp(-700), rel=1e-6)
    assert selection.p_value(residuals) == selection.family_wise(float(selection.lowest_log_p(residuals[:, None])[0]))


def test_family_wise_p_is_uniform_where_nothing_is_missing_and_the_smallest_p_value_is_not(selection):
    r = np.random.default_rng(2).standard_normal((N, 10_000))
    lowest = selection.lowest_log_p(r)
    p = np.sort([selection.family_wise(value) for value in lowest])
    assert np.abs(p - np.arange(1, 10_001) / 10_000).max() < 1.63 * np.sqrt(1 / 1000 + 1 / 10_000)  # of two samples, 1 %
    assert np.mean(np.exp(lowest) <= 0.05) > 0.2
    far = -np.concatenate([np.linspace(0.01, 20, 100), np.geomspace(21, 690, 30)])
    assert (np.diff([selection.family_wise(value) for value in far]) <= 0).all()


def leaning(share: float, onto: np.ndarray) -> np.ndarray:
    """A column of which ``share`` stands beside the columns."""
    free = without(onto, np.random.default_rng(6).normal(size=len(onto)))
    return (onto[:, 0] / np.linalg.norm(onto[:, 0]) + share * free / np.linalg.norm(free))[:, None]


def test_a_direction_of_which_too_little_remains_is_unobservable():
    nuisance, _ = design()
    allowances = np.random.default_rng(9).normal(size=(N, 2))
    both = np.hstack([allowances, nuisance])
    for share, kept in ((0.9e-4, 0), (1.1e-4, 1)):
        selection = Selection(nuisance, {"one": leaning(share, nuisance)}, 0)
        assert sum(group.basis.shape[1] for group in selection.groups) == kept
    for share, along, tested in ((0.9e-3, (), False), (1.1e-3, (), True), (0.9e-3, ("one",), True)):
        selection = Selection(nuisance, {"one": leaning(share, both)}, 0, allowances=allowances, along=frozenset(along))
        assert (selection.lowest_log_p(np.random.default_rng(3).normal(size=(N, 1)))[0] < 0) == tested
    free = np.random.default_rng(5).normal(size=(N, 2))
    groups = {"nothing": np.zeros((N, 3)), "half": np.hstack([nuisance[:, :1], 1e-7 * free]), "twice": np.hstack([free, free])}
    assert {group.name: group.basis.shape[1] for group in Selection(1e5 * nuisance, groups, seed=0).groups} == {"half": 2, "twice": 2}
    assert orthonormal(np.diag([1.0, 0.5]), 0.5, scaled=False).shape[1] == 1
    for apart, rank in ((1e-10, 1), (1e-8, 2)):
        assert orthonormal(1e6 * np.column_stack([free[:, 0], free[:, 0] + apart * free[:, 1]])).shape[1] == rank


# Of a recording.


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
    np.testing.assert_allclose(selection.lowest_log_p(r), by_hand.lowest_log_p(r), rtol=1e-6)


def bump(center: float, n: int, width: float = 6.0) -> np.ndarray:
    return np.exp(-(((np.arange(n) - center) / width) ** 2))[:, None]


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
    np.testing.assert_allclose(theta, -np.linalg.lstsq(both, np.r_[r, 0, 0], rcond=None)[0][4:], rtol=1e-9)
    np.testing.assert_allclose(covariance, np.linalg.inv(both.T @ both)[4:, 4:], rtol=1e-9)


def test_a_claim_is_taken_out_of_a_fit():
    twin = linear_twin(seed=2)
    a, b = effect("a", 2), effect("b", 3)
    twin.spoil(a, [6.0, -7.0])
    twin.spoil(b, [1.0, 2.0, 3.0])
    nothing = twin.evidence().nothing
    fit = refit(twin, nothing.whiten, [a, b], twin.start())
    less = without_claim(fit, 0)
    np.testing.assert_allclose(less.r, fit.r - nothing.whiten(twin.columns_of(a)) @ fit.state.claims[0].theta, atol=1e-9)
    np.testing.assert_allclose(less.J[:, 15:], nothing.whiten(twin.columns_of(b)))
