"""Restricted maximum likelihood against its definition with full matrices, direct integration and closed forms."""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.linalg import block_diag, null_space
from scipy.optimize import minimize, minimize_scalar
from scipy.stats import multivariate_normal, norm

from tinygc.noise.reml import Prior, estimate
from tinygc.noise.whitening import Sparse

GROUPS, REPEATS = 12, 5
#: prior of a column, wide enough to be none
FLAT = 1e6
#: of a component of usual size 1: the least variance that is anything
NOTHING = 1e-4


def one_way(seed, between=2.0, within=0.5):
    rng = np.random.default_rng(seed)
    return 3.0 + between * rng.normal(size=(GROUPS, 1)) + within * rng.normal(size=(GROUPS, REPEATS))


def of_groups(y, J=None, steps=60, **more):
    """Sizes of the groups' and the repeats' errors, mean fitted; the base is negligible."""
    n = y.size
    V = [np.kron(np.eye(len(y)), np.ones((y.shape[1], y.shape[1]))), np.eye(n)]
    J = FLAT * np.ones((n, 1)) if J is None else J
    options = {"usual": np.array([1.0, 1.0]), "priors": [None, None], "blocks": [np.arange(n)]} | more
    return estimate(y.ravel(), J, 1e-9 * np.eye(n), V, steps=steps, **options)


class Blocks:
    """Rows in blocks that know nothing of each other, two fitted columns with priors of one, and three components: one that spans a block,
    one of single rows, one that pairs rows."""

    def __init__(
        self, blocks: int = 1, rows: int = 8, seed: int = 0, priors=(None, None, None), usual=(0.5, 2.0, 1.0), true=(0.8, 1.5, 1.0)
    ):
        rng = np.random.default_rng(seed)
        n = blocks * rows
        half = [rng.normal(size=(rows, rows)) for _ in range(blocks)]
        pairs = block_diag(*[np.full((2, 2), 1.0)] * (n // 2))
        self.V = [block_diag(*(h @ h.T / rows for h in half)), np.diag(rng.uniform(0.2, 2, n)), pairs]
        self.base, self.J = np.diag(rng.uniform(0.05, 0.2, n)), rng.normal(size=(n, 2))
        self.usual, self.priors = np.array(usual), list(priors)
        self.blocks = list(np.arange(n).reshape(blocks, rows))
        truth = np.linalg.cholesky(self.covariance(true) + self.J @ self.J.T)
        self.r = truth @ rng.normal(size=n)

    def covariance(self, s) -> np.ndarray:
        return self.base + sum(size**2 * V for size, V in zip(s, self.V, strict=True))

    def estimate(self, **more):
        V = [self.V[0], Sparse.of_diagonal(np.diag(self.V[1])), Sparse.of(self.V[2])]
        return estimate(self.r, self.J, self.base, V, self.usual, self.priors, self.blocks, **more)

    def definition(self, s, rows=slice(None)) -> float:
        """-2 log of the density of r, the columns' coefficients being normal, less n log 2 pi; and the squares of the priors' deviates."""
        total = (self.covariance(s) + self.J @ self.J.T)[rows][:, rows]
        value = np.linalg.slogdet(total)[1] + self.r[rows] @ np.linalg.solve(total, self.r[rows])
        deviates = (np.log(size / p.median) / p.spread for size, p in zip(s, self.priors, strict=True) if p is not None)
        return value + sum(deviate**2 for deviate in deviates)

    def best(self, rows=slice(None)) -> np.ndarray:
        found = minimize(
            lambda root: self.definition(np.abs(root), rows),
            self.usual,
            method="Nelder-Mead",
            options={"xatol": 1e-6, "fatol": 1e-9, "maxiter": 4000},
        )
        return np.abs(found.x)


CASES = {
    "one block": {"seed": 1},
    "three blocks": {"blocks": 3, "seed": 2},
    "with priors": {"seed": 3, "rows": 16, "priors": (Prior(0.3, 0.4), None, Prior(3.0, 0.2))},
}


@pytest.mark.parametrize("case", CASES)
def test_the_estimate_is_the_maximum_of_the_definition_and_its_sigma_the_curvature(case):
    problem = Blocks(**CASES[case])
    found = problem.estimate(with_sigma=True, steps=200)
    assert found.value == pytest.approx(problem.definition(found.s), rel=1e-9)
    best = problem.best()
    assert found.value < problem.definition(best) + 1e-4
    # At the maximum -2 log L is flat to second order: sigmas of 0.05 of their own.
    inside = best > 0.02 * problem.usual
    assert np.abs((found.s - best) / found.sigma)[inside].max() < 0.02
    # The covariance of the variances is twice the inverse of the second derivatives of -2 log L; that of the sizes follows by 1 / 2s.
    step = 1e-3 * found.s[inside] ** 2
    size = found.s[inside] ** 2

    def moved(by):
        s = found.s.copy()
        s[inside] = np.sqrt(size + by)
        return problem.definition(s)

    e = np.diag(step)
    second = [[(moved(a + b) - moved(a - b) - moved(b - a) + moved(-a - b)) / 4 / a.max() / b.max() for a in e] for b in e]
    expected = np.sqrt(2 * np.diag(np.linalg.inv(second))) / 2 / found.s[inside]
    assert found.sigma[inside] == pytest.approx(expected, rel=2e-3)


def test_a_column_is_integrated_over_its_prior():
    """In one dimension, directly: the density of r given the coefficient, times a standard normal."""
    problem = Blocks(seed=4)
    problem.J = problem.J[:, :1]
    found = problem.estimate(steps=3)
    dense = multivariate_normal(np.zeros(len(problem.r)), problem.covariance(found.s))
    scale = dense.pdf(problem.r)
    total, _ = quad(lambda b: dense.pdf(problem.r - problem.J[:, 0] * b) / scale * norm.pdf(b), -8, 8)
    assert found.value == pytest.approx(-2 * np.log(total * scale) - len(problem.r) * np.log(2 * np.pi), rel=1e-7)


def test_the_likelihood_is_that_of_contrasts_without_the_columns():
    """Patterson & Thompson 1971: the likelihood of K'y with K'J = 0, up to a constant of K and J."""
    rng = np.random.default_rng(4)
    y, columns = one_way(2), rng.normal(size=(GROUPS * REPEATS, 3))
    found = of_groups(y, FLAT * columns)
    K = null_space(columns.T)
    C = K.T @ (found.s[0] ** 2 * np.kron(np.eye(GROUPS), np.ones((REPEATS, REPEATS))) + found.s[1] ** 2 * np.eye(y.size)) @ K
    z = K.T @ y.ravel()
    constant = np.linalg.slogdet(columns.T @ columns)[1] + 3 * np.log(FLAT**2)
    assert found.value - constant == pytest.approx(np.linalg.slogdet(C)[1] + z @ np.linalg.solve(C, z), abs=1e-4)


def test_a_long_session_is_searched_in_three_of_its_blocks_and_weighed_by_all():
    """The first, the middle and the last of five; and with two, both."""
    problem = Blocks(blocks=5, rows=6, seed=5)
    found = problem.estimate(steps=200)
    searched = np.concatenate([problem.blocks[i] for i in (0, 2, 4)])
    assert problem.definition(found.s, searched) < problem.definition(problem.best(searched), searched) + 1e-3
    assert found.value == pytest.approx(problem.definition(found.s), rel=1e-9)
    assert problem.definition(found.s) > problem.definition(problem.best()) + 0.05
    two = Blocks(blocks=2, seed=2)
    assert two.estimate(steps=200).value == pytest.approx(two.definition(two.best()), abs=1e-4)


@pytest.mark.parametrize("seed", range(2))
def test_a_balanced_one_way_study_gives_the_analysis_of_variance(seed):
    """Closed form (Searle, Casella & McCulloch 1992, 3.8): within = MSE, between = (MSB - MSE) / m; not divided by the groups' number g.

    MSB and MSE are independent, and each is its expectation times chi-square over its degrees of freedom.
    """
    y = one_way(seed)
    within = y.var(axis=1, ddof=1).mean()
    between = y.mean(axis=1).var(ddof=1) - within / REPEATS
    found = of_groups(y, with_sigma=True)
    assert found.s**2 == pytest.approx([between, within], rel=2e-3)
    of_msb, of_mse = (within + REPEATS * between) * np.sqrt(2 / (GROUPS - 1)), within * np.sqrt(2 / (GROUPS * (REPEATS - 1)))
    assert found.sigma == pytest.approx([np.hypot(of_msb, of_mse) / REPEATS / 2 / found.s[0], of_mse / 2 / found.s[1]], rel=5e-3)


def test_groups_alike_have_no_variance_between():
    y = one_way(1, between=0.0)
    y -= y.mean(axis=1, keepdims=True)  # between would be negative
    found = of_groups(y, with_sigma=True)
    assert found.s[0] == 0.0
    # -2 log L = (g - 1) log(within + m between) + what does not depend on between: up by one at this size.
    assert found.sigma[0] == pytest.approx(found.s[1] * np.sqrt((np.exp(1 / (GROUPS - 1)) - 1) / REPEATS), rel=0.003)
    # and the other's is that of its mean square alone
    assert found.sigma[1] == pytest.approx(found.s[1] / np.sqrt(2 * GROUPS * (REPEATS - 1) + 2 * (GROUPS - 1)), rel=3e-3)


def test_of_two_components_alike_the_sum_alone_is_determined():
    y = np.random.default_rng(2).normal(size=8)
    V = [np.eye(8), np.eye(8)]
    found = estimate(y, np.zeros((8, 1)), 1e-9 * np.eye(8), V, np.ones(2), [None, None], [np.arange(8)], with_sigma=True, steps=60)
    variance = y @ y / 8
    assert found.s @ found.s == pytest.approx(variance, rel=1e-3)
    assert np.isinf(found.sigma).all()


def test_a_component_that_the_columns_take_up_may_have_any_size():
    """Its sigma is as good as infinite; of a column known to c, the mean has the variance v = s^2 + c^2 + within / n, -2 log L = log v."""
    y = np.random.default_rng(8).normal(size=6)
    y -= y.mean()

    def sigma(column):
        V, J = [np.ones((6, 6)), np.eye(6)], column * np.ones((6, 1))
        return estimate(y, J, 1e-9 * np.eye(6), V, np.ones(2), [None, None], [np.arange(6)], with_sigma=True, steps=60).sigma[0]

    assert sigma(FLAT) > 1e5
    assert np.isinf(sigma(20.0))  # too flat for a search to move: -2 log L is curved downwards there
    for known in (2.0, 10.0):
        assert sigma(known) == pytest.approx(np.sqrt((np.e - 1) * (known**2 + y @ y / 5 / 6)), rel=0.01)


@pytest.mark.parametrize(("prior", "size", "apart"), [(Prior(2.0, 0.5), 2.0 * np.e, 2.0), (Prior(2.0, 0.5, 0.25), 2.0 * np.e, 4.0)])
def test_a_prior_counts_in_its_own_spreads(prior, size, apart):
    assert prior.apart(size)[0] == pytest.approx(apart)
    assert prior.apart(4.0 / size)[0] == pytest.approx(-2.0)  # as far below the median, by the spread downwards
    assert prior.apart(size)[1] == (prior.spread_above or prior.spread)
    assert prior.apart(2.0 * (1 - 1e-9))[1] == 0.5


def test_a_priors_density_is_two_halves_of_normals_of_the_logarithm():
    """Directly integrated over ln s: its mass is sqrt(pi/2) times both spreads, 68 % of either half within its own."""
    prior = Prior(0.7, 0.5, 0.2)
    density = lambda x: np.exp(-(prior.apart(np.exp(x))[0] ** 2) / 2)  # noqa: E731
    at = np.log(0.7)
    below, above = (quad(density, at + low, at + high)[0] for low, high in ((-6, 0), (0, 3)))
    assert (below, above) == pytest.approx((0.5 * np.sqrt(np.pi / 2), 0.2 * np.sqrt(np.pi / 2)))
    assert quad(density, at, at + 0.2)[0] / above == pytest.approx(norm.cdf(1) - norm.cdf(-1))


@pytest.mark.parametrize("prior", [Prior(0.3, 0.4), Prior(6.0, 0.4), Prior(0.3, 2.0, 0.3)])
def test_a_size_with_a_prior_is_the_maximum_of_both(prior):
    """One variance of n rows: -2 log L = n log v + sum of squares / v, beside the square of the prior's deviate."""
    y = np.random.default_rng(7).normal(size=6)
    found = estimate(
        y, np.zeros((6, 1)), 1e-12 * np.eye(6), [np.eye(6)], np.array([0.8]), [prior], [np.arange(6)], with_sigma=True, steps=60
    )

    def direct(log_v):
        return 6 * log_v + y @ y / np.exp(log_v) + prior.apart(np.exp(log_v / 2))[0] ** 2

    best = minimize_scalar(direct, bounds=(-6, 5), method="bounded", options={"xatol": 1e-9})
    assert found.s[0] == pytest.approx(np.exp(best.x / 2), rel=1e-3)
    assert found.value == pytest.approx(best.fun, abs=1e-5)


@pytest.mark.parametrize(("variance", "there"), [(0.99 * NOTHING, False), (1.01 * NOTHING, True)])
def test_a_component_below_a_hundredth_of_its_usual_size_is_absent(variance, there):
    y = np.random.default_rng(3).normal(size=6)
    prior = Prior(3.0 * np.sqrt(variance), 1e-4)
    V = [9.0 * np.eye(6), np.eye(6)]
    found = estimate(y, np.zeros((6, 1)), 1e-9 * np.eye(6), V, np.array([3.0, 1.0]), [prior, None], [np.arange(6)], steps=60)
    assert found.s[0] == pytest.approx(3.0 * np.sqrt(variance) * there, rel=1e-3)


def test_a_search_goes_on_from_where_the_last_one_ended():
    """From the answer, one step is enough; from afar it is not."""
    y = one_way(8)
    best = of_groups(y)
    usual = np.array([3.0, 0.2])
    assert of_groups(y, usual=usual, start=best.s, steps=1).s == pytest.approx(best.s, rel=1e-3)
    assert np.abs(of_groups(y, usual=usual, start=40 * usual, steps=1).s / best.s - 1).max() > 0.1
    assert np.isnan(best.sigma).all()


@pytest.mark.parametrize("true", [(0.5, 80.0, 1.0), (20.0, 2.0, 40.0), (10.0, 0.0, 0.0)])
def test_components_far_larger_than_usual_are_found_in_two_searches(true):
    """As where an effect that has no name yet is taken for noise, and as a hypothesis is weighed: the second goes on from the first."""
    for seed in range(3):
        problem = Blocks(rows=20, seed=seed, true=true)
        twice = problem.estimate(start=problem.estimate().s)
        assert twice.value < problem.definition(problem.best()) + 0.5
