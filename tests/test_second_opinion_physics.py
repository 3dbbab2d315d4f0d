"""The numbers that matter, by other people's programs: lmfit, statsmodels, AllanTools, and the certificates of NIST.

Rotations are held to SciPy's in tests/test_attitude_physics.py and tests/small_turns.py.
"""

import numpy as np
import pytest
from small_turns import PERFECT, TRUE, small_turns

from tinygc import closure
from tinygc.closure.floor import allan_curve
from tinygc.closure.least_squares import StillRates, fit_least_squares
from tinygc.closure.problem import COUNT, JointSystem
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

    def residual(parameters):
        vector = np.array([parameters[name].value for name in NAMES])
        model = LinearModel.from_vector(vector)
        angles = 2 * closure.segment_residuals(batch, model(batch.rate)) / sigma[:, None]
        return np.concatenate([angles.ravel(), ((model(rate) - stills.earth) / error).ravel(), (vector - PERFECT.vector) / PRIOR_SIGMA])

    start = lmfit.create_params(**dict(zip(NAMES, ours.model.vector + 1e-5, strict=True)))
    theirs = lmfit.minimize(residual, start, scale_covar=False, epsfcn=1e-9)
    sigmas = np.sqrt(np.diag(ours.covariance))
    np.testing.assert_allclose((ours.model.vector - list(theirs.params.valuesdict().values())) / sigmas, 0, atol=1e-5)
    np.testing.assert_allclose(sigmas, [theirs.params[name].stderr for name in NAMES], rtol=1e-5)
    np.testing.assert_allclose(ours.covariance / np.outer(sigmas, sigmas), theirs.covar / np.outer(sigmas, sigmas), atol=2e-5)


# NIST's Statistical Reference Datasets for nonlinear regression (itl.nist.gov/div898/strd), typed from their certificates.
# The project's own solver fits rotations; here the linear system at the end of its joint search is solved again and again instead.

MISRA1A = (
    lambda b, x: b[0] * (1 - np.exp(-b[1] * x)),
    [10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05, 61.01, 66.40, 75.47, 81.78],
    [77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3, 536.8, 593.1, 689.1, 760.0],
    [250.0, 0.0005],
    [2.3894212918e02, 5.5015643181e-04],
    [2.7070075241e00, 7.2668688436e-06],
    1.2455138894e-01,
)


def digits(found, certified):
    """Correct digits of the worst number (McCullough 1998)."""
    return float(-np.log10(np.max(np.abs(np.subtract(found, certified) / certified))))


def test_a_nonlinear_problem_of_nist_is_solved_to_its_digits():
    """From the second start, which is near; of eleven certified digits eight, of the standard deviations six."""
    model, y, x, start, certified, sigmas, squares = MISRA1A
    y, x, b = np.array(y), np.array(x), np.array(start)
    prior = np.ones(COUNT)
    prior[: len(b)] = 1e7 * np.abs(certified)

    def system(b):
        steps = 1e-20 * np.eye(len(b))
        J = np.stack([model(b + 1j * step, x).imag / 1e-20 for step in steps], axis=-1)  # exact: by a complex step
        design = np.pad(J, ((0, 0), (0, COUNT - len(b))))
        return JointSystem(design, model(b, x) - y, np.full(len(y), 1 / np.sqrt(squares)), prior, np.pad(b, (0, COUNT - len(b))), False)

    for _ in range(60):
        b = b + np.clip(system(b).solve()[: len(b)] - b, -0.5 * np.abs(b), 0.5 * np.abs(b))
    assert digits(b, certified) > 8
    left = model(b, x) - y
    assert digits(left @ left, squares) > 7
    variance = np.diag(system(b).covariance)[: len(b)] / (len(y) - len(b))  # whose rows have a sigma of the root of the sum of squares
    assert digits(np.sqrt(variance), sigmas) > 6


@pytest.mark.parametrize("samples", [40, 1001])
def test_allantools_finds_the_same_deviation(samples):
    allantools = pytest.importorskip("allantools")
    rate = np.cumsum(np.random.default_rng(2).normal(size=(samples, 3)), axis=0) + 5.0
    curve = allan_curve([rate], 0.02)
    for axis in range(3):
        tau_s, deviation, _, _ = allantools.oadev(rate[:, axis], rate=50.0, data_type="freq", taus=curve.tau_s)
        np.testing.assert_allclose(tau_s, curve.tau_s, rtol=1e-12)
        np.testing.assert_allclose(curve.deviation[:, axis], deviation, rtol=1e-10)
