"""Sigmas of the accelerometer's numbers in its own triad, whatever frame the matrix before the correction brought along."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import config
from scipy.spatial.transform import Rotation

from session.detect.accelerometer import IDENTITY, NAMES, PARAMETERS, SCALES, after, units
from session.io.config import Accelerometer
from session.io.units import MG
from tinygc import FitOptions, read_session
from tinygc.estimation.accelerometer import AccelerometerFit, jacobian, unobserved_values
from tinygc.estimation.compare import SessionTriad, compare_triads
from tinygc.estimation.fit import fit_session

SESSION1 = Path(__file__).resolve().parent.parent / "data" / "session1"
GRAVITY = 9.7946
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


@pytest.mark.parametrize("turn", [np.eye(3), QUARTER, Rotation.from_rotvec([0.4, -1.1, 2.0]).as_matrix()])
def test_values_scatter_as_their_sigmas_say(turn):
    found, rng = fitted(turn), np.random.default_rng(0)
    before = Accelerometer(turn @ UPPER, BIAS_MPS2)
    drawn = X + rng.normal(size=(4000, PARAMETERS)) * SIGMAS_MPS2 * units(GRAVITY)
    values = np.array([AccelerometerFit("prior", after(x, before)).values for x in drawn])
    # The spread of a spread over 4000 draws is 1.1 %: four of these.
    np.testing.assert_allclose(values.std(axis=0) / found.sigmas, 1, atol=0.045)
    covariance = found.jacobian @ found.covariance @ found.jacobian.T
    pulls = np.einsum("ki,ij,kj->k", values - found.values, np.linalg.inv(covariance), values - found.values)
    assert abs(pulls.mean() - PARAMETERS) < 4 * np.sqrt(2 * PARAMETERS / len(pulls))


def test_behind_a_quarter_turn_the_axes_have_each_others_sigmas():
    """The body's x is the sensor's -y: what is known of the body's x axis is known of the sensor's y."""
    plain, turned = fitted(np.eye(3), x=IDENTITY).sigmas, fitted(QUARTER, x=IDENTITY).sigmas
    np.testing.assert_allclose(turned[SCALES], plain[SCALES][[1, 0, 2]], rtol=0.03)
    np.testing.assert_allclose(turned[6:], plain[6:][[1, 0, 2]], rtol=0.03)
    np.testing.assert_allclose(turned[[2, 4]], plain[[4, 2]], rtol=0.03)
    assert np.abs(turned[6:] / plain[6:] - 1).max() > 0.1


def test_without_a_matrix_before_they_are_the_corrections_own():
    calibration = after(X, Accelerometer())
    np.testing.assert_allclose(jacobian(calibration, X), np.eye(PARAMETERS), atol=1e-8)


@pytest.mark.parametrize(("number", "same"), [(0, 3), (3, 0), (5, 5)])
def test_a_number_that_nobody_observed_is_named_in_the_sensors_axes(number, same):
    """Behind a quarter turn about z: the body's x, which nobody observed, is the sensor's y."""

    class Joint:
        x = X
        accelerometer = fitted(QUARTER).calibration
        prior = np.full(PARAMETERS, 20 * MG) * units(GRAVITY)
        unobserved = (NAMES[number],)

    assert unobserved_values(Joint) == (NAMES[same],)


def test_triads_of_different_frames_are_compared_with_the_sensors_own_sigmas():
    """A bias of the sensor's x has moved, beside a session in another frame, which knows it as well as its own y's: 3.3 sigmas, not 3.5."""
    one, other = fitted(np.eye(3), x=IDENTITY), fitted(QUARTER, x=IDENTITY)
    moved = Accelerometer(other.calibration.matrix, other.calibration.bias_mps2 + np.array([1.0 * MG, 0, 0]))
    triads = [SessionTriad("fit", one.calibration, one.covariance), SessionTriad("fit", moved, other.covariance)]
    sigma = np.hypot(one.sigmas[6], other.sigmas[6])
    found = compare_triads(triads, [config(), config()]).agreement
    assert found.freedom == PARAMETERS
    assert found.chi_square == pytest.approx((MG / sigma) ** 2, rel=0.03)


@pytest.mark.parametrize("mode", ["fit", "prior"])
def test_a_turn_of_the_body_frame_changes_nothing_of_the_sensor(mode):
    """data/session1 with another body frame, gyroscope and given matrix alike: the triad's nine numbers and their sigmas stay."""
    session, options = read_session(SESSION1), FitOptions(methods=("least_squares",), accelerometer=mode)
    logs = [replace(log, samples=replace(log.samples, gyro=log.samples.gyro @ QUARTER.T)) for log in session.logs]
    given = session.config.accelerometer
    config = replace(session.config, accelerometer=replace(given, matrix=QUARTER @ given.matrix))
    there = fit_session(replace(session, logs=tuple(logs), closures=(), config=config), options).accelerometer
    here = fit_session(replace(session, closures=()), options).accelerometer
    assert np.abs((there.values - here.values) / here.sigmas).max() < 0.05
    np.testing.assert_allclose(there.sigmas, here.sigmas, rtol=0.02)
    # Of the correction itself they are other numbers' by tens of percent.
    assert np.abs(np.sqrt(np.diag(there.covariance) / np.diag(here.covariance)) - 1).max() > 0.3
