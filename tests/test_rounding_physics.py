"""What rounding hides: against what rounded normal readings are off, and by how many values a rest reads."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from session.base.units import DEG
from session.detect import rounding


@pytest.mark.parametrize("sigma", [0.0, 0.05, 0.2, 0.4])
def test_rounding_leaves_the_mean_square_of_what_rounded_normal_readings_are_off(sigma):
    means, steps = (np.arange(2000) + 0.5) / 2000, np.arange(-5, 7)
    if sigma:
        upper, lower = (norm.cdf((steps + half - means[:, None]) / sigma) for half in (0.5, -0.5))
        off = (upper - lower) @ steps - means
    else:
        off = np.round(means) - means
    assert rounding.rounding_variance(1.0, np.array(sigma)) == pytest.approx(np.mean(off**2), rel=1e-5)
    assert rounding.rounding_variance(0.01, np.array(0.01 * sigma)) == pytest.approx(1e-4 * np.mean(off**2), rel=1e-5)


def test_the_least_step_of_readings_is_found():
    rng = np.random.default_rng(2)
    assert rounding.lsb_of(np.round(rng.normal(size=(500, 3)), 2)) == pytest.approx(0.01, rel=1e-9)
    assert rounding.lsb_of(np.zeros((5, 3))) == 0
    assert math.isclose(rounding.lsb_of(DEG * np.round(rng.normal(size=(500, 3)), 1)), 0.1 * DEG, rel_tol=1e-9)


def test_what_rounding_leaves_in_a_rest_depends_on_how_many_values_it_reads():
    def of(*counts):
        column = np.repeat(np.arange(len(counts)), counts) * 0.01
        return rounding.rounding_of_mean(np.stack([column] * 3, axis=1), 0.01)

    np.testing.assert_allclose(of(50), 1e-4 / 12, rtol=1e-12)
    np.testing.assert_allclose(of(25, 25), 0, atol=1e-20)
    np.testing.assert_allclose(of(10, 40), (0.3 * 0.01) ** 2 / 3, rtol=1e-12)
    np.testing.assert_allclose(of(400, 100, 1), ((400 / 500 - 0.5) * 0.01) ** 2 / 3, rtol=1e-12)
    three = np.repeat([0.0, 0.01, 0.02], [30, 40, 30])
    expected = rounding.rounding_variance(0.01, np.sqrt(three.var() - 1e-4 / 12))
    np.testing.assert_allclose(of(30, 40, 30), expected, rtol=1e-12)
    np.testing.assert_array_equal(rounding.rounding_of_mean(np.zeros((9, 3)), 0.0), 0)
