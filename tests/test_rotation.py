"""Rotations against scipy's, against their own definition, and through torch's derivatives."""

import numpy as np
import pytest
import torch
from conftest import wxyz
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from tinygc.attitude import rotation

RNG = np.random.default_rng(0)


def unit(*shape):
    q = np.random.default_rng(sum(shape)).normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def same_attitude(p, q, atol):
    """p and -p are one attitude."""
    np.testing.assert_allclose(p * np.sign(np.sum(p * q, axis=-1, keepdims=True)), q, atol=atol)


@given(arrays(float, 3, elements=st.floats(-1.8, 1.8)))
def test_log_undoes_exp_below_half_a_turn(vector):
    np.testing.assert_allclose(rotation.log(rotation.exp(vector)), vector, atol=1e-14)


def test_log_takes_the_shorter_way():
    vectors = RNG.normal(size=(500, 3)) * 4
    back = rotation.log(rotation.exp(vectors))
    assert np.linalg.norm(back, axis=1).max() <= np.pi + 1e-12
    same_attitude(rotation.exp(back), rotation.exp(vectors), 1e-14)
    q = unit(300)
    np.testing.assert_allclose(rotation.log(-q), rotation.log(q), atol=0)


def test_exp_and_log_are_scipys():
    vectors = RNG.normal(size=(500, 3)) * RNG.choice([1e-8, 1e-3, 0.06, 1, 5], (500, 1))
    same_attitude(rotation.exp(vectors), wxyz(Rotation.from_rotvec(vectors)), 1e-14)
    q = unit(500)
    np.testing.assert_allclose(rotation.log(q), Rotation.from_quat(q, scalar_first=True).as_rotvec(), atol=1e-13)


def test_small_angle_series_meets_the_closed_form():
    """From 1e-8 rad to 1 rad, across the switch, every component is exact to double precision."""
    angle = np.geomspace(1e-8, 1, 20001)
    q = rotation.exp(angle[:, None] * [0.36, -0.48, 0.8])
    long = angle.astype(np.longdouble)
    np.testing.assert_allclose(q[:, 0], np.cos(long / 2).astype(float), rtol=4e-16)
    np.testing.assert_allclose(q[:, 3], (0.8 * np.sin(long / 2)).astype(float), rtol=8e-16)
    assert rotation.exp(np.zeros(3)).tolist() == [1, 0, 0, 0]


def test_product_and_inverse_are_scipys():
    p, q = unit(2, 100)
    expected = Rotation.from_quat(p, scalar_first=True) * Rotation.from_quat(q, scalar_first=True)
    same_attitude(rotation.multiply(p, q), wxyz(expected), 1e-14)
    np.testing.assert_allclose(rotation.multiply(q, rotation.conjugate(q)), np.tile([1, 0, 0, 0], (100, 1)), atol=1e-15)


def test_matrix_is_scipys_and_turns_body_vectors_to_the_table():
    q = unit(100)
    np.testing.assert_allclose(rotation.matrix(q), Rotation.from_quat(q, scalar_first=True).as_matrix(), atol=1e-14)
    quarter_left = rotation.exp(np.array([0, 0, -np.pi / 2]))  # z is down: a negative turn is to the left
    np.testing.assert_allclose(rotation.matrix(quarter_left) @ [1, 0, 0], [0, -1, 0], atol=1e-15)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 7, 8, 13, 64, 101, 208])
def test_tree_product_is_the_product_one_after_the_other(count):
    steps = rotation.exp(RNG.normal(size=(4, count, 3)))
    one_by_one = steps[:, 0]
    for k in range(1, count):
        one_by_one = rotation.multiply(one_by_one, steps[:, k])
    np.testing.assert_allclose(rotation.compose(steps), one_by_one, atol=1e-13)
    scipys = Rotation.identity(4)
    for k in range(count):
        scipys = scipys * Rotation.from_quat(steps[:, k], scalar_first=True)
    same_attitude(rotation.compose(steps), wxyz(scipys), 1e-13)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 8, 31])
def test_running_product_holds_every_partial_product(count):
    steps = rotation.exp(RNG.normal(size=(3, count, 3)))
    running = rotation.accumulate(steps)
    assert running.shape == steps.shape
    for k in range(count):
        np.testing.assert_allclose(running[:, k], rotation.compose(steps[:, : k + 1]), atol=1e-13)


def test_from_euler_is_yaw_pitch_roll():
    roll, pitch, yaw = RNG.uniform(-3, 3, (3, 50))
    same_attitude(rotation.from_euler(roll, pitch, yaw), wxyz(Rotation.from_euler("ZYX", np.stack([yaw, pitch, roll], -1))), 1e-14)


def test_from_gravity_holds_to_formats():
    """roll = atan2(-fy, -fz), pitch = atan2(fx, hypot(fy, fz)), yaw 0; and the attitude explains the force."""
    force = RNG.normal(size=(200, 3)) * 9.8
    q = rotation.from_gravity(force)
    fx, fy, fz = force.T
    expected = Rotation.from_euler("ZYX", np.stack([0 * fx, np.arctan2(fx, np.hypot(fy, fz)), np.arctan2(-fy, -fz)], -1))
    same_attitude(q, wxyz(expected), 1e-14)
    up = np.linalg.norm(force, axis=1)[:, None] * [0, 0, -1.0]
    np.testing.assert_allclose(np.einsum("nij,nj->ni", rotation.matrix(q), force), up, atol=1e-13)


def test_level_and_nose_up():
    assert rotation.from_gravity(np.array([0, 0, -9.8])).tolist() == [1, 0, 0, 0]
    # Nose up by 30 deg: the x accelerometer, pushed forward and up against gravity, reads +g/2.
    nose_up = rotation.from_gravity(9.8 * np.array([0.5, 0, -np.sqrt(0.75)]))
    np.testing.assert_allclose(nose_up, rotation.exp(np.array([0, np.pi / 6, 0])), atol=1e-15)


@pytest.mark.parametrize("function", [rotation.exp, rotation.compose, rotation.accumulate, rotation.conjugate, rotation.matrix])
def test_torch_gives_what_numpy_gives(function):
    values = RNG.normal(size=(5, 7, 3)) if function is rotation.exp else unit(5, 7)
    np.testing.assert_allclose(function(torch.as_tensor(values)).numpy(), function(values), atol=1e-15)


def test_derivatives_exist_everywhere_even_at_zero():
    vectors = np.concatenate([np.zeros((1, 3)), [[1e-9, 0, 0], [0.06, 0.02, 0.0], [0.0633, 0, 0]], RNG.normal(size=(4, 3))])
    tensor = torch.as_tensor(vectors).requires_grad_()
    assert torch.autograd.gradcheck(rotation.exp, tensor, eps=1e-6, atol=1e-8, rtol=1e-6)
    # At exactly zero: dq = (0, dv / 2).
    at_zero = torch.autograd.functional.jacobian(rotation.exp, torch.zeros(3, dtype=torch.float64))
    np.testing.assert_array_equal(at_zero.numpy(), np.concatenate([np.zeros((1, 3)), np.eye(3) / 2]))


@pytest.mark.parametrize("count", [1, 2, 5, 8])
def test_product_is_differentiable(count):
    vectors = torch.as_tensor(RNG.normal(size=(2, count, 3))).requires_grad_()
    assert torch.autograd.gradcheck(lambda v: rotation.compose(rotation.exp(v)), vectors, eps=1e-6, atol=1e-8, rtol=1e-6)


def test_namespace_tells_tensors_from_arrays():
    assert rotation.namespace(np.zeros(3)) is np
    assert rotation.namespace(torch.zeros(3)) is torch


@pytest.mark.parametrize("shape", [(0, 3), (4, 0, 3), (3,), (2, 5, 3)])
def test_a_matrix_maps_vectors_of_any_shape_and_none(shape):
    vectors, matrix = np.random.default_rng(5).normal(size=shape), np.arange(9.0).reshape(3, 3)
    mapped = rotation.mapped(matrix, vectors)
    assert mapped.shape == shape
    np.testing.assert_allclose(mapped, vectors @ matrix.T, atol=1e-15)
