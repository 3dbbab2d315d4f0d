"""Measurement-system analysis against the manual's own study, against sums of squares by another route, and inject-and-recover."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from tinygc.annexes.lots.gauge import Anova, anova, cells_of, components, drawn, gauge, told, variances

#: AIAG, Measurement Systems Analysis, 4th edition: 10 parts, in each row three trials of appraisers A, B and C
AIAG = np.array(
    [
        [0.29, 0.41, 0.64, 0.08, 0.25, 0.07, 0.04, -0.11, -0.15],
        [-0.56, -0.68, -0.58, -0.47, -1.22, -0.68, -1.38, -1.13, -0.96],
        [1.34, 1.17, 1.27, 1.19, 0.94, 1.34, 0.88, 1.09, 0.67],
        [0.47, 0.50, 0.64, 0.01, 1.03, 0.20, 0.14, 0.20, 0.11],
        [-0.80, -0.92, -0.84, -0.56, -1.20, -1.28, -1.46, -1.07, -1.45],
        [0.02, -0.11, -0.21, -0.20, 0.22, 0.06, -0.29, -0.67, -0.49],
        [0.59, 0.75, 0.66, 0.47, 0.55, 0.83, 0.02, 0.01, 0.21],
        [-0.31, -0.20, -0.17, -0.63, 0.08, -0.34, -0.46, -0.56, -0.49],
        [2.26, 1.99, 2.01, 1.80, 2.12, 2.19, 1.77, 1.45, 1.87],
        [-1.36, -1.25, -1.31, -1.68, -1.62, -1.50, -1.49, -1.77, -2.16],
    ]
).reshape(10, 3, 3)


def flat(y):
    """y, part, appraiser of each trial."""
    part, who, _ = np.indices(y.shape)
    return y.ravel(), part.ravel(), who.ravel()


def test_the_manuals_table_of_variance():
    table = anova(AIAG)
    assert table.squares == pytest.approx([88.3619, 3.1673, 0.3590, 2.7589], abs=5e-5)
    assert list(table.freedom) == [9, 2, 18, 60]
    assert table.mean_squares == pytest.approx([9.81799, 1.58363, 0.01994, 0.04598], abs=6e-6)
    assert table.interaction_f == pytest.approx(0.434, abs=5e-4)
    assert table.interaction_p == pytest.approx(0.974, abs=5e-4)
    assert table.pooled


def test_the_manuals_variations_grr_and_categories():
    found = gauge(*flat(AIAG))
    assert (found.method, found.appraisers) == ("anova", "operator")
    assert [found.ev, found.av, found.grr, found.pv] == pytest.approx([0.199933, 0.226838, 0.302373, 1.042327], abs=2e-6)
    assert found.tv == pytest.approx(1.085, abs=5e-4)
    shares = [100 * part / found.tv for part in (found.ev, found.av, found.grr, found.pv)]
    assert shares == pytest.approx([18.4, 20.9, 27.9, 96.0], abs=0.05)
    assert found.percent_grr == pytest.approx(27.9, abs=0.05)
    assert int(found.ndc) == 4
    assert found.percent_grr_interval[0] < found.percent_grr < found.percent_grr_interval[1]
    assert gauge(*flat(AIAG), tolerance=6.0).percent_tolerance == pytest.approx(100 * found.grr)
    assert found.verdict == "marginal"


def test_sums_of_squares_by_projections():
    """Another route: least squares on indicator columns, one factor more at a time."""
    rng = np.random.default_rng(3)
    y = rng.normal(size=(7, 4, 2))
    values, part, who = flat(y)
    columns = [np.ones((len(values), 1)), np.eye(7)[part], np.eye(4)[who], np.eye(28)[part * 4 + who]]
    left = [float(np.sum(values**2))]
    for k in range(1, 5):
        X = np.hstack(columns[:k])
        left.append(float(np.sum((values - X @ np.linalg.lstsq(X, values, rcond=None)[0]) ** 2)))
    drops = -np.diff(left)
    assert anova(y).squares == pytest.approx([drops[1], drops[2], drops[3], left[-1]], rel=1e-9)


def test_a_study_made_to_measure():
    """Effects that are orthogonal and of known squares give exactly the variances they were made of."""
    part, who = np.array([-1.0, 0, 1]) * 3, np.array([-1.0, 1]) * 0.5
    repeat = np.array([1.0, -1.0]) * 0.1
    y = part[:, None, None] + who[:, None] + repeat
    table = anova(y, pool_p=1.1)
    assert table.squares == pytest.approx([4 * 18, 6 * 0.5, 0, 12 * 0.01])
    # No interaction at all: expected mean squares by hand.
    assert components(table)[[1, 3]] == pytest.approx([(3.0 - 0) / 6, 0.02])


@pytest.mark.parametrize(("p", "pooled"), [(0.251, True), (0.249, False)])
def test_an_interaction_is_pooled_above_a_quarter(p, pooled):
    """Mean squares of a given ratio: 2 x 3 x 2 with its 2 and 6 degrees of freedom."""
    both = np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0]])
    repeat = 0.1 * np.array([1.0, -1.0])
    ratio = stats.f.isf(p, 2, 6)
    size = np.sqrt(ratio * 12 * 0.01 / 6 * 2 / (2 * np.sum(both**2)))
    y = np.array([3.0, -3.0])[:, None, None] + np.array([0.5, 0.0, -0.5])[:, None] + size * both[:, :, None] + repeat
    table = anova(y)
    assert table.squares == pytest.approx([6 * 18, 4 * 0.5, 2 * 4 * size**2, 12 * 0.01])
    assert (table.interaction_f, table.interaction_p) == pytest.approx((ratio, p))
    assert table.pooled == pooled
    # Expected mean squares: 108 of one, 2 of two, the interaction's of two, 0.12 of six.
    error, between = 0.02, 8 * size**2 / 2
    if pooled:
        error = between = (8 * size**2 + 0.12) / 8
    expected = [(108 - between) / 6, (1 - between) / 4, (between - error) / 2, error]
    assert components(table) == pytest.approx(expected)
    # Mean squares of one's own, none below zero.
    assert components(table, np.array([[0.1, 0.1, 0.2, 0.4]]))[0] == pytest.approx([0, 0, 0, (0.2 * 2 + 0.4 * 6) / 8 if pooled else 0.4])
    assert components(table, np.array([5.0, 4.0, 1.0, 1.0])) == pytest.approx([4 / 6, 3 / 4, 0, 1])


def test_without_repeats_or_people_what_is_left_is_repeatability():
    once = anova(np.array([[[1.0], [2.0]], [[4.0], [3.0]], [[5.0], [9.0]]]))
    assert once.pooled
    assert np.isnan(once.interaction_p)
    assert np.isnan(once.mean_squares[3])
    assert components(once) == pytest.approx([(15.5 - 19 / 6) / 2, 0, 0, 19 / 6])
    alone = anova(np.array([[[1.0, 2.0]], [[4.0, 3.0]], [[5.0, 9.0]]]))
    assert alone.freedom.tolist() == [2, 0, 0, 3]
    assert components(alone) == pytest.approx([(15.5 - 3) / 2, 0, 0, 3])
    additive = anova(4.0 * np.arange(3)[:, None, None] + 2.0 * np.arange(2)[:, None] + np.arange(2))
    assert (additive.interaction_f, additive.interaction_p, additive.pooled) == (0, 1, True)
    exact = anova(np.zeros((2, 2, 2)))
    assert np.isnan(exact.interaction_f)


@pytest.mark.parametrize("pooled", [True, False])
def test_drawn_components_are_pivots_of_chi_squares(pooled):
    """Each mean square is its sum of squares over a chi-square with its freedom: by Kolmogorov and Smirnov, 10 000 draws."""
    squares, freedom = np.array([9e4, 4e3, 60.0, 30.0]), np.array([9.0, 4.0, 36.0, 100.0])
    table = Anova(squares, freedom, 1.0, 0.5, pooled, 10, 5, 3)
    part, who, both, error = drawn(table, 1, 10_000).T
    if pooled:
        assert stats.kstest(90.0 / error, stats.chi2(136).cdf).pvalue > 1e-3
        assert not both.any()
        between = error
    else:
        assert stats.kstest(30.0 / error, stats.chi2(100).cdf).pvalue > 1e-3
        between = 60.0 / stats.chi2(36).rvs(10_000, random_state=2)
        again = np.maximum(between - 30.0 / stats.chi2(100).rvs(10_000, random_state=3), 0) / 3
        assert stats.ks_2samp(both, again).pvalue > 1e-3
    # The parts' and appraisers' are so large that the rest is nothing beside them.
    assert stats.kstest(9e4 / (15 * part + np.mean(between)), stats.chi2(9).cdf).pvalue > 1e-3
    assert stats.kstest(4e3 / (30 * who + np.mean(between)), stats.chi2(4).cdf).pvalue > 1e-3
    assert len(drawn(table)) == 20_000
    two = Anova(np.array([9e6, 0.0, 0.0, 4.0]), np.array([1.0, 0.0, 0.0, 2.0]), np.nan, np.nan, True, 2, 1, 2)
    assert stats.kstest(9e6 / (2 * drawn(two, 1, 10_000)[:, 0]), stats.chi2(1).cdf).pvalue > 1e-3
    fewer = Anova(np.array([9.0, 0.0, 0.0, 4.0]), np.array([2.0, 0.0, 0.0, 3.0]), np.nan, np.nan, True, 3, 1, 2)
    assert not drawn(fewer, 0, 100)[:, 1:3].any()
    assert stats.kstest(4.0 / drawn(fewer, 1, 10_000)[:, 3], stats.chi2(3).cdf).pvalue > 1e-3


def test_intervals_of_grr_and_categories_are_those_of_the_f_distribution():
    """One appraiser: parts over repeats is (F of the study / F of chance - 1) / trials, so that both intervals have a closed form."""
    rng = np.random.default_rng(3)
    y = 3 * rng.normal(size=(12, 1)) + rng.normal(size=(12, 2))
    part = np.repeat(np.arange(12), 2)
    found = gauge(y.ravel(), part, None, tolerance=5.0, seed=4)
    between, error = 2 * np.var(y.mean(axis=1), ddof=1), np.mean(np.var(y, axis=1, ddof=1))
    assert (found.ev, found.pv) == pytest.approx((np.sqrt(error), np.sqrt((between - error) / 2)))
    assert found.grr == pytest.approx(found.ev)
    assert np.isnan(found.av)
    assert np.isnan(found.interaction)
    assert found.tv == pytest.approx(np.hypot(found.ev, found.pv))
    assert found.percent_grr == pytest.approx(100 * found.ev / found.tv)
    assert found.percent_tolerance == pytest.approx(100 * 6 * found.ev / 5)
    assert found.ndc == pytest.approx(1.41 * found.pv / found.ev)
    low, high = (between / error / stats.f.isf(tail, 11, 12) for tail in (0.025, 0.975))
    ratios = (np.array([low, high]) - 1) / 2
    assert found.percent_grr_interval == pytest.approx(100 / np.sqrt(1 + ratios[::-1]), rel=0.02)
    assert found.ndc_interval == pytest.approx(1.41 * np.sqrt(ratios), rel=0.02)
    drawn_part, _, _, drawn_error = drawn(found.table, 4).T
    assert found.ndc_interval == pytest.approx(np.percentile(1.41 * np.sqrt(drawn_part / drawn_error), [2.5, 97.5]))
    assert (found.method, found.appraisers, found.parts, found.sessions) == ("anova", "", 12, 24)
    assert "reproducibility is unknown" in found.why


def test_reproducibility_holds_appraisers_and_interaction():
    table = anova(UNPOOLED)
    part, who, both, again = components(table)
    found = gauge(*flat(UNPOOLED), what="station")
    assert not table.pooled
    assert [found.ev, found.interaction, found.pv] == pytest.approx(np.sqrt([again, both, part]))
    assert found.av == pytest.approx(np.sqrt(who + both))
    assert found.grr == pytest.approx(np.sqrt(who + both + again))
    assert (found.appraisers, found.why) == ("station", "")


UNPOOLED = (
    np.random.default_rng(2).normal(size=(6, 3, 2)).cumsum(axis=2) + np.array([0.0, 1.0, 2.0])[:, None] + 2.0 * np.arange(6)[:, None, None]
)


def test_likelihood_equals_analysis_of_variance_on_a_balanced_study():
    """And its sigmas are those of the likelihood's curvature, by differences of its own definition."""
    values, part, who = flat(UNPOOLED)
    cells = cells_of(values, part, who)
    found, covariance = variances(cells)
    assert found == pytest.approx(components(anova(UNPOOLED)), rel=2e-3)
    once = UNPOOLED[:, :, :1]  # without a repeat there is no interaction
    assert variances(cells_of(*flat(once)))[0] == pytest.approx(
        np.where([1, 1, 0, 1], components(anova(once)), np.nan), rel=2e-3, nan_ok=True
    )
    V = [(part[:, None] == part), (who[:, None] == who), (part[:, None] == part) & (who[:, None] == who), np.eye(len(values))]

    def cost(logs):
        C = sum(np.exp(each) * v for each, v in zip(logs, V, strict=True))
        solved = np.linalg.solve(C, np.column_stack([values, np.ones(len(values))]))
        weight = solved[:, 1].sum()
        return np.linalg.slogdet(C)[1] + np.log(weight) + values @ solved[:, 0] - solved[:, 0].sum() ** 2 / weight

    step, at, E = 0.02, np.log(found), np.eye(4)

    def bent(a, b):
        return (cost(at + a + b) - cost(at + a - b) - cost(at - a + b) + cost(at - a - b)) / (4 * step**2)

    curved = [[bent(step * a, step * b) for a in E] for b in E]
    assert covariance == pytest.approx(np.linalg.inv(np.array(curved) / 2), rel=0.01, abs=1e-3)


def test_a_variance_that_is_not_there_is_zero_and_known():
    """Appraisers with equal means."""
    y = UNPOOLED - UNPOOLED.mean(axis=(0, 2), keepdims=True)
    found, covariance = variances(cells_of(*flat(y)))
    assert found[1] == 0
    assert (found[[0, 2, 3]] > 0).all()
    assert not covariance[1].any()
    assert (np.diag(covariance)[[0, 2, 3]] > 0).all()


def test_cells_are_means_counts_and_what_is_left_inside():
    cells = cells_of(np.array([1.0, 2, 5, 7, 10, 4]), np.array([3, 3, 3, 8, 8, 3]), np.array([5, 5, 9, 5, 5, 5]))
    assert cells.part.tolist() == [0, 0, 1]
    assert cells.appraiser.tolist() == [0, 1, 0]
    assert cells.mean.tolist() == pytest.approx([7 / 3, 5, 8.5])
    assert cells.count.tolist() == [3, 1, 2]
    assert (cells.inside, cells.freedom) == (pytest.approx(14 / 3 + 4.5), 3)
    # An appraiser's repeats tell repeatability, parts need repeats or people, the interaction both and more cells than a cross.
    assert told(cells).tolist() == [True, True, False, True]
    studies = [(UNPOOLED, [1, 1, 1, 1]), (UNPOOLED[:, :, :1], [1, 1, 0, 1]), (UNPOOLED[:, :1], [1, 0, 0, 1])]
    for y, expected in (*studies, (UNPOOLED[:, :1, :1], [0, 0, 0, 0]), (UNPOOLED[:1], [0, 1, 0, 1])):
        assert told(cells_of(*flat(y))).tolist() == expected


def test_an_unbalanced_study_is_the_largest_likelihoods_and_its_interval_that_of_its_sigmas():
    kept = np.random.default_rng(1).random(UNPOOLED.size) < 0.8
    values, part, who = (each[kept] for each in flat(UNPOOLED))
    found = gauge(values, part, who)
    sizes, covariance = variances(cells_of(values, part, who))
    assert (found.method, found.table) == ("likelihood", None)
    assert variances(cells_of(1e-6 * values, part, who))[0] == pytest.approx(1e-12 * sizes, rel=1e-6)
    assert [found.pv**2, found.av**2 - found.interaction**2, found.interaction**2, found.ev**2] == pytest.approx(sizes)
    draws = sizes * np.exp(np.random.default_rng(9).multivariate_normal(np.zeros(4), covariance, 100_000, method="eigh"))
    share = 100 * np.sqrt(draws[:, 1:].sum(axis=1) / draws.sum(axis=1))
    assert found.percent_grr_interval == pytest.approx(np.percentile(share, [2.5, 97.5]), rel=0.05)
    assert found.ndc_interval == pytest.approx(1.41 * np.sqrt(100**2 / np.percentile(share, [97.5, 2.5]) ** 2 - 1), rel=0.08)


def test_of_very_many_sessions_those_of_units_with_several_are_looked_at():
    rng = np.random.default_rng(0)
    part = np.concatenate([np.arange(4100), np.repeat(np.arange(4100, 4400), 2)])
    y = 100 * rng.normal(size=4400)[part] + rng.normal(size=len(part))
    found = gauge(y, part, None)
    assert (found.parts, found.sessions, found.method) == (4400, 4700, "likelihood")
    pairs = y[4100:].reshape(-1, 2)
    assert found.ev == pytest.approx(np.sqrt(np.mean((pairs[:, 1] - pairs[:, 0]) ** 2) / 2), rel=2e-3)


@pytest.mark.parametrize(("percent", "says"), [(9.99, "acceptable"), (10.0, "marginal"), (30.0, "marginal"), (30.01, "not acceptable")])
def test_the_manuals_verdicts(percent, says):
    found = gauge(*flat(AIAG))
    assert replace(found, percent_grr=percent).verdict == says
    assert replace(found, percent_grr=np.nan).verdict == "not told"


def test_what_cannot_be_told_is_not_zero():
    once = gauge(np.arange(20.0), np.arange(20), None)
    assert np.isnan([once.ev, once.pv, once.percent_grr, once.ndc, *once.ndc_interval]).all()
    assert "no unit has two sessions" in once.why
    same = gauge(np.array([1.0, 2, np.nan]), np.array([0, 0, 1]), None)
    assert (same.parts, same.sessions, same.method) == (1, 2, "none")
    perfect = gauge(np.array([1.0, 1, 2, 2]), np.array([0, 0, 1, 1]), None)
    assert perfect.ndc == np.inf
    assert perfect.percent_grr == 0
    none = gauge(np.ones(4), np.array([0, 0, 1, 1]), None)
    assert np.isnan([none.percent_grr, *none.percent_grr_interval]).all()


def test_units_and_order_do_not_matter():
    values, part, who = flat(AIAG)
    shuffled = np.random.default_rng(1).permutation(len(values))
    one, other = gauge(values, part, who), gauge(1000 * values[shuffled] + 7, part[shuffled], who[shuffled])
    assert other.percent_grr == pytest.approx(one.percent_grr)
    assert other.ev == pytest.approx(1000 * one.ev)
