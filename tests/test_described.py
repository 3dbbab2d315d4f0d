"""The sentence of an effect is about what the recording shows."""

import numpy as np
import pytest

from tinygc.effects import catalogue
from tinygc.explanation.claims import described
from tinygc.explanation.truth_evidence import truth_claim

ASYMMETRY = catalogue()["gyro.scale_asymmetry"]


def test_the_axis_that_is_named_is_significant():
    """x is the greatest and not known at all; y is known to a tenth of its size, and z is not quite three sigmas."""
    theta, sigma = np.array([0.0347, -0.004, 0.0058]), np.array([0.039, 0.0004, 0.002])
    assert "differ in scale by 6.94 % on x" in ASYMMETRY.describe(theta)
    says = described(ASYMMETRY, theta, np.diag(sigma**2))
    assert "differ in scale by 0.80 % on y" in says
    assert described(ASYMMETRY, theta, np.diag((sigma * [1, 1, 0.9]) ** 2)) == ASYMMETRY.describe(theta * [0, 1, 1])
    # Where none is, it is the one with the most sigmas.
    assert "0.80 % on y" in described(ASYMMETRY, theta, np.diag((sigma * [30, 30, 30]) ** 2))
    assert truth_claim(ASYMMETRY, theta, sigma, 0.01).says == says
    assert truth_claim(ASYMMETRY, theta, None, 0.01).says == ASYMMETRY.describe(theta)


@pytest.mark.parametrize("name", ["earth.rotation", "gyro.bandwidth"])
def test_what_follows_from_all_parameters_in_common_is_left_alone(name):
    effect = catalogue()[name]
    theta = np.array([0.3, 0.01, -0.8]) * effect.parameter.plausible
    assert described(effect, theta, np.diag((10 * theta) ** 2)) == effect.describe(theta)


def test_an_axis_skew_is_judged_in_its_convention():
    """The earliest axis has zero by convention, and the others differ from it: sigmas are of these differences."""
    skew, theta = catalogue()["timing.axis_skew"], np.array([0.0, 0.001, 0.004])
    common = 1.0 * np.ones((3, 3)) + np.diag([1e-4, 1e-4, 1e-4]) ** 2  # a delay of all axes is not known at all
    assert "z 4.0 ms after the first" in described(skew, theta, common)
