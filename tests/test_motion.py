"""One motion, and the attitude error of a calibration at its end."""

import numpy as np
import pytest

from session.io.errors import DataError
from session.io.samples import Samples
from session.io.units import DEG
from tinygc.closure.floor import wander_covariance
from tinygc.closure.motion import Motion, at_rest, motion_of
from tinygc.models.linear import LinearModel

RNG = np.random.default_rng(3)


def tumbling(seconds=8.0, hz=100.0):
    t = np.arange(round(seconds * hz) + 1) / hz
    rate = np.stack([1.2 * np.sin(0.9 * t), 0.8 * np.cos(1.3 * t), 0.5 + 0.6 * np.sin(0.4 * t)], axis=1)
    return Motion(rate, np.full(len(t) - 1, 1 / hz), "tumbling")


def test_a_bias_at_rest_turns_by_itself_times_the_time():
    one = LinearModel(np.eye(3), np.zeros(3))
    bias = np.array([0.01, -0.02, 0.005]) * DEG
    assert at_rest(one, 60).error(one, one.with_bias_moved(bias)) == pytest.approx(60 * bias, rel=1e-9)
    assert at_rest(one, 60).slope(one)[:, 9:] == pytest.approx(60 * np.eye(3), rel=1e-12)


@pytest.mark.parametrize("dps", [0.01, 2.9, 3.1, 5.9, 6.0, 6.1, 50.0])
def test_the_cost_of_a_zero_at_rest_is_its_rate_times_the_time_however_far(dps):
    one = LinearModel(np.eye(3), np.zeros(3))
    bias = np.array([2.0, -1.0, 2.0]) / 3 * dps * DEG
    part, error = at_rest(one, 60).largest_error(one, one.with_bias_moved(bias))
    assert part.duration_s == pytest.approx(60)
    assert error == pytest.approx(60 * bias, rel=1e-3)
    assert np.linalg.norm(error) == pytest.approx(60 * dps * DEG, rel=1e-9)


def test_the_cost_of_a_motion_is_the_largest_error_on_the_way():
    """A misalignment by eps misses 2 sin(eps / 2) 2 half way round a turn, and nothing after it."""
    eps, turn = 0.01, Motion(np.tile([0.0, 0.0, np.pi / 2], (401, 1)), np.full(400, 0.01), "a turn in 4 s")
    one = LinearModel(np.eye(3), np.zeros(3))
    leant = LinearModel(np.array([[1, 0, 0], [0, np.cos(eps), -np.sin(eps)], [0, np.sin(eps), np.cos(eps)]]), np.zeros(3))
    assert np.linalg.norm(turn.error(one, leant)) < 1e-9
    part, error = turn.largest_error(one, leant)
    assert part.duration_s == pytest.approx(2.0, abs=0.02)
    assert np.linalg.norm(error) == pytest.approx(2 * eps, rel=1e-4)
    assert error == pytest.approx(part.error(one, leant), rel=1e-9)


def test_a_sensor_at_rest_measures_what_its_calibration_takes_off():
    """Its zero, by which an error of E counts as well: the rate is off by dE m + dB."""
    model = LinearModel(np.eye(3) + 0.01 * RNG.normal(size=(3, 3)), np.array([0.6, -0.4, 0.2]) * DEG)
    motion = at_rest(model, 60)
    assert model(motion.measured) == pytest.approx(np.zeros_like(motion.measured), abs=1e-15)
    zero = -np.linalg.solve(model.E, model.B)
    assert motion.slope(model) == pytest.approx(60 * np.hstack([np.kron(np.eye(3), zero), np.eye(3)]), rel=1e-9, abs=1e-12)


def test_a_scale_error_after_one_turn_is_that_share_of_it():
    quarter = Motion(np.tile([0.0, 0.0, np.pi / 2], (101, 1)), np.full(100, 0.01), "a quarter turn in a second")
    longer = LinearModel(np.diag([1, 1, 1.001]), np.zeros(3))
    assert quarter.error(LinearModel(np.eye(3), np.zeros(3)), longer) == pytest.approx([0, 0, 1e-3 * np.pi / 2], abs=1e-12)


def test_the_slope_is_that_of_the_exact_error_for_each_parameter():
    motion, model = tumbling(), LinearModel(np.eye(3) + 0.01 * RNG.normal(size=(3, 3)), 0.1 * DEG * RNG.normal(size=3))
    slope = motion.slope(model)
    for i in range(12):
        step = np.zeros(12)
        step[i] = 1e-6
        up, down = (motion.error(model, LinearModel.from_vector(model.vector + sign * step)) for sign in (1, -1))
        assert slope[:, i] == pytest.approx((up - down) / 2e-6, abs=2e-3 * np.abs(slope).max())  # sampled rates against one step each


def test_white_noise_walks_with_the_root_of_the_time():
    one, density = LinearModel(np.eye(3), np.zeros(3)), np.array([1e-4, 2e-4, 3e-4])
    assert at_rest(one, 60).noise_covariance(one, density, 0.0) == pytest.approx(np.diag(density**2 * 60), rel=1e-12)


def test_noise_in_motion_agrees_with_drawn_samples():
    motion, model, density = tumbling(4), LinearModel(np.diag([1.0, 1.1, 0.9]), np.zeros(3)), np.array([1e-4, 4e-4, 2e-4])
    duration = np.r_[motion.dt[0] / 2, (motion.dt[1:] + motion.dt[:-1]) / 2, motion.dt[-1] / 2]
    slope = motion._sensitivity(model) @ model.E
    noise = RNG.normal(size=(2000, len(slope), 3)) * density / np.sqrt(duration)[:, None]
    draws = np.einsum("tij,dtj->di", slope, noise, optimize=True)
    expected = motion.noise_covariance(model, density, 0.0)
    assert np.cov(draws.T) == pytest.approx(expected, abs=5 * np.sqrt(2 / 2000) * np.diag(expected).max())


def test_flicker_noise_at_rest_is_its_mean_over_the_time():
    one = LinearModel(np.eye(3), np.zeros(3))
    found = at_rest(one, 60).noise_covariance(one, np.zeros(3), 1e-5)
    assert found == pytest.approx(np.eye(3) * 60**2 * wander_covariance(np.array([0.0]), 60.0, instability_rps=1e-5), rel=1e-2)


def samples(count, hz=50.0):
    t_ns = np.round(np.arange(count) / hz * 1e9).astype(np.int64)
    return Samples(t_ns, np.tile([0.1, 0.0, 0.0], (count, 1)), np.zeros((count, 3)))


def test_an_empty_motion_is_refused():
    with pytest.raises(DataError, match="fewer than two samples"):
        motion_of(samples(100), from_s=1e9)


def test_a_minute_of_a_recording_ends_with_it():
    motion = motion_of(samples(151), 60.0)
    assert motion.duration_s == pytest.approx(3.0)
    assert motion_of(samples(151), 2.0).duration_s == pytest.approx(2.0)
    assert len(motion.measured) == len(motion.dt) + 1
