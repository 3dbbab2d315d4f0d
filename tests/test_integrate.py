"""Integration of rates: exact where it must be, and as wrong as theory says where it may be."""

import numpy as np
import pytest
from conftest import Turns, turned, wxyz
from scipy.integrate import solve_ivp

from session.io.units import DEG
from tinygc import SimulationOptions
from tinygc.attitude import rotation
from tinygc.attitude.rotation import CONING, sample_weights, step_vectors, steps
from tinygc.simulation.movement import hand_plan, move


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


def compose_with(c, rate, dt):
    """Mean rate and a coning term of any size: the integrator's is CONING, a straight rate's 1/12."""
    return rotation.compose(rotation.exp((rate[:-1] + rate[1:]) / 2 * dt[:, None] + c * dt[:, None] ** 2 * np.cross(rate[:-1], rate[1:])))


def errors_of_turns(odr_hz, *coning):
    """Root mean square over 8 smooth turns from rest to rest, rad, for each coning factor."""
    turns = Turns(8, seed=4, odr_hz=odr_hz)
    truth = rotation.multiply(rotation.conjugate(turns.q[:-1]), turns.q[1:])
    pairs = list(zip(turns.rate, turns.dt, strict=True))
    return [np.sqrt(np.mean(angle_between(np.array([compose_with(c, *pair) for pair in pairs]), truth) ** 2)) for c in coning]


def test_the_truth_of_the_turns_is_an_ode_solvers():
    """The reference that all closure tests rest on, against scipy's DOP853 on q' = q (0, w) / 2."""
    turns = Turns(2, seed=7)

    def slope(t, q):
        return rotation.multiply(q, np.array([0, *turns.rate_at(1, np.array([t]))[0]])) / 2

    solved = solve_ivp(slope, (0, turns.duration_s), turns.q[1], "DOP853", rtol=1e-12, atol=1e-13, max_step=0.05).y[:, -1]
    assert angle_between(solved / np.linalg.norm(solved), turns.q[2]) < 1e-11


def test_the_step_is_the_mean_rate_and_a_sixth_of_the_cross_product():
    rate, dt = np.random.default_rng(4).normal(size=(5, 4, 3)), np.random.default_rng(5).uniform(0.001, 0.1, (5, 3))
    expected = (rate[:, 1:] + rate[:, :-1]) / 2 * dt[..., None] + np.cross(rate[:, :-1], rate[:, 1:]) / 6 * dt[..., None] ** 2
    np.testing.assert_allclose(step_vectors(rate, dt), expected, atol=1e-15)
    assert pytest.approx(1 / 6) == CONING


@pytest.mark.parametrize("odr_hz", [52, 104, 208])
def test_from_rest_to_rest_the_error_is_of_fourth_order(odr_hz):
    """Half the step, a sixteenth of the error."""
    (coarse,), (fine,) = errors_of_turns(odr_hz, CONING), errors_of_turns(2 * odr_hz, CONING)
    assert coarse / fine == pytest.approx(16, rel=0.02)


@pytest.mark.parametrize(("odr_hz", "limit_deg"), [(104, 1e-5), (208, 1e-6)])
def test_a_sixth_beats_a_twelfth_a_hundredfold_on_hand_turns(odr_hz, limit_deg):
    """Minimum-jerk strokes with tremor, and the simulated table's exact attitudes: no integration in the truth."""
    plan = hand_plan(SimulationOptions(segments=40, closure_s=0), np.random.default_rng(0))
    errors = []
    for start_s, stop_s in plan.turns:
        t = np.arange(start_s - 0.2, stop_s + 0.2, 1 / odr_hz)
        motion = move(plan, t)
        outer, middle, inner = motion.angles[:, [0, -1]]
        first, last = rotation.from_euler(inner, middle, outer)
        truth = rotation.multiply(rotation.conjugate(first), last)
        ends = rotation.compose(steps(motion.rate, np.diff(t))), compose_with(1 / 12, motion.rate, np.diff(t))
        errors.append([angle_between(end, truth) for end in ends])
    sixth, twelfth = np.sqrt(np.mean(np.square(errors), axis=0)) / DEG
    assert sixth < limit_deg
    assert twelfth / sixth > 100


def test_a_movement_cut_in_the_middle_keeps_the_trapezoids_ends():
    """A tremor of 3 Hz about two axes, still going on: dt^2/12 of the rate's slope, turned to the end, at either end; second order."""

    def rate_at(t):
        return np.stack([1.5 * np.sin(6 * np.pi * t), 1.5 * np.cos(6 * np.pi * t), 0.3 * t], -1)

    def slope_at(t):
        return np.array([9 * np.pi * np.cos(6 * np.pi * t), -9 * np.pi * np.sin(6 * np.pi * t), 0.3])

    t = np.arange(4 * 208 + 78) / 208
    truth = wxyz(turned(rate_at, t[-1]))
    end = rotation.compose(steps(rate_at(t), np.diff(t)))
    error = rotation.log(rotation.multiply(rotation.conjugate(truth), end))  # in the end's body axes
    ends = slope_at(t[-1]) - rotation.matrix(truth).T @ slope_at(0.0)
    np.testing.assert_allclose(error, ends / 208**2 / 12, atol=0.01 * np.linalg.norm(error))


@pytest.mark.parametrize(("dps", "odr_hz", "percent"), [(400, 104, 0.04), (200, 104, 0.0094), (50, 104, 0.0006)])
def test_first_order_step_turns_by_theta_less_a_twelfth_of_its_cube(dps, odr_hz, percent):
    theta = dps * DEG / odr_hz
    q = steps(np.array([[dps * DEG, 0, 0]] * 2), np.array([1 / odr_hz]), "first-order")[0]
    short = (theta - np.linalg.norm(rotation.log(q))) / theta
    assert short == pytest.approx(theta**2 / 12, rel=0.01)
    assert 100 * short == pytest.approx(percent, rel=0.1)


def test_unknown_integrator_is_named():
    with pytest.raises(ValueError, match=r"'euler'.*exact, first-order"):
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
