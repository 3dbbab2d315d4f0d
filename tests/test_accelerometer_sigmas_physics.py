"""Sigmas of the accelerometer's numbers in its own triad, whatever frame the matrix before the correction brought along."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from conftest import GRAVITY
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from session.base.units import MG
from session.detect.accelerometer import (
    IDENTITY,
    NAMES,
    PARAMETERS,
    SCALES,
    after,
    units,
)
from session.log.config import Accelerometer
from tinygc.estimation.accelerometer import (
    AccelerometerFit,
    _unobserved_values,
    accelerometer_fit,
    into_frame_of,
    triad_errors,
)
from tinygc.estimation.spread import ACCELEROMETER, USUAL, Spread
from tinygc.models.linear import BIAS, MATRIX

BIAS_MPS2 = np.array([0.1, -0.2, 0.3])


#: each number's own, so that a mixed up axis shows
SIGMAS_MPS2 = MG * np.array([0.02, 0.05, 0.08, 0.11, 0.14, 0.17, 0.20, 0.23, 0.26])


QUARTER = Rotation.from_euler("z", 90, degrees=True).as_matrix()


#: off the identity as a sensor's is, and a correction of half a percent and 20 mg
UPPER = np.eye(3) + 0.01 * np.array([[1, -1, 0.5], [0, -0.5, 1], [0, 0, 0.7]])


X = IDENTITY + 0.005 * np.array([1, -1, 1, -1, 1, 1, 0, 0, 0]) + 20 * MG * np.array([0, 0, 0, 0, 0, 0, 1, -1, 1])


def fitted(turn, sigmas_mps2=SIGMAS_MPS2, x=X, **more):
    covariance = np.diag((sigmas_mps2 * units(GRAVITY)) ** 2)
    return AccelerometerFit("prior", after(x, Accelerometer(turn @ UPPER, BIAS_MPS2)), covariance, x=x, **more)


def numbers_of(x, before):
    """Scales - 1, shears, bias of the sensor's own triad; and its errors: each axis' sensitivity - 1, 90 deg less the angles between."""
    matrix = np.array([x[:3], [0, *x[3:5]], [0, 0, x[5]]]) @ before
    upper = np.linalg.cholesky(matrix.T @ matrix).T
    bias = BIAS_MPS2 + np.linalg.solve(before, x[6:])
    sensor = np.linalg.inv(upper)
    length = np.linalg.norm(sensor, axis=1)
    angle = [np.pi / 2 - np.arccos(sensor[i] @ sensor[j] / length[i] / length[j]) for i, j in ((0, 1), (0, 2), (1, 2))]
    errors = [length[0] - 1, angle[0], angle[1], length[1] - 1, angle[2], length[2] - 1]
    return np.concatenate([(upper - np.eye(3))[np.triu_indices(3)], bias]), np.concatenate([errors, bias])


@pytest.mark.parametrize("turn", [np.eye(3), Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()])
def test_sigmas_are_those_of_numeric_derivatives(turn):
    """In the sensor's own triad, and of the errors that a person reads: ppm, mrad and mg."""
    rng, before = np.random.default_rng(0), turn @ UPPER
    mixed = np.diag(SIGMAS_MPS2 * units(GRAVITY)) @ (np.eye(9) + 0.3 * rng.normal(size=(9, 9)))
    found = AccelerometerFit("fit", after(X, Accelerometer(before, BIAS_MPS2)), mixed @ mixed.T, x=X)
    values, errors = numbers_of(X, before)
    slopes = [np.subtract(numbers_of(X + step, before), numbers_of(X - step, before)) / 2e-5 for step in 1e-5 * np.eye(9)]
    of_values, of_errors = np.stack(slopes, axis=-1)
    assert_allclose(found.values, values, atol=1e-12)
    assert_allclose(found.jacobian, of_values, atol=1e-6)
    sigmas = [np.sqrt(np.diag(J @ mixed @ mixed.T @ J.T)) for J in (of_values, of_errors)]
    assert_allclose(found.sigmas, sigmas[0], rtol=1e-5)
    assert_allclose(triad_errors(values), errors, atol=1e-9)
    for table, numbers, sigma in ((found.rows(), values, sigmas[0]), (found.errors(), errors, sigmas[1])):
        for (_, unit, shown, spread, names), which, size in zip(table, ([0, 3, 5], [1, 2, 4], [6, 7, 8]), (1e-6, 1e-3, MG), strict=True):
            assert unit == {1e-6: "ppm", 1e-3: "mrad", MG: "mg"}[size]
            assert names == [NAMES[i] for i in which]
            assert_allclose(shown, numbers[which] / size, rtol=1e-6)
            assert_allclose(spread, sigma[which] / size, rtol=1e-4)


def test_without_a_covariance_there_are_numbers_and_no_sigmas():
    table = AccelerometerFit("given", after(X, Accelerometer()), misses_mps2=(np.array([-2.0, 2.0]) * MG, np.array([1.0, 1.0, 4.0]) * MG))
    assert table.sigmas is None
    assert {sigma is None for _, _, _, sigma, _ in (*table.rows(), *table.errors())} == {True}
    said = table.to_json()
    assert set(said["sigma"].values()) == {None}
    assert (said["gravity_spread_before_mg"], said["gravity_spread_mg"]) == pytest.approx((2.0, np.sqrt(2)))
    assert replace(table, misses_mps2=None).to_json()["gravity_spread_mg"] is None
    assert fitted(np.eye(3)).to_json()["sigma"]["bias_mg"] == pytest.approx(fitted(np.eye(3)).sigmas[6:] / MG)


def test_an_accelerometer_of_a_fit_is_told_with_what_it_knew_before():
    given, none = Accelerometer(UPPER, BIAS_MPS2), Accelerometer(source="none")
    assert accelerometer_fit(given, None, None, GRAVITY).unobserved == ()
    assert accelerometer_fit(none, None, None, GRAVITY).unobserved == NAMES
    made = after(X, given)
    force = np.array([[1.0, 2, 9], [-3, 9, 1], [8, 4, -4]])
    joint = SimpleNamespace(
        mode="prior", accelerometer=made, x=X, prior=np.ones(9), unobserved=(), p_value=0.3, covariance=np.eye(9), force=force,
        before=np.array([1.0, 2.0]), after=np.array([0.5, 0.1]), drift=None,
    )  # fmt: skip
    own, joined = accelerometer_fit(made, joint, None, GRAVITY), accelerometer_fit(made, joint, np.diag(np.arange(21.0)), GRAVITY)
    assert own.misses_mps2[0] is joint.before
    assert_array_equal(own.covariance, np.eye(9))
    assert_array_equal(joined.covariance, np.diag(np.arange(9.0)))
    joint.mode = "fit"  # what the sensor read before anything was known of it
    measured = np.linalg.solve(made.matrix, force.T).T + made.bias_mps2
    misses = accelerometer_fit(made, joint, None, GRAVITY).misses_mps2
    assert_allclose(misses[0], np.linalg.norm(measured, axis=1) - GRAVITY)
    assert misses[1] is joint.after


@pytest.mark.parametrize(("number", "same"), [(0, 3), (3, 0), (5, 5)])
def test_a_number_that_nobody_observed_is_named_in_the_sensors_axes(number, same):
    """Behind a quarter turn about z: the body's x, which nobody observed, is the sensor's y."""
    prior = np.full(PARAMETERS, 20 * MG) * units(GRAVITY)
    joint = SimpleNamespace(x=X, accelerometer=fitted(QUARTER).calibration, prior=prior, unobserved=(NAMES[number],))
    assert _unobserved_values(joint) == (NAMES[same],)


@pytest.mark.parametrize(("share", "named"), [(0.0999, ("scale x",)), (0.1001, ("scale x", "scale y"))])
def test_a_tenth_of_a_numbers_spread_from_one_that_nobody_observed_is_named(share, named):
    """A turn of the body about z by an angle mixes the scales of x and y by the squares of its cosine and sine; all else is known."""
    prior = np.array([1.0, 0, 0, 1.0, 0, 0, 0, 0, 0]) + 1e-9
    turn = np.arctan(np.sqrt(share / np.sqrt(1 - share**2)))
    matrix = Rotation.from_rotvec([0, 0, turn]).as_matrix()
    joint = SimpleNamespace(x=IDENTITY, accelerometer=Accelerometer(matrix, np.zeros(3)), prior=prior, unobserved=("scale x",))
    assert tuple(name for name in _unobserved_values(joint) if name.startswith("scale")) == named


def test_in_any_other_session_a_number_is_off_by_two_draws_of_the_spread():
    found = replace(
        fitted(np.eye(3), x=IDENTITY), between=Spread.of(ACCELEROMETER, np.arange(9) * 1e-4, "two other sessions").at(ACCELEROMETER)
    )
    assert_allclose(found.any_session, np.sqrt(found.sigmas**2 + 2 * (np.arange(9) * 1e-4) ** 2), rtol=1e-12)
    drift = SimpleNamespace(mps2=np.arange(3) * MG, sigma_mps2=np.full(3, 0.5 * MG), p_value=0.3, significant=False, duration_s=200.0)
    told = replace(found, drift=drift).to_json()["zero_drift"]
    assert (told["mg_per_1000s"], told["sigma"]) == (pytest.approx([0, 5, 10]), pytest.approx([2.5] * 3))
    said = found.to_json()["any_session"]
    assert said["source"] == "two other sessions"
    assert said["sigma"]["bias_mg"] == pytest.approx(found.any_session[6:] / MG)
    assert said["sigma"]["scale_correction_ppm"] == pytest.approx(found.any_session[SCALES] / 1e-6)
    assert found.any_session_words.endswith(f"bias ± {found.any_session[6:].max() / MG:.2g} mg (two other sessions)")
    assert AccelerometerFit("given", after(X, Accelerometer())).any_session_words == ""
    # The usual one: 2 mg between two switch-ons
    assert np.sqrt(2) * USUAL.at(ACCELEROMETER).sigma[6:] == pytest.approx([2 * MG] * 3)
    assert USUAL.sigma[[1, 2, 4]].tolist() == [0.0] * 3


def test_a_turn_into_one_frame_is_exact():
    turn = Rotation.from_rotvec([0.010, -0.006, 0.008]).as_matrix()
    one, other = Accelerometer(UPPER), Accelerometer(turn @ UPPER)
    E, (B, m) = UPPER.T, np.random.default_rng(0).normal(size=(2, 3))
    vector = np.concatenate([E.ravel(), B])
    turned = into_frame_of(one, other) @ vector
    assert_allclose(turned[MATRIX].reshape(3, 3) @ m + turned[BIAS], turn.T @ (E @ m + B), atol=1e-15)
    assert_array_equal(into_frame_of(one, one) @ vector, vector)
