"""The closure of a turn: what it is, what it does not depend on, its derivatives; turns of known angle; one motion's attitude error."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import Turns
from numpy.testing import assert_allclose, assert_array_equal
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation
from small_turns import numeric_jacobian

from session.base import rotation
from session.base.rotation import sample_weights, steps
from session.base.units import DEG, EARTH_RATE_RPS
from session.log.samples import Samples
from tinygc.closure import residual
from tinygc.closure.earth import vertical_only
from tinygc.closure.motion import Motion, at_rest, motion_of
from tinygc.closure.residual import Batch, KnownTurns, attitudes, end_and_sensitivity, end_attitude
from tinygc.inference.noise import wander_covariance
from tinygc.models import linear
from tinygc.models.linear import LinearModel


def unit(count, seed=0):
    q = np.random.default_rng(seed).normal(size=(count, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def yaw(angle):
    return rotation.exp(np.array([0, 0, angle]))


def squared(r):
    return np.sum(r**2, axis=-1)


@pytest.fixture(scope="module")
def turns():
    return Turns(6, seed=4)


@pytest.mark.parametrize("yaw_known", [False, True])
def test_a_perfect_gyro_closes(turns, yaw_known):
    """At 104 Hz from rest to rest, against the attitudes of the smooth movement between the samples."""
    r = residual.segment_residuals(turns.batch(PERFECT, yaw_known), turns.rate)
    assert np.abs(r).max() < 1e-8


@pytest.mark.parametrize("yaw_known", [False, True])
def test_q_and_minus_q_are_one_attitude(yaw_known):
    p, q = unit(50, 1), unit(50, 2)
    for one, other in ((-p, q), (p, -q)):
        assert_allclose(residual.residual(one, other, yaw_known), residual.residual(p, q, yaw_known), atol=1e-15)


def test_with_gravity_alone_it_is_the_distance_to_the_nearest_yaw():
    """Brute force over yaw, sharpened by a search, for attitudes at any distance."""
    p, q = unit(6, 3), unit(6, 4)
    for predicted, seen, r in zip(p, q, residual.residual(p, q, False), strict=True):

        def distance(angle, predicted=predicted, seen=seen):
            there = rotation.multiply(yaw(angle), seen)
            return min(squared(predicted - there), squared(predicted + there))

        angles = np.linspace(-np.pi, np.pi, 181)
        best = angles[np.argmin([distance(angle) for angle in angles])]
        found = minimize_scalar(distance, bounds=(best - 0.04, best + 0.04), method="bounded", options={"xatol": 1e-10})
        assert squared(r) == pytest.approx(found.fun, abs=1e-12)


@pytest.mark.parametrize(("yaw_known", "about"), [(True, [1, 1, 1]), (False, [1, 1, 0])])
def test_error_angles_are_exact_however_large(yaw_known, about):
    vector = RNG.normal(size=(100, 3))
    vector *= (RNG.uniform(0, 179.9, 100) * DEG / np.linalg.norm(vector, axis=1))[:, None] * about
    r = residual.residual(rotation.multiply(rotation.exp(vector), unit(100)), unit(100), yaw_known)
    assert_allclose(residual.error_angles(r), vector[:, : 2 + yaw_known], atol=1e-9)


@pytest.mark.parametrize("rate_dps", [100.0, 20_000.0])
def test_attitudes_and_sensitivity_are_those_of_the_quaternions(rate_dps):
    """Of ordinary turns, and of steps of degrees that the series does not reach."""
    rng = np.random.default_rng(3)
    rate, dt, start = rng.normal(size=(45, 60, 3)) * rate_dps * DEG, np.full((45, 59), 1 / 208), unit(45)
    dt[5, 40:] = dt[:, 58:] = 0.0
    batch = Batch(rate, dt, np.full_like(rate, 1e-4), start, start, False)
    assert batch.trimmed().rate.shape == (45, 59, 3)
    along = rotation.multiply(start[:, None], rotation.accumulate(steps(rate - batch.earth, dt)))
    whole = attitudes(batch, rate)
    assert_array_equal(whole[:, 0], start)
    assert_allclose(whole[:, 1:], along, atol=1e-13)
    assert_allclose(end_attitude(batch, rate), along[:, -1], atol=1e-13)
    end, sensitivity = end_and_sensitivity(batch, rate)
    assert_allclose(end, along[:, -1], atol=1e-13)
    assert_allclose(sensitivity, rotation.matrix(whole) * sample_weights(dt)[..., None, None], atol=1e-14)


PERFECT = LinearModel(np.eye(3), np.zeros(3))
VERTICAL, LEVEL, SLANTED = (0.0, 0.0, 1.0), (0.6, 0.8, 0.0), (0.48, 0.64, 0.6)


def turned_about(axis_t, angles_deg, seconds=4.0, hz=104.0, seed=0):
    """A batch of turns about one axis of the room each, by these angles, from random attitudes; the angles not yet stated."""
    t_s = np.arange(round(seconds * hz)) / hz
    part = np.clip((t_s / t_s[-1] - 0.1) / 0.8, 0, 1)
    speed = np.sin(np.pi * part) ** 6
    speed /= speed.sum() / hz
    start = Rotation.random(len(angles_deg), random_state=seed)
    axis_b = start.inv().apply(axis_t)
    rate = np.multiply(angles_deg, DEG)[:, None, None] * speed[:, None] * axis_b[:, None]
    end = start * Rotation.from_rotvec(np.multiply(angles_deg, DEG)[:, None] * axis_b)
    q = [turn.as_quat(scalar_first=True) for turn in (start, end)]
    batch = Batch(rate, np.full((len(rate), len(t_s) - 1), 1 / hz), np.zeros_like(rate), *q, yaw_known=False)
    return batch, axis_b


def stating(batch, axis_b, angles_deg, sigma_deg=0.05):
    angles = np.multiply(angles_deg, DEG)
    return replace(batch, turns=KnownTurns(angles, np.where(np.isfinite(angles), sigma_deg * DEG, np.nan), axis_b))


ANGLES = [90.0, -90.0, 180.0, 270.0, -135.0, 360.0, -360.0, 720.0, -1080.0, 365.0, 45.0]


@pytest.mark.parametrize(("axis", "wrong_deg"), [(VERTICAL, 0.5), (LEVEL, -3.0), (SLANTED, 0.0)])
def test_a_wrong_angle_is_the_residual_exactly(axis, wrong_deg):
    """Predicted less stated, in the sense of the stated axis, wherever that points; the tilt does not see it."""
    batch, axis_b = turned_about(axis, ANGLES)
    angles = residual.error_angles(residual.segment_residuals(stating(batch, axis_b, np.add(ANGLES, wrong_deg)), batch.rate))
    assert_allclose(angles[:, 2], -wrong_deg * DEG, atol=1e-9)
    assert np.abs(angles[:, :2]).max() < 1e-9


def test_an_end_is_turned_to_where_the_known_angle_has_it():
    batch, axis_b = turned_about(SLANTED, ANGLES)
    off = rotation.multiply(batch.end, rotation.exp(0.01 * axis_b))
    back = stating(batch, axis_b, ANGLES).turns.turned(batch.start, off)
    assert_allclose(np.abs(np.sum(back * batch.end, axis=1)), 1, atol=1e-12)


def test_a_whole_circle_more_is_no_residual_and_q_and_minus_q_are_one():
    """Circles are counted by the gyro's readings (session/detect/segments.py), not by its attitude."""
    batch, axis_b = turned_about(SLANTED, ANGLES)
    known, more = (stating(batch, axis_b, np.add(ANGLES, degrees)).turns for degrees in (1.0, 361.0))
    turn = rotation.multiply(rotation.conjugate(batch.start), residual.end_attitude(batch, batch.rate))
    for found in (more.residual(turn), known.residual(-turn)):
        assert_allclose(found, known.residual(turn), atol=1e-12)


def test_the_earth_turns_below():
    """About the vertical in four seconds at 52 degrees north: -15.04 sin(52) deg/h; with the Earth in the batch, nothing."""
    angles = [90.0, -360.0, 720.0]
    batch = stating(*turned_about(VERTICAL, angles), angles)
    earth = vertical_only(52.0).in_body(residual.attitudes(batch, batch.rate))
    left, none = (residual.segment_residuals(each, batch.rate + earth) for each in (batch, replace(batch, earth=earth)))
    assert np.abs(none).max() < 1e-9
    assert_allclose(residual.error_angles(left)[:, 2], -EARTH_RATE_RPS * np.sin(52 * DEG) * batch.duration_s, rtol=1e-6)


RNG = np.random.default_rng(3)


def test_columns_of_known_angles_are_the_derivatives():
    angles = [30.0, -30.0, -135.0, 360.0, np.nan]
    batch, axis_b = turned_about(SLANTED, np.nan_to_num(angles, nan=70.0), seed=3)
    batch = stating(batch, axis_b, angles)
    J = linear.columns(residual.sensitivity(batch, batch.rate), batch.rate)
    exact = numeric_jacobian(lambda at: 2 * residual.segment_residuals(batch, LinearModel.from_vector(at)(batch.rate)), PERFECT.vector)
    assert_allclose(J, exact, atol=1e-4 * np.abs(J).max())


def tumbling(seconds=8.0, hz=100.0):
    t = np.arange(round(seconds * hz) + 1) / hz
    rate = np.stack([1.2 * np.sin(0.9 * t), 0.8 * np.cos(1.3 * t), 0.5 + 0.6 * np.sin(0.4 * t)], axis=1)
    return Motion(rate, np.full(len(t) - 1, 1 / hz), "tumbling")


@pytest.mark.parametrize("dps", [0.01, 50.0])
def test_the_cost_of_a_zero_at_rest_is_its_rate_times_the_time_however_far(dps):
    bias = np.array([2.0, -1.0, 2.0]) / 3 * dps * DEG
    part, error = at_rest(PERFECT, 60).largest_error(PERFECT, PERFECT.with_bias_moved(bias))
    assert part.duration_s == pytest.approx(60)
    assert error == pytest.approx(60 * bias, rel=1e-3)
    assert np.linalg.norm(error) == pytest.approx(60 * dps * DEG, rel=1e-9)


def test_the_cost_of_a_motion_is_the_largest_error_on_the_way():
    """A misalignment by eps misses 2 sin(eps / 2) 2 half way round a turn, and nothing after it."""
    eps, turn = 0.01, Motion(np.tile([0.0, 0.0, np.pi / 2], (401, 1)), np.full(400, 0.01), "a turn in 4 s")
    leant = LinearModel(Rotation.from_euler("x", eps).as_matrix(), np.zeros(3))
    assert np.linalg.norm(turn.error(PERFECT, leant)) < 1e-9
    part, error = turn.largest_error(PERFECT, leant)
    assert part.duration_s == pytest.approx(2.0, abs=0.02)
    assert np.linalg.norm(error) == pytest.approx(2 * eps, rel=1e-4)
    assert error == pytest.approx(part.error(PERFECT, leant), rel=1e-9)


def test_a_sensor_at_rest_measures_what_its_calibration_takes_off():
    """Its zero, by which an error of E counts as well: the rate is off by dE m + dB."""
    model = LinearModel(np.eye(3) + 0.01 * RNG.normal(size=(3, 3)), np.array([0.6, -0.4, 0.2]) * DEG)
    motion = at_rest(model, 60)
    assert len(motion.dt) == 600
    assert model(motion.measured) == pytest.approx(np.zeros_like(motion.measured), abs=1e-15)
    zero = -np.linalg.solve(model.E, model.B)
    assert motion.slope(model) == pytest.approx(60 * np.hstack([np.kron(np.eye(3), zero), np.eye(3)]), rel=1e-9, abs=1e-12)


def test_the_slope_is_that_of_the_exact_error_for_each_parameter():
    motion, model = tumbling(), LinearModel(np.eye(3) + 0.01 * RNG.normal(size=(3, 3)), 0.1 * DEG * RNG.normal(size=3))
    slope = motion.slope(model)
    for i in range(12):
        step = np.zeros(12)
        step[i] = 1e-6
        up, down = (motion.error(model, LinearModel.from_vector(model.vector + sign * step)) for sign in (1, -1))
        assert slope[:, i] == pytest.approx((up - down) / 2e-6, abs=2e-3 * np.abs(slope).max())  # sampled rates against one step each


def test_noise_turns_the_end_of_a_motion_by_the_walk_and_the_drift_of_its_axes():
    """At rest: density^2 T, and T^2 times the variance of the drift's mean; both along the axes that E makes of the sensor's."""
    E = np.eye(3) + 0.1 * RNG.normal(size=(3, 3))
    model, density, T = LinearModel(E, np.zeros(3)), np.array([1.0, 2.0, 3.0]) * 1e-4, 60.0
    drift = wander_covariance(np.array([T / 2]), np.array([T]), instability_rps=2e-5)[0, 0]
    for rps, share in ((0.0, 0.0), (2e-5, drift)):
        found = at_rest(model, T).noise_covariance(model, density, rps)
        assert_allclose(found, E @ (T * np.diag(density**2) + T**2 * share * np.eye(3)) @ E.T, rtol=3e-3, atol=1e-12)


def test_a_minute_of_a_recording_ends_with_it():
    t_ns = np.arange(151) * 20_000_000
    samples = Samples(t_ns, np.tile([0.1, 0.0, 0.0], (151, 1)), np.zeros((151, 3)))
    for most_s, found_s in ((60.0, 3.0), (2.0, 2.0)):
        motion = motion_of(samples, most_s)
        assert (motion.duration_s, len(motion.measured)) == (pytest.approx(found_s), len(motion.dt) + 1)
