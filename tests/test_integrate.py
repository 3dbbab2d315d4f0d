"""Integration of rates: exact where it must be, and as wrong as theory says where it may be."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from session.units import DEG
from tinygc import rotation
from tinygc.integrate import cross, sample_weights, step_vectors, steps


def angle_between(p, q):
    return np.linalg.norm(rotation.log(rotation.multiply(rotation.conjugate(p), q)), axis=-1)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, -2, 2), (-3, 0, 4)])
@pytest.mark.parametrize("dps", [10, 200, -450])
def test_turn_at_constant_rate_closes(axis, dps):
    """360 degrees, and the fraction of a degree beyond, in steps of no common length."""
    axis = np.asarray(axis) / np.linalg.norm(axis)
    dt = np.random.default_rng(1).uniform(0.004, 0.006, 200)
    rate = np.tile(dps * DEG * axis, (201, 1))
    expected = rotation.exp(dps * DEG * dt.sum() * axis)
    assert angle_between(rotation.compose(steps(rate, dt)), expected) < 1e-9


def test_a_turn_to_plus_z_reads_plus_z():
    """Right-handed: a positive rate about z turns x towards y."""
    q = rotation.compose(steps(np.tile([0, 0, 90 * DEG], (101, 1)), np.full(100, 0.01)))
    np.testing.assert_allclose(rotation.matrix(q) @ [1, 0, 0], [0, 1, 0], atol=1e-12)


def coning(odr_hz, seconds=4.0):
    """A hand's tremor of 3 Hz about two axes out of phase, on a slow turn."""
    t = np.arange(round(seconds * odr_hz) + 1) / odr_hz
    return np.stack([1.5 * np.sin(2 * np.pi * 3 * t), 1.5 * np.cos(2 * np.pi * 3 * t), 0.5 + 0.3 * t], -1), np.full(len(t) - 1, 1 / odr_hz)


def test_coning_term_at_least_halves_the_error():
    rate, dt = coning(208)
    fine_rate, fine_dt = coning(208 * 64)
    truth = rotation.compose(steps(fine_rate, fine_dt))
    with_term = angle_between(rotation.compose(steps(rate, dt)), truth)
    mean_rate_only = (rate[:-1] + rate[1:]) / 2 * dt[:, None]
    without = angle_between(rotation.compose(rotation.exp(mean_rate_only)), truth)
    assert without > 1e-5  # there is something to win
    assert with_term < without / 2


def test_error_shrinks_with_the_square_of_the_step_or_faster():
    fine = rotation.compose(steps(*coning(208 * 64)))
    slow, fast = (angle_between(rotation.compose(steps(*coning(odr))), fine) for odr in (208, 416))
    assert fast < slow / 3.5


@pytest.mark.parametrize(("dps", "odr_hz", "percent"), [(400, 104, 0.04), (200, 104, 0.0094), (50, 104, 0.0006)])
def test_first_order_step_turns_by_theta_less_a_twelfth_of_its_cube(dps, odr_hz, percent):
    theta = dps * DEG / odr_hz
    q = steps(np.array([[dps * DEG, 0, 0]] * 2), np.array([1 / odr_hz]), "first-order")[0]
    turned = np.linalg.norm(rotation.log(q))
    short = (theta - turned) / theta
    assert short == pytest.approx(theta**2 / 12, rel=0.01)
    assert 100 * short == pytest.approx(percent, rel=0.1)


def test_first_order_error_posing_as_scale_error_is_400_ppm_of_a_whole_turn():
    rate, dt = np.tile([0, 400 * DEG, 0], (105, 1)), np.full(104, 1 / 104)
    exact, first = (rotation.compose(steps(rate, dt, name)) for name in ("exact", "first-order"))
    assert angle_between(exact, first) / (400 * DEG) == pytest.approx((400 * DEG / 104) ** 2 / 12, rel=0.01)


def test_unknown_integrator_is_named():
    with pytest.raises(ValueError, match="'euler'.*exact, first-order"):
        steps(np.zeros((2, 3)), np.ones(1), "euler")


def test_weights_sum_to_the_duration_and_integrate_straight_lines_exactly():
    dt = np.random.default_rng(2).uniform(0.001, 0.02, (3, 50))
    weights = sample_weights(dt)
    assert weights.shape == (3, 51)
    np.testing.assert_allclose(weights.sum(-1), dt.sum(-1), rtol=1e-14)
    t = np.concatenate([np.zeros((3, 1)), np.cumsum(dt, -1)], -1)
    np.testing.assert_allclose((weights * t).sum(-1), t[:, -1] ** 2 / 2, rtol=1e-13)


def test_steps_of_no_duration_do_not_turn():
    rate = np.random.default_rng(3).normal(size=(4, 3)) * 5
    np.testing.assert_array_equal(step_vectors(rate, np.zeros(3)), np.zeros((3, 3)))


def test_cross_is_numpys_and_two_coning_steps_are_bortzs():
    a, b = np.random.default_rng(4).normal(size=(2, 6, 3))
    np.testing.assert_allclose(cross(a, b), np.cross(a, b), atol=1e-15)
    # A linear rate over one step against a thousand small steps by scipy: what is left is of fifth order.
    first, last, dt = np.array([1.0, 2, -1]), np.array([1.5, 1.0, 0.5]), 0.02
    part = (np.arange(1000) + 0.5) / 1000
    turn = Rotation.identity()
    for p in part:
        turn = turn * Rotation.from_rotvec((first + p * (last - first)) * dt / 1000)
    np.testing.assert_allclose(step_vectors(np.stack([first, last]), np.array([dt]))[0], turn.as_rotvec(), atol=1e-9)
