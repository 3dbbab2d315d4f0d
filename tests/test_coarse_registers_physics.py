"""Registers whose steps are larger than the noise at rest: the sigma of the bias knows what rounding leaves in the mean of a still."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from session.detect.rounding import rounding_of_mean, rounding_variance
from tinygc.estimation.stated_noise import rounding_covariance
from tinygc.models.linear import LinearModel


@pytest.mark.parametrize("sigma", [0.05, 0.2, 0.35, 0.6])
def test_what_rounding_leaves_in_a_mean_is_its_mean_square_over_all_rates(sigma):
    rate, steps = np.linspace(-0.5, 0.5, 2001)[:-1, None], np.arange(-6, 7)
    mean = (steps * (norm.cdf(steps + 0.5, rate, sigma) - norm.cdf(steps - 0.5, rate, sigma))).sum(axis=1)
    assert rounding_variance(0.3, np.array(0.3 * sigma)) == pytest.approx(0.09 * np.mean((mean - rate[:, 0]) ** 2), rel=1e-3, abs=1e-12)
    assert rounding_variance(0.3, np.array(0.0)) == pytest.approx(0.3**2 / 12)


def test_the_bias_has_what_rounding_leaves_in_the_stills():
    """E diag(v) E', v the mean over the stills that serve, and nothing elsewhere; readings that were not rounded add nothing."""
    rng, E = np.random.default_rng(1), np.eye(3) + np.array([[0.02, 0.1, 0], [0, -0.03, 0.05], [0.1, 0, 0.01]])
    gyro = rng.normal(size=(900, 3)) * [0.25, 0.1, 2.0] + [0.3, 0.1, 0.2]
    rests = [(0, SimpleNamespace(start=at, stop=at + 300)) for at in (300, 600)]
    for step in (1.0, 0.0):
        log = SimpleNamespace(samples=SimpleNamespace(gyro=np.rint(gyro) if step else gyro))
        covariance = rounding_covariance(SimpleNamespace(logs=[log], references=rests), LinearModel(E, np.zeros(3)))
        each = np.mean([rounding_of_mean(log.samples.gyro[at : at + 300], step) for at in (300, 600)], axis=0)
        expected = np.zeros((12, 12))
        expected[9:, 9:] = E @ np.diag(each) @ E.T
        np.testing.assert_allclose(covariance, expected, rtol=1e-6, atol=1e-9)
        assert (each[0] > 1e-4) == (step > 0)
