"""Variance components by another program: restricted likelihood of groups of unequal sizes with a slope, statsmodels' MixedLM."""

import numpy as np
import pytest

from tinygc.inference.noise import estimate


def test_statsmodels_finds_the_same_variance_components():
    models = pytest.importorskip("statsmodels.regression.mixed_linear_model")
    rng = np.random.default_rng(1)
    group = np.repeat(np.arange(12), rng.integers(2, 9, 12))
    t = rng.uniform(size=len(group))
    y = 3.0 + 0.7 * t + 2.0 * rng.normal(size=12)[group] + 0.5 * rng.normal(size=len(group))
    columns, n = np.column_stack([np.ones_like(t), t]), len(y)
    theirs = models.MixedLM(y, columns, group).fit(reml=True, method="bfgs", gtol=1e-10)
    V = [(group[:, None] == group).astype(float), np.eye(n)]
    ours = estimate(y, 1e6 * columns, 1e-12 * np.eye(n), V, np.ones(2), [None, None], [np.arange(n)], steps=200)
    assert ours.s**2 == pytest.approx([theirs.cov_re[0, 0], theirs.scale], rel=2e-4)
