"""Quaternions as pairs of complex numbers: Hamilton's rules, and the same rotations as the quaternions' own."""

import numpy as np
import pytest

from session.io.units import DEG
from tinygc.attitude import rotation
from tinygc.attitude import rotation as pairs
from tinygc.attitude.rotation import sample_weights, steps
from tinygc.closure.residual import Batch, attitudes, end_and_sensitivity, end_attitude

ONE, X, Y, Z = np.eye(4)[:, None]


def unit(*shape):
    q = np.random.default_rng(sum(shape)).normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def product(p, q):
    return pairs.quaternions(pairs.multiply_pairs(pairs.of(p), pairs.of(q)))


def test_hamiltons_rules():
    """i² = j² = k² = ijk = -1, and no two of them change places."""
    for one in (X, Y, Z, product(X, Y)):
        np.testing.assert_array_equal(product(one, one), -ONE)
    np.testing.assert_array_equal(product(product(X, Y), Z), -ONE)
    np.testing.assert_array_equal(product(X, Y), Z)
    np.testing.assert_array_equal(product(Y, X), -Z)


def test_products_are_those_of_quaternions():
    p, q = unit(7, 5), unit(7, 5)[::-1]
    np.testing.assert_allclose(product(p, q), rotation.multiply(p, q), atol=1e-15)
    np.testing.assert_array_equal(pairs.quaternions(pairs.of(p)), p)


@pytest.mark.parametrize("count", [1, 2, 3, 8, 77])
def test_many_steps(count):
    q = unit(3, count)
    running = rotation.accumulate(q)
    np.testing.assert_allclose(pairs.quaternions(pairs.compose_pairs(pairs.of(q))), running[:, -1], atol=1e-13)
    np.testing.assert_allclose(pairs.quaternions(pairs.accumulate_pairs(pairs.of(q))), running, atol=1e-13)


def test_matrices_with_their_weights():
    q, weight = unit(3, 6), np.arange(1.0, 19.0).reshape(3, 6)
    found = np.empty((3, 3, 3, 6))
    pairs.matrices_into(found, pairs.of(q), weight)
    np.testing.assert_allclose(found, (rotation.matrix(q) * weight[..., None, None]).transpose(0, 2, 3, 1), rtol=0, atol=1e-13)


def test_small_rotations_alone_go_by_the_series():
    """Up to 0.2 rad to double precision; a longer one is refused, whatever the others are."""
    axis = np.random.default_rng(2).normal(size=(50, 3))
    vector = axis / np.linalg.norm(axis, axis=1, keepdims=True) * np.linspace(0, 0.1999, 50)[:, None]
    into = np.empty(50, dtype=complex), np.empty(50, dtype=complex)
    assert pairs.exp_small(vector, into)
    half = np.linspace(0, 0.1999, 50) / 2
    np.testing.assert_allclose(into[0].real, np.cos(half), atol=3e-16)
    np.testing.assert_allclose(np.sqrt(into[0].imag ** 2 + np.abs(into[1]) ** 2), np.sin(half), atol=3e-17)
    vector[3] *= 0.201 / np.linalg.norm(vector[3])
    assert not pairs.exp_small(vector, into)


@pytest.mark.parametrize("rate_dps", [100.0, 20_000.0])
def test_attitudes_and_sensitivity_are_those_of_the_quaternions(rate_dps):
    """Of ordinary turns, and of steps of degrees that the series does not reach."""
    rng = np.random.default_rng(3)
    rate, dt, start = rng.normal(size=(45, 60, 3)) * rate_dps * DEG, np.full((45, 59), 1 / 208), unit(45)
    dt[5, 40:] = 0.0
    batch = Batch(rate, dt, np.full_like(rate, 1e-4), start, start, False)
    along = rotation.multiply(start[:, None], rotation.accumulate(steps(rate - batch.earth, dt)))
    whole = attitudes(batch, rate)
    np.testing.assert_array_equal(whole[:, 0], start)
    np.testing.assert_allclose(whole[:, 1:], along, atol=1e-13)
    np.testing.assert_allclose(end_attitude(batch, rate), along[:, -1], atol=1e-13)
    end, sensitivity = end_and_sensitivity(batch, rate)
    np.testing.assert_allclose(end, along[:, -1], atol=1e-13)
    np.testing.assert_allclose(sensitivity, rotation.matrix(whole) * sample_weights(dt)[..., None, None], atol=1e-14)
