"""The fused rate of an array: which units it is of, its value and its sigma."""

from dataclasses import replace

import numpy as np
import pytest
from simulated_array import DEG, DENSITY, RATE_HZ, measured, model_of, motion, units

from session.detect.events import FULL_SCALE_ROUNDING
from tinygc import CalibrationError
from tinygc.annexes.arrays.fusion import fuse

#: just below and just above the reading at which a unit is at its end
BELOW, ABOVE = (1 - FULL_SCALE_ROUNDING) * 250 * DEG * np.array([1 - 1e-9, 1 + 1e-9])


def plain(density, **options):
    """Units with E = 1, B = 0 and no mounting, of 250 dps; nothing is known of their parameters."""
    found = units(len(density), density=density, full_scale=250)
    model = replace(found[0].model, E=np.eye(3), B=np.zeros(3))
    place = [replace(unit.place, mounting=np.eye(3)) for unit in found]
    found = [replace(u, place=p, model=model, bias_instability=None, covariance=None) for u, p in zip(found, place, strict=True)]
    return model_of(found, **options)


def along_x(*readings) -> np.ndarray:
    """(T, N, 3): values along x of each unit, NaN for no sample."""
    raw = np.zeros((len(readings), len(readings[0]), 3))
    raw[..., 0] = readings
    return raw


def test_of_eight_unlike_units_the_errors_are_of_one_sigma():
    model, omega = model_of(units(8, density=np.linspace(1, 2, 8) * DENSITY)), motion(4200, seed=7)
    raw = measured(model, omega)
    fused = fuse(model, raw)
    assert fused.used.all()
    np.testing.assert_allclose(fused.rate, model(raw), atol=1e-12)
    assert 0.95 < ((fused.rate - omega) / fused.sigma).std() < 1.05


def test_the_rate_of_the_units_that_are_left_and_its_sigma():
    """Densities 0.1, 0.2, 0.2 at 100 Hz: variances 0.5, 2, 2 a sample; weights 4, 1, 1, of those that are left."""
    fused = fuse(plain([0.1, 0.2, 0.2]), along_x([1, 2, 3], [1, np.nan, 2], [np.nan, np.nan, 3], [np.nan] * 3))
    np.testing.assert_allclose(fused.rate[:3, 0], [9 / 6, 6 / 5, 3])
    np.testing.assert_allclose(fused.sigma[:3], np.sqrt([1 / 3, 0.4, 2])[:, None] * np.ones(3))
    assert np.isnan(fused.rate[3]).all()
    assert np.isnan(fused.sigma[3]).all()
    np.testing.assert_array_equal(fused.used.sum(axis=1), [3, 2, 1, 0])


def test_parts_of_correlated_noise_add_up_to_that_of_the_combination():
    model = replace(plain([0.1, 0.2]), correlation=np.kron(np.array([[1, 0.3], [0.3, 1]]), np.eye(3)))
    np.testing.assert_allclose(fuse(model, np.zeros((2, 3))).sigma[0], model.noise_density * np.sqrt(RATE_HZ / 2))


def test_the_sigma_holds_that_of_the_parameters_where_it_is_known():
    model = model_of(units(3))
    white, own = model.noise_density * np.sqrt(RATE_HZ / 2), model.parameter_sigma()
    assert own is not None
    np.testing.assert_allclose(fuse(model, np.zeros((3, 3))).sigma[0], np.hypot(white, own))


def test_a_reading_at_the_end_of_a_range_is_used_only_where_all_are():
    fused = fuse(plain([0.1, 0.1]), along_x([BELOW, ABOVE], [-ABOVE, 1], [ABOVE, -ABOVE], [ABOVE, np.nan]))
    np.testing.assert_array_equal(fused.used, [[True, False], [False, True], [True, True], [True, False]])
    np.testing.assert_allclose(fused.rate[:, 0], [BELOW, 1, 0, ABOVE], atol=1e-12)
    np.testing.assert_array_equal(np.isinf(fused.sigma).all(axis=1), [False, False, True, True])


def test_no_samples_give_none_and_another_shape_is_refused():
    model = model_of(units(2))
    fused = fuse(model, np.zeros((0, 2, 3)))
    assert (fused.rate.shape, fused.sigma.shape, fused.used.shape) == ((0, 3), (0, 3), (0, 2))
    with pytest.raises(CalibrationError, match=r"raw has shape \(3, 3\), expected \(2, 3\)"):
        fuse(model, np.zeros((3, 3)))
