"""Measurement-system analysis against the manual's own study, against sums of squares by another route, and inject-and-recover."""

import numpy as np
import pytest

from tinygc.annexes.lots.gauge import anova, cells_of, components, drawn, gauge, variances

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


def test_an_interaction_that_is_there_is_not_pooled():
    rng = np.random.default_rng(5)
    y = rng.normal(size=(10, 1, 1)) + rng.normal(size=(10, 3, 1)) * 0.7 + rng.normal(size=(10, 3, 3)) * 0.1
    table = anova(y)
    assert not table.pooled
    assert table.interaction_p < 1e-6
    assert np.sqrt(components(table)[2]) == pytest.approx(0.7, rel=0.5)


def test_likelihood_equals_analysis_of_variance_on_a_balanced_study():
    rng = np.random.default_rng(2)
    y = rng.normal(size=(8, 1, 1)) + 0.6 * rng.normal(size=(1, 4, 1)) + 0.5 * rng.normal(size=(8, 4, 1)) + 0.2 * rng.normal(size=(8, 4, 3))
    table = anova(y)
    assert not table.pooled
    assert variances(cells_of(*flat(y)))[0] == pytest.approx(components(table), rel=2e-3)


@pytest.mark.slow
def test_an_unbalanced_study_recovers_what_was_put_in():
    """Trials left out by chance; over seeds the mean of each variance is the one put in, within three of its own errors."""
    truth = np.array([1.0, 0.25, 0.0, 0.09])
    found = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        y = rng.normal(size=(20, 1, 1)) + 0.5 * rng.normal(size=(1, 5, 1)) + 0.3 * rng.normal(size=(20, 5, 2))
        keep = rng.random(y.size) < 0.5
        values, part, who = (each[keep] for each in flat(y))
        got = gauge(values, part, who)
        assert got.method == "likelihood"
        found.append([got.pv**2, got.av**2, got.ev**2])
    found = np.array(found)
    error = found.std(axis=0, ddof=1) / np.sqrt(len(found))
    assert np.all(np.abs(found.mean(axis=0) - truth[[0, 1, 3]]) < 3 * error + 0.005)


def test_intervals_of_the_balanced_study_hold_the_truth():
    """95 % intervals of %GRR over 200 studies; nine in ten must hold it, and chance gives fewer than 180 in one of a thousand runs."""
    truth, inside = 100 * np.sqrt(0.13 / 1.13), 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        y = rng.normal(size=(10, 1, 1)) + 0.3 * rng.normal(size=(1, 3, 1)) + 0.2 * rng.normal(size=(10, 3, 3))
        draws = drawn(anova(y), seed, 2000)
        noise = draws[:, 1:].sum(axis=1)
        lo, hi = np.percentile(100 * np.sqrt(noise / (noise + draws[:, 0])), [2.5, 97.5])
        inside += lo <= truth <= hi
    assert inside >= 180


def test_what_cannot_be_told_is_not_zero():
    rng = np.random.default_rng(0)
    once = gauge(rng.normal(size=20), np.arange(20), None)
    assert np.isnan(once.ev)
    assert np.isnan(once.percent_grr)
    assert "no unit has two sessions" in once.why
    alone = gauge(np.repeat(rng.normal(size=20), 2) + 0.1 * rng.normal(size=40), np.repeat(np.arange(20), 2), None)
    assert np.isnan(alone.av)
    assert alone.ev == pytest.approx(0.1, rel=0.5)
    assert "reproducibility is unknown" in alone.why


def test_units_and_order_do_not_matter():
    values, part, who = flat(AIAG)
    shuffled = np.random.default_rng(1).permutation(len(values))
    one, other = gauge(values, part, who), gauge(1000 * values[shuffled] + 7, part[shuffled], who[shuffled])
    assert other.percent_grr == pytest.approx(one.percent_grr)
    assert other.ev == pytest.approx(1000 * one.ev)
