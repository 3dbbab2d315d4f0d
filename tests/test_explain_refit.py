"""Refit: effects fitted together, with the uncertainties that they have."""

import numpy as np
import pytest
from scipy import stats
from simulated_twins import make_twin_of

from session.io.units import DEG, G
from tinygc.effects import catalogue
from tinygc.noise.refit import refit

twin_of = pytest.fixture(make_twin_of, scope="module", name="twin_of")


G_SENSITIVITY = np.array([[0.03, -0.02, 0.01], [0.02, 0.04, -0.03], [-0.04, 0.01, 0.02]])
THERMAL = np.array([0.014, -0.02, 0.01])


def g_and_thermal(t_s, rate, force, temp_c):
    return rate + force / G @ (G_SENSITIVITY * DEG).T + np.outer(temp_c - 25, THERMAL * DEG)


def test_refit_leaves_noise(twin_of):
    twin, whiten = twin_of(g_and_thermal, seed=0, segments=14, warm_up_c=8.0)
    effects = [catalogue()["gyro.g_sensitivity"], catalogue()["gyro.thermal_bias"]]
    without, fit = refit(twin, whiten, [], twin.start()), refit(twin, whiten, effects, twin.start())
    assert without.chi_square > 20 * fit.chi_square
    freedom = len(fit.r) - 12 - 12
    assert stats.chi2.cdf(fit.chi_square, freedom) < 0.9999
    # From where it ended it goes nowhere, and rows that do not count change nothing in those that do.
    again = refit(twin, whiten, effects, fit.state)
    assert again.chi_square == pytest.approx(fit.chi_square, abs=0.05)
    rows = np.ones(len(fit.r), dtype=bool)
    rows[:4] = False
    part = refit(twin, whiten, effects, fit.state, rows=rows)
    assert len(part.r) == rows.sum()
    assert part.chi_square < fit.chi_square
