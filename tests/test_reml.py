"""Restricted maximum likelihood against closed forms and by its definition; each term of the likelihood changes one of these numbers."""

import numpy as np
import pytest
from scipy.linalg import null_space

from tinygc.noise.reml import Prior, estimate

GROUPS, REPEATS = 12, 5
#: prior of a column, wide enough to be none
FLAT = 1e6


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


@pytest.mark.parametrize("seed", range(5))
def test_a_balanced_one_way_study_gives_the_analysis_of_variance(seed):
    """Closed form (Searle, Casella & McCulloch 1992, 3.8): within = MSE, between = (MSB - MSE) / m; not divided by the groups' number g."""
    y = one_way(seed)
    within = y.var(axis=1, ddof=1).mean()
    between = y.mean(axis=1).var(ddof=1) - within / REPEATS
    assert of_groups(y).s ** 2 == pytest.approx([between, within], rel=2e-3)


def test_groups_alike_have_no_variance_between():
    y = one_way(1, between=0.0)
    y -= y.mean(axis=1, keepdims=True)  # between would be negative
    found = of_groups(y, with_sigma=True)
    assert found.s[0] == 0.0
    # -2 log L = (g - 1) log(within + m between) + what does not depend on between.
    assert found.sigma[0] == pytest.approx(found.s[1] * np.sqrt((np.exp(1 / (GROUPS - 1)) - 1) / REPEATS), rel=0.01)


def test_the_likelihood_is_that_of_contrasts_without_the_columns():
    """Its definition (Patterson & Thompson 1971): the likelihood of K'y with K'J = 0, up to a constant of K and J."""
    rng = np.random.default_rng(4)
    y, columns = one_way(2), rng.normal(size=(GROUPS * REPEATS, 3))
    found = of_groups(y, FLAT * columns)
    K = null_space(columns.T)
    V = [np.kron(np.eye(GROUPS), np.ones((REPEATS, REPEATS))), np.eye(y.size)]

    def direct(s):
        C = K.T @ (s[0] ** 2 * V[0] + s[1] ** 2 * V[1]) @ K
        z = K.T @ y.ravel()
        return np.linalg.slogdet(C)[1] + z @ np.linalg.solve(C, z)

    other = of_groups(y, FLAT * columns, steps=3)
    constant = np.linalg.slogdet(columns.T @ columns)[1] + 3 * np.log(FLAT**2)
    assert found.value - constant == pytest.approx(direct(found.s), abs=1e-4)
    assert other.value - constant == pytest.approx(direct(other.s), abs=1e-4)
    for step in (0.97, 1.03):
        assert direct(found.s) < min(direct(found.s * [step, 1]), direct(found.s * [1, step]))


def test_a_columns_prior_enters_as_a_random_effect():
    """y = J b + e with b of variance 1 is C + J J': the restricted likelihood is then an ordinary one."""
    rng = np.random.default_rng(6)
    y, J = one_way(3) - 3.0, rng.normal(size=(GROUPS * REPEATS, 2))
    found = of_groups(y, J)
    C = found.s[0] ** 2 * np.kron(np.eye(GROUPS), np.ones((REPEATS, REPEATS))) + found.s[1] ** 2 * np.eye(y.size) + J @ J.T
    assert found.value == pytest.approx(np.linalg.slogdet(C)[1] + y.ravel() @ np.linalg.solve(C, y.ravel()), abs=1e-4)


@pytest.mark.parametrize(("prior", "size", "apart"), [(Prior(2.0, 0.5), 2.0 * np.e, 2.0), (Prior(2.0, 0.5, 0.25), 2.0 * np.e, 4.0)])
def test_a_prior_counts_in_its_own_spreads(prior, size, apart):
    assert prior.apart(size)[0] == pytest.approx(apart)
    assert prior.apart(4.0 / size)[0] == pytest.approx(-2.0)  # as far below the median, by the spread downwards


def test_a_tight_prior_decides_and_a_wide_one_does_not():
    y = one_way(5)
    free = of_groups(y).s[0]
    assert of_groups(y, priors=[Prior(1.0, 1e-3), None]).s[0] == pytest.approx(1.0, rel=1e-3)
    assert of_groups(y, priors=[Prior(1.0, 1e3), None]).s[0] == pytest.approx(free, rel=1e-2)


def test_the_prior_is_added_to_the_likelihood():
    y, prior = one_way(5), Prior(1.0, 0.3)
    found = of_groups(y, priors=[prior, None])
    within, between = found.s[1] ** 2, found.s[0] ** 2
    mean = within + REPEATS * between
    square = REPEATS * y.mean(axis=1).var() * GROUPS / mean + y.var(axis=1).sum() * REPEATS / within
    log = GROUPS * np.log(mean) + GROUPS * (REPEATS - 1) * np.log(within) + np.log(FLAT**2 * y.size / mean)
    assert found.value == pytest.approx(log + square + prior.apart(found.s[0])[0] ** 2, abs=1e-3)


def test_the_sigma_of_one_variance_is_that_of_chi_square():
    """s of n - 1 degrees of freedom has the sigma s / sqrt(2 (n - 1))."""
    y = np.random.default_rng(7).normal(size=30)
    n, J = len(y), FLAT * np.ones((len(y), 1))
    found = estimate(y, J, 1e-9 * np.eye(n), [np.eye(n)], np.ones(1), [None], [np.arange(n)], with_sigma=True, steps=60)
    assert found.s[0] == pytest.approx(y.std(ddof=1), rel=1e-3)
    assert found.sigma[0] == pytest.approx(found.s[0] / np.sqrt(2 * (n - 1)), rel=2e-3)


def test_the_sigmas_of_a_balanced_study_are_those_of_its_mean_squares():
    """MSB and MSE are independent, and each is its expectation times chi-square over its degrees of freedom."""
    y = one_way(4)
    found = of_groups(y, with_sigma=True)
    between, within = found.s**2
    of_msb, of_mse = (within + REPEATS * between) * np.sqrt(2 / (GROUPS - 1)), within * np.sqrt(2 / (GROUPS * (REPEATS - 1)))
    expected = [np.hypot(of_msb, of_mse) / REPEATS / 2 / found.s[0], of_mse / 2 / found.s[1]]
    assert found.sigma == pytest.approx(expected, rel=5e-3)


def test_the_sigma_holds_the_truth_in_two_of_three_studies():
    """68 % within one sigma over 400 studies, within three errors of that share."""
    found = [of_groups(one_way(seed), with_sigma=True) for seed in range(400)]
    within = np.array([np.abs(each.s - [2.0, 0.5]) < each.sigma for each in found]).mean(axis=0)
    assert within == pytest.approx([0.683, 0.683], abs=3 * np.sqrt(0.683 * 0.317 / 400))


def test_blocks_of_independent_rows_change_nothing():
    y = one_way(8)
    rows = np.arange(y.size).reshape(3, -1)  # four groups each
    assert of_groups(y, blocks=list(rows)).s == pytest.approx(of_groups(y).s, rel=1e-6)
