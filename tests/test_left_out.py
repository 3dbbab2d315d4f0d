"""Segments that a fit has never seen: what the shortcut predicts of them is what exact refits do."""

import numpy as np
import pytest
from explained_sessions import g_sensitive
from simulated_twins import make_twin_of

from tinygc.effects import catalogue
from tinygc.explanation.decision import fold_rows, folds_of, left_out
from tinygc.explanation.evidence import Evidence
from tinygc.noise.refit import prior_sigmas, refit

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")


def test_leaving_out_by_algebra_is_refitting_without_those_rows(twin_of):
    """Ten exact refits, each without the rows of its fold: the same to 1 % of the rms of what is left, in every channel."""
    evidence = Evidence(twin_of(g_sensitive, segments=20, seed=5)[0])
    twin, have = evidence.twin, evidence.of((catalogue()["gyro.g_sensitivity"],), evidence.nothing)
    effects, whiten = list(have.effects), have.whiten
    fit = refit(twin, whiten, effects, have.fit.state)
    shortcut = left_out(twin, whiten, fit.r, fit.J * prior_sigmas(twin, effects))
    exact = np.full(len(shortcut), np.nan)
    for held in folds_of(len(twin.segments)):
        rows = fold_rows(twin, whiten, held)
        part = refit(twin, whiten, effects, fit.state, rows=rows)
        exact[~rows] = twin.residuals(part.state).stacked()[~rows]
    assert np.isfinite(exact).all()  # every row is left out once
    inside = whiten.back(fit.r)
    for part in whiten.parts.values():
        rms = np.sqrt(np.mean(exact[part] ** 2))
        assert np.sqrt(np.mean((shortcut - exact)[part] ** 2)) < 0.01 * rms
        # Rows that were fitted to look better than they are.
        assert np.sqrt(np.mean((inside - exact)[part] ** 2)) > 0.03 * rms
    assert np.sqrt(np.mean(exact[whiten.parts["closure"]] ** 2)) > 1.1 * np.sqrt(np.mean(inside[whiten.parts["closure"]] ** 2))
