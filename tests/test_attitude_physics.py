"""Rotations against scipy's and their definition and integration of rates, and the Earth's rotation."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import wxyz
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_normal

from session.base import numeric, rotation
from session.base.units import DEG, DEG_PER_HOUR, EARTH_RATE_RPS
from tinygc.closure.earth import (
    EarthRate,
    contradicts,
    estimate_heading,
    no_earth,
    unseen_covariance,
    vertical_only,
    vertical_rate,
    with_heading,
)

RNG = np.random.default_rng(0)


def unit(*shape):
    q = np.random.default_rng(sum(shape)).normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def same_attitude(p, q, atol):
    """p and -p are one attitude."""
    assert_allclose(p * np.sign(np.sum(p * q, axis=-1, keepdims=True)), q, atol=atol)


def test_vectors_matrices_and_angles_are_their_definitions():
    v, w = RNG.normal(size=(2, 5, 3))
    assert_allclose(np.einsum("nij,nj->ni", rotation.cross_matrix(v), w), np.cross(v, w), atol=1e-15)
    assert_allclose(rotation.unit_vectors(v), [each / np.sqrt(each @ each) for each in v], atol=1e-15)
    assert_allclose(np.cos(rotation.angle_between(v, w)), np.sum(rotation.unit_vectors(v) * rotation.unit_vectors(w), axis=1), atol=1e-15)
    turned = Rotation.random(rng=1).as_matrix()
    assert_allclose(rotation.nearest_rotation(turned @ (np.eye(3) + 0.1 * v.T[:, :3] @ v[:3, :] / 5)), turned, atol=1e-12)
    assert np.linalg.det(rotation.nearest_rotation(-turned)) > 0


def test_sums_and_lengths_are_their_definitions():
    values = RNG.normal(size=(2, 4, 3))
    assert_allclose(numeric.running_sum(values, axis=1), [[each[:k].sum(axis=0) for k in range(5)] for each in values], atol=1e-15)
    assert numeric.running_sum([True, False, True]).tolist() == [0, 1, 1, 2]
    assert numeric.running_sum(np.zeros((0, 3))).tolist() == [[0, 0, 0]]
    assert numeric.rms_length(np.array([[3.0, 4], [0, 1]])) == pytest.approx(np.sqrt(13))
    assert numeric.median_length(np.array([[3.0, 4], [0, 1], [0, 2]])) == 2
    times, at = np.array([0, 2, 3]), np.array([-1, 0, 1, 2, 9])
    assert numeric.later_row(times, at).tolist() == [1, 1, 1, 1, 2]
    assert numeric.nearest_row(times, at).tolist() == [0, 0, 1, 1, 2]


def test_exp_and_log_are_scipys():
    vectors = RNG.normal(size=(500, 3)) * RNG.choice([1e-8, 1e-3, 0.06, 1, 5], (500, 1))
    same_attitude(rotation.exp(vectors), wxyz(Rotation.from_rotvec(vectors)), 1e-14)
    q = unit(500)
    assert_allclose(rotation.log(q), Rotation.from_quat(q, scalar_first=True).as_rotvec(), atol=1e-13)
    assert_array_equal(rotation.log(-q), rotation.log(q))


def test_small_angle_series_meets_the_closed_form():
    """From 1e-8 rad to 1 rad, across the switch, every component is exact to double precision."""
    angle = np.geomspace(1e-8, 1, 20001)
    q = rotation.exp(angle[:, None] * [0.36, -0.48, 0.8])
    long = angle.astype(np.longdouble)
    assert_allclose(q[:, 0], np.cos(long / 2).astype(float), rtol=4e-16)
    assert_allclose(q[:, 3], (0.8 * np.sin(long / 2)).astype(float), rtol=8e-16)
    assert rotation.exp(np.zeros(3)).tolist() == [1, 0, 0, 0]


def test_product_and_inverse_are_scipys():
    p, q = unit(2, 100)
    expected = Rotation.from_quat(p, scalar_first=True) * Rotation.from_quat(q, scalar_first=True)
    same_attitude(rotation.multiply(p, q), wxyz(expected), 1e-14)
    assert_allclose(rotation.multiply(q, rotation.conjugate(q)), np.tile([1, 0, 0, 0], (100, 1)), atol=1e-15)


def test_matrix_is_scipys_and_turns_body_vectors_to_the_table():
    q = unit(100)
    assert_allclose(rotation.matrix(q), Rotation.from_quat(q, scalar_first=True).as_matrix(), atol=1e-14)
    quarter_left = rotation.exp(np.array([0, 0, -np.pi / 2]))  # z is down: a negative turn is to the left
    assert_allclose(rotation.matrix(quarter_left) @ [1, 0, 0], [0, -1, 0], atol=1e-15)


@pytest.mark.parametrize("count", [1, 2, 3, 7, 64, 101])
def test_products_of_many_steps_are_scipys(count):
    steps, scipys, running = rotation.exp(RNG.normal(size=(4, count, 3))), Rotation.identity(4), []
    for k in range(count):
        scipys = scipys * Rotation.from_quat(steps[:, k], scalar_first=True)
        running.append(wxyz(scipys))
    pairs, running = rotation.of(steps), np.stack(running, axis=1)
    for found in (rotation.compose(steps), rotation.quaternions(rotation.compose_pairs(pairs))):
        same_attitude(found, running[:, -1], 1e-13)
    for found in (rotation.accumulate(steps), rotation.quaternions(rotation.accumulate_pairs(pairs))):
        same_attitude(found, running, 1e-13)


def test_roll_pitch_and_yaw_are_scipys():
    """R = Rz Ry Rx, beyond a quarter turn of pitch and at it."""
    angles = RNG.uniform(-np.pi, np.pi, (200, 3))
    angles[:4, 1] = np.pi / 2 * np.array([1, -1, 1 - 1e-9, -1 + 1e-9])
    same_attitude(rotation.from_euler(*angles.T), wxyz(Rotation.from_euler("ZYX", angles[:, ::-1])), 1e-14)


def test_from_gravity_holds_to_formats():
    """roll = atan2(-fy, -fz), pitch = atan2(fx, hypot(fy, fz)), yaw 0; and the attitude explains the force."""
    force = RNG.normal(size=(200, 3)) * 9.8
    q = rotation.from_gravity(force)
    fx, fy, fz = force.T
    expected = Rotation.from_euler("ZYX", np.stack([0 * fx, np.arctan2(fx, np.hypot(fy, fz)), np.arctan2(-fy, -fz)], -1))
    same_attitude(q, wxyz(expected), 1e-14)
    up = np.linalg.norm(force, axis=1)[:, None] * [0, 0, -1.0]
    assert_allclose(np.einsum("nij,nj->ni", rotation.matrix(q), force), up, atol=1e-13)


def test_small_rotations_alone_go_by_the_series():
    """Up to 0.2 rad to double precision; a longer one is refused, whatever the others are."""
    angle, axis = np.linspace(0, 0.1999, 50), np.array([0.36, -0.48, 0.8])
    into = np.empty(50, dtype=complex), np.empty(50, dtype=complex)
    assert rotation.exp_small(angle[:, None] * axis, into)
    assert_allclose(into[0].real, np.cos(angle / 2), atol=3e-16)
    assert_allclose(np.sqrt(into[0].imag ** 2 + np.abs(into[1]) ** 2), np.sin(angle / 2), atol=3e-17)
    angle[3] = 0.201
    assert not rotation.exp_small(angle[:, None] * axis, into)


def stills(seed, count=41, heading_deg=70.0, sigma_dps=0.0023):
    """Attitudes (Q, 4), rates (Q, 3) and sigmas of stills all around, as a gyro with a bias reads them."""
    rng = np.random.default_rng(seed)
    q = Rotation.random(count, random_state=rng).as_quat(scalar_first=True)
    sigma = np.full((count, 3), sigma_dps * DEG)
    rate = with_heading(31.03, heading_deg).in_body(q) + np.multiply([0.4, -0.2, 0.1], DEG)
    return q, rate + sigma * rng.standard_normal((count, 3)), sigma


def of_bias_and_earth(q, rate, unknown):
    """By scipy and numpy: values, A'A and the sum of squares of a bias and the first ``unknown`` components of the Earth's rate; the rest
    of its rate is known to be that down."""
    turn = Rotation.from_quat(q, scalar_first=True).inv().as_matrix()
    A = np.concatenate([np.tile(np.eye(3), (len(q), 1, 1)), turn[..., :unknown]], axis=2).reshape(-1, 3 + unknown)
    down = -EARTH_RATE_RPS * np.sin(31.03 * DEG) * turn[..., 2] * (unknown < 3)
    value, (left,), *_ = np.linalg.lstsq(A, (rate - down).ravel(), rcond=None)
    return value, A.T @ A, left


@pytest.mark.parametrize(
    ("latitude_deg", "down_dph", "north_dph"), [(90, -15.041, 0), (0, 0, 15.041), (31.03, -7.754, 12.888), (-90, 15.041, 0)]
)
def test_earth_rate_at_the_pole_the_equator_and_shanghai(latitude_deg, down_dph, north_dph):
    """North-east-down: at the north pole the rotation points up, at the equator north."""
    rate = with_heading(latitude_deg, 0.0).rate_t / DEG_PER_HOUR
    assert_allclose(rate, [north_dph, 0, down_dph], atol=0.002)
    assert_allclose(vertical_only(latitude_deg).rate_t / DEG_PER_HOUR, [0, 0, down_dph], atol=0.002)
    assert np.linalg.norm(rate) == pytest.approx(15.041, abs=1e-3)
    assert with_heading(latitude_deg, 0.0).heading_sigma_rad == 0


@pytest.mark.parametrize(
    ("count", "sigma_dps", "stated", "source"),
    [(41, 0.0023, 1.0, "estimated"), (41, 0.0023, 0.2, "estimated"), (2, 2e-4, 1.0, "estimated"), (4, 0.05, 1.0, "unknown")],
)
def test_the_heading_is_the_mean_of_all_headings_as_probable_as_least_squares_of_a_bias_and_a_level_rate_leaves_them(
    count, sigma_dps, stated, source
):
    """Beside scipy's sums over headings; noise larger than its sigma widens them; what the mean is short by lies across it."""
    q, rate, sigma = stills(3, count, heading_deg=-130.0, sigma_dps=sigma_dps)
    north, down = EARTH_RATE_RPS * np.cos(31.03 * DEG), -EARTH_RATE_RPS * np.sin(31.03 * DEG)
    value, information, left = of_bias_and_earth(q, rate, 2)
    variance = max((stated * sigma[0, 0]) ** 2, left / (3 * count - 5))
    heading = np.linspace(0, 2 * np.pi, 720, endpoint=False)
    each = np.stack([np.cos(heading), -np.sin(heading)], axis=1)
    law = multivariate_normal(value[3:], variance * np.linalg.inv(information)[3:, 3:])
    mean = np.average(each, axis=0, weights=law.pdf(north * each) / law.pdf(north * each).max())
    found = estimate_heading(31.03, q, rate, stated * sigma)
    assert_allclose(found.rate_t, [*north * mean, down], rtol=1e-3)
    assert found.heading_sigma_rad == pytest.approx(np.sqrt(-2 * np.log(np.linalg.norm(mean))), rel=1e-3)
    assert found.source == source
    if source == "unknown":
        return
    assert abs(np.angle(np.exp(1j * (found.heading_rad + 130 * DEG)))) < 4 * found.heading_sigma_rad
    across = np.array([-mean[1], mean[0], 0]) / np.linalg.norm(mean)
    expected = north**2 * (1 - mean @ mean) * np.outer(across, across)
    assert_allclose(unseen_covariance(found, 31.03), expected, atol=1e-3 * expected.max())


def test_a_heading_is_known_below_60_degrees():
    q, rate, sigma = stills(3)
    found = [estimate_heading(31.03, q, rate, factor * sigma) for factor in np.geomspace(5, 10, 60)]
    sigmas_deg = np.array([each.heading_sigma_rad for each in found]) / DEG
    assert [each.source == "estimated" for each in found] == (sigmas_deg < 60).tolist()
    assert np.histogram(sigmas_deg, [59, 60, 61])[0].min() > 0


def test_stills_of_one_attitude_tell_no_heading():
    """The bias takes it all: only the vertical part remains, within what noise adds to a mean over all headings."""
    q, _, sigma = stills(0)
    same = np.tile(q[:1], (41, 1))
    rate = with_heading(31.03, 70).in_body(same) + sigma * np.random.default_rng(1).standard_normal(sigma.shape)
    earth = estimate_heading(31.03, same, rate, sigma)
    assert earth.source == "unknown"
    assert_array_equal(earth.rate_t, vertical_only(31.03).rate_t)


def test_the_unknown_heading_leaves_the_spread_of_all_headings():
    """Against the mean over all headings: what is left of the Earth's rate beside the part that is taken off."""
    headings = np.arange(0, 360, 0.5)
    rates = np.array([with_heading(47.0, heading).rate_t for heading in headings])
    left = rates - vertical_only(47.0).rate_t
    assert_allclose(unseen_covariance(vertical_only(47.0), 47.0), left.T @ left / len(left), atol=1e-20)
    assert not unseen_covariance(with_heading(47.0, 30.0), 47.0).any()
    assert_allclose(unseen_covariance(no_earth(), 47.0), rates.T @ rates / len(rates), atol=1e-20)
    assert_allclose(np.trace(unseen_covariance(no_earth(), None)), EARTH_RATE_RPS**2)


@pytest.mark.parametrize("scatter", [0.1, 4.0])
def test_the_rate_about_down_is_that_of_least_squares_of_a_bias_and_three_components(scatter):
    """Noise larger than its sigma widens it by as much; attitudes that do not tell it from the bias give none."""
    q, _, sigma = stills(5, count=6)
    rate = np.array([1.0, 2.0, 3.0]) * sigma + scatter * sigma * np.random.default_rng(5).normal(size=sigma.shape)
    rate += Rotation.from_quat(q, scalar_first=True).inv().apply([1e-5, 0, -4e-5])
    value, information, left = of_bias_and_earth(q, rate, 3)
    wider = max(1.0, left / sigma[0, 0] ** 2 / 12)
    expected = value[5], sigma[0, 0] * np.sqrt(np.linalg.inv(information)[5, 5] * wider)
    assert vertical_rate(q, rate, sigma) == pytest.approx(expected, rel=1e-6)
    assert vertical_rate(np.tile(q[:1], (6, 1)), rate, sigma) is None


@pytest.mark.parametrize(
    ("sigma_deg", "source", "contradicted"),
    [(0.66, "estimated", True), (0.67, "estimated", False), (0.66, "unknown", False)],
)
def test_an_estimated_heading_contradicts_a_given_one_beyond_three_sigmas(sigma_deg, source, contradicted):
    estimate = EarthRate(np.zeros(3), 179 * DEG, sigma_deg * DEG, source)
    assert contradicts(estimate, with_heading(47.0, -179.0)) is contradicted
    for sigma_deg, sure in ((29.5, source == "estimated"), (30.5, False)):
        far = replace(estimate, heading_sigma_rad=sigma_deg * DEG, heading_rad=0.0)
        assert contradicts(far, with_heading(47.0, 180.0)) is sure


def test_a_quaternion_of_a_matrix_is_scipys():
    for q in [*unit(40), *np.eye(4)]:
        same_attitude(rotation.from_matrix(Rotation.from_quat(q, scalar_first=True).as_matrix()), q, 1e-13)
