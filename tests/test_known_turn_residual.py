"""A turn of known angle: what its residual is, exactly; its derivatives; what it adds to a fit, and how sure that is."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from conftest import Turns
from scipy.spatial.transform import Rotation

from session.io.units import DEG, EARTH_RATE_RPS
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.attitude.earth import vertical_only
from tinygc.closure.least_squares import fit_least_squares
from tinygc.closure.residual import Batch, KnownTurns
from tinygc.models import linear
from tinygc.models.linear import LinearModel, bias_only

PERFECT = LinearModel(np.eye(3), np.zeros(3))
TYPICAL = np.array([0.01, 0.005, -0.004, -0.006, -0.012, 0.003, 0.005, -0.002, 0.008, 1.0 * DEG, -0.7 * DEG, 0.4 * DEG])
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


def off_by(axis, degrees, seed=0):
    """Axes (S, 3) that are so many degrees away, in random directions."""
    across = np.cross(axis, np.random.default_rng(seed).normal(size=axis.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return np.cos(degrees * DEG) * axis + np.sin(degrees * DEG) * across


ANGLES = [90.0, -90.0, 180.0, 270.0, -135.0, 360.0, -360.0, 720.0, -1080.0, 365.0, 45.0]


@pytest.mark.parametrize("axis", [VERTICAL, LEVEL, SLANTED])
def test_a_perfect_gyro_leaves_nothing(axis):
    batch, axis_b = turned_about(axis, ANGLES)
    r = closure.segment_residuals(stating(batch, axis_b, ANGLES), batch.rate)
    assert r.shape == (len(ANGLES), 3)
    assert np.abs(r).max() < 1e-9


@pytest.mark.parametrize("axis", [VERTICAL, LEVEL, SLANTED])
@pytest.mark.parametrize("wrong_deg", [0.5, -3.0])
def test_a_wrong_angle_is_the_residual_exactly(axis, wrong_deg):
    """Predicted less stated, in the sense of the stated axis, wherever that points; the tilt does not see it."""
    batch, axis_b = turned_about(axis, ANGLES)
    angles = closure.error_angles(closure.segment_residuals(stating(batch, axis_b, np.add(ANGLES, wrong_deg)), batch.rate))
    np.testing.assert_allclose(angles[:, 2], -wrong_deg * DEG, atol=1e-9)
    assert np.abs(angles[:, :2]).max() < 1e-9


def test_the_axis_turned_round_is_the_angle_turned_round():
    batch, axis_b = turned_about(SLANTED, ANGLES)
    wrong = np.add(ANGLES, 1.0)
    one = closure.segment_residuals(stating(batch, axis_b, wrong), batch.rate)
    other = closure.segment_residuals(stating(batch, -axis_b, -wrong), batch.rate)
    np.testing.assert_allclose(other[:, 2], -one[:, 2], atol=1e-12)


def test_the_axis_need_not_be_known():
    """Five degrees of mounting: nothing for partial turns; for nearly whole circles sin(angle) times half the square of the error."""
    batch, axis_b = turned_about(SLANTED, ANGLES)
    r = closure.segment_residuals(stating(batch, off_by(axis_b, 5.0), ANGLES), batch.rate)
    bound = np.where(np.array(ANGLES) == 365.0, 5 * DEG * (5 * DEG) ** 2 / 2, 0.0)
    assert np.all(np.abs(2 * r[:, 2]) < bound + 1e-9)


def test_a_whole_circle_more_is_no_residual_and_q_and_minus_q_are_one():
    """Circles are counted by the gyro's readings (session/detect/segments.py), not by its attitude."""
    batch, axis_b = turned_about(SLANTED, ANGLES)
    known = stating(batch, axis_b, np.add(ANGLES, 1.0)).turns
    turn = rotation.multiply(rotation.conjugate(batch.start), closure.end_attitude(batch, batch.rate))
    more = stating(batch, axis_b, np.add(ANGLES, 361.0)).turns
    np.testing.assert_allclose(more.residual(turn), known.residual(turn), atol=1e-12)
    np.testing.assert_allclose(known.residual(-turn), known.residual(turn), atol=1e-12)


def test_the_earth_turns_below():
    """About the vertical in four seconds at 52 degrees north: -15.04 sin(52) deg/h; with the Earth in the batch, nothing."""
    batch, axis_b = turned_about(VERTICAL, [90.0, -360.0, 720.0])
    batch = stating(batch, axis_b, [90.0, -360.0, 720.0])
    earth = vertical_only(52.0).in_body(closure.attitudes(batch, batch.rate))
    with_earth = replace(batch, earth=earth)
    assert np.abs(closure.segment_residuals(with_earth, batch.rate + earth)).max() < 1e-9
    left = closure.error_angles(closure.segment_residuals(batch, batch.rate + earth))[:, 2]
    np.testing.assert_allclose(left, -EARTH_RATE_RPS * np.sin(52 * DEG) * batch.duration_s, rtol=1e-6)


def test_columns_are_the_derivatives():
    angles = [90.0, -135.0, 360.0, np.nan, -720.0, 200.0]
    batch, axis_b = turned_about(SLANTED, np.nan_to_num(angles, nan=70.0), seed=3)
    batch = stating(batch, axis_b, angles)
    J = linear.columns(closure.sensitivity(batch, batch.rate), batch.rate)
    for k in range(linear.PARAMETERS):
        step = 1e-5 * np.eye(linear.PARAMETERS)[k]
        there, back = (2 * closure.segment_residuals(batch, LinearModel.from_vector(PERFECT.vector + s)(batch.rate)) for s in (step, -step))
        np.testing.assert_allclose(J[..., k], (there - back) / 2e-5, atol=1e-4 * np.abs(J).max())
    assert np.abs(J[3, 2]).max() == 0  # an angle that is not known


def test_torch_gives_the_same_and_its_gradient_is_finite_where_nothing_is_left():
    angles = [90.0, 360.0, np.nan, -720.0]
    batch, axis_b = turned_about(SLANTED, np.nan_to_num(angles, nan=70.0))
    batch = stating(batch, axis_b, angles)
    rate = torch.tensor(batch.rate, dtype=torch.float64, requires_grad=True)
    r = closure.segment_residuals(batch, rate)
    np.testing.assert_allclose(r.detach().numpy(), closure.segment_residuals(batch, batch.rate), atol=1e-15)
    (r**2).sum().backward()
    assert torch.isfinite(rate.grad).all()


def with_net_angles(batch, q, known=None, error_rad=0.0, sigma_rad=1e-6):
    """Each turn's net angle stated, about its net axis."""
    net = Rotation.from_quat(np.roll(rotation.multiply(rotation.conjugate(q[:-1]), q[1:]), -1, axis=1)).as_rotvec()
    size = np.linalg.norm(net, axis=1)
    known = np.ones(len(batch), dtype=bool) if known is None else known
    return replace(
        batch, turns=KnownTurns(np.where(known, size + error_rad, np.nan), np.where(known, sigma_rad, np.nan), net / size[:, None])
    )


def test_nothing_known_changes_nothing():
    turns = Turns(16, seed=1)
    batch = turns.batch(LinearModel.from_vector(PERFECT.vector + TYPICAL))
    none = with_net_angles(batch, turns.q, known=np.zeros(16, dtype=bool))
    alone, both = (fit_least_squares(b, np.full(16, 1e-4), bias_only()) for b in (batch, none))
    np.testing.assert_allclose(both.model.vector, alone.model.vector, atol=1e-14)
    assert none.known.sum() == 32
