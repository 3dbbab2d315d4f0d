"""The numbers that matter, by other people's programs: lmfit and AllanTools.

Rotations are held to SciPy's in tests/test_attitude_physics.py and tests/small_turns.py.
"""

import numpy as np
import pytest
from small_turns import PERFECT, TRUE, small_turns

from tinygc.closure import residual
from tinygc.closure.floor import allan_curve
from tinygc.closure.least_squares import StillRates, fit_least_squares
from tinygc.models.linear import NAMES, PRIOR_SIGMA, LinearModel


def test_lmfit_finds_the_same_values_sigmas_and_correlations():
    """The same residual and weights, the prior as twelve more rows; Levenberg and Marquardt with numeric derivatives.

    The columns are the derivatives but for the residual's angle and the square of a sample's, which are small here.
    """
    lmfit = pytest.importorskip("lmfit")
    rng = np.random.default_rng(3)
    batch, sigma = small_turns(noise_rad=1e-6, samples=1000), rng.uniform(0.5e-4, 2e-4, 8)
    rate, error = 0.02 * rng.normal(size=(3, 3)), rng.uniform(1e-4, 3e-4, (3, 3))
    stills = StillRates(rate, TRUE(rate) + 0.01 * error * rng.normal(size=(3, 3)), error)
    ours = fit_least_squares(batch, sigma, PERFECT, still_rates=stills)

    def rows(parameters):
        vector = np.array([parameters[name].value for name in NAMES])
        model = LinearModel.from_vector(vector)
        angles = 2 * residual.segment_residuals(batch, model(batch.rate)) / sigma[:, None]
        return np.concatenate([angles.ravel(), ((model(rate) - stills.earth) / error).ravel(), (vector - PERFECT.vector) / PRIOR_SIGMA])

    start = lmfit.create_params(**dict(zip(NAMES, ours.model.vector + 1e-5, strict=True)))
    theirs = lmfit.minimize(rows, start, scale_covar=False, epsfcn=1e-9)
    sigmas = np.sqrt(np.diag(ours.covariance))
    np.testing.assert_allclose((ours.model.vector - list(theirs.params.valuesdict().values())) / sigmas, 0, atol=1e-5)
    np.testing.assert_allclose(sigmas, [theirs.params[name].stderr for name in NAMES], rtol=1e-5)
    np.testing.assert_allclose(ours.covariance / np.outer(sigmas, sigmas), theirs.covar / np.outer(sigmas, sigmas), atol=2e-5)


@pytest.mark.parametrize("samples", [40, 1001])
def test_allantools_finds_the_same_deviation(samples):
    allantools = pytest.importorskip("allantools")
    rate = np.cumsum(np.random.default_rng(2).normal(size=(samples, 3)), axis=0) + 5.0
    curve = allan_curve([rate], 0.02)
    for axis in range(3):
        tau_s, deviation, _, _ = allantools.oadev(rate[:, axis], rate=50.0, data_type="freq", taus=curve.tau_s)
        np.testing.assert_allclose(tau_s, curve.tau_s, rtol=1e-12)
        np.testing.assert_allclose(curve.deviation[:, axis], deviation, rtol=1e-10)
