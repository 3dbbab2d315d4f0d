"""The calibration subnet: the exact identity at the start, 27 parameters, and derivatives that autograd confirms."""

from dataclasses import fields

import numpy as np
import pytest
import torch

from tinygc.models.linear import LinearModel
from tinygc.models.nets import PARAMETERS, CalibrationNet

RNG = np.random.default_rng(0)
RATE = RNG.normal(size=(4, 50, 3)) * 3


def some_net(seed=1):
    return CalibrationNet.from_vector(CalibrationNet.identity().vector + 0.3 * np.random.default_rng(seed).normal(size=27))


def test_it_starts_at_the_exact_identity():
    np.testing.assert_array_equal(CalibrationNet.identity()(RATE), RATE)


def test_it_has_the_papers_27_parameters():
    """12 + 3 + 12."""
    net = CalibrationNet.identity()
    sizes = {field.name: getattr(net, field.name).size for field in fields(net)}
    assert sizes == {"W1": 9, "b1": 3, "slope": 3, "W2": 9, "b2": 3}
    assert net.vector.shape == (PARAMETERS,) == (27,)


def test_with_slope_one_it_is_the_linear_model():
    linear = LinearModel(np.eye(3) + 0.05 * RNG.normal(size=(3, 3)), 0.1 * RNG.normal(size=3))
    np.testing.assert_allclose(CalibrationNet.from_linear(linear)(RATE), linear(RATE), atol=1e-14)


def test_it_computes_its_equation():
    """omega = m + W2 PReLU(W1 m + b1) + b2, one sample by hand."""
    net, m = some_net(), RATE[0, 0]
    h = net.W1 @ m + net.b1
    bent = np.array([value if value >= 0 else slope * value for value, slope in zip(h, net.slope, strict=True)])
    np.testing.assert_allclose(net(RATE)[0, 0], m + net.W2 @ bent + net.b2, atol=1e-14)


def test_slopes_make_an_asymmetry_of_scale():
    """Both signs have their own sensitivity: what the linear model cannot."""
    net = CalibrationNet(np.eye(3), np.zeros(3), np.array([0.0, 1, 1]), 0.01 * np.eye(3), np.zeros(3))
    np.testing.assert_allclose(net(np.array([[2.0, 0, 0], [-2.0, 0, 0]])), [[2.02, 0, 0], [-2.0, 0, 0]], atol=1e-15)


def test_vector_and_back():
    net = some_net()
    again = CalibrationNet.from_vector(net.vector)
    for field in fields(net):
        np.testing.assert_array_equal(getattr(again, field.name), getattr(net, field.name))


def test_torch_gives_what_numpy_gives():
    net = some_net()
    tensor_net = CalibrationNet.from_vector(torch.as_tensor(net.vector))
    np.testing.assert_allclose(tensor_net(torch.as_tensor(RATE)).numpy(), net(RATE), atol=1e-14)
    np.testing.assert_array_equal(tensor_net.vector.numpy(), net.vector)


@pytest.mark.parametrize("angles", [2, 3])
def test_columns_are_the_chain_rule(angles):
    """phi = sum_k S_k omega(m_k) is linear in omega: autograd's Jacobian of it is exact, and so must the columns be."""
    sensitivity = RNG.normal(size=(4, 50, angles, 3))
    net = some_net(3)

    def phi(vector):
        return torch.einsum("stdi,sti->sd", torch.as_tensor(sensitivity), CalibrationNet.from_vector(vector)(torch.as_tensor(RATE)))

    exact = torch.autograd.functional.jacobian(phi, torch.as_tensor(net.vector)).numpy()
    np.testing.assert_allclose(net.columns(sensitivity, RATE), exact, atol=1e-10)
