"""The further kinds of the calibration subnet: the authors' published 26 parameters, and the net with conditions."""

import json

import numpy as np
import pytest
import torch

from session.io.errors import FitError
from session.io.samples import Samples
from tinygc import models
from tinygc.effects import Conditions
from tinygc.models.conditions_net import ConditionsModel, ConditionsNet, inputs_of
from tinygc.models.nets import CalibrationNet, PublishedNet

RNG = np.random.default_rng(0)
RATE = RNG.normal(size=(4, 50, 3)) * 3
INPUTS = np.concatenate([RATE, RNG.normal(size=(4, 50, 4))], axis=-1)
BOTH = ("temperature", "force")
KNOWN = Conditions(duration_s=100.0, fs_rps=8.7, first_temp_c=25.0)
STARTS = [(PublishedNet.identity(), RATE), (ConditionsNet.identity(BOTH), INPUTS)]


def some(start, seed=1, size=0.3):
    return start.with_vector(start.vector + size * np.random.default_rng(seed).normal(size=len(start.vector)))


@pytest.mark.parametrize(("start", "inputs"), STARTS)
def test_each_starts_at_the_exact_identity(start, inputs):
    np.testing.assert_array_equal(start(inputs), RATE)


def test_parameter_counts():
    """12 + 1 + 12 + 1 = 26; 27 and 6 for temperature, 18 for force."""
    assert len(PublishedNet.identity().vector) == 26
    counts = [len(ConditionsNet.identity(names).vector) for names in (("temperature",), ("force",), BOTH)]
    assert counts == [33, 45, 51]


def test_published_computes_its_equation():
    net, m = some(PublishedNet.identity()), RATE[0, 0]
    h = net.W1 @ m + net.b1
    u = net.W2 @ np.where(h >= 0, h, net.slope1 * h) + net.b2
    np.testing.assert_allclose(net(RATE)[0, 0], m + np.where(u >= 0, u, net.slope2 * u), atol=1e-14)


def test_conditions_compute_their_equation():
    net, x = some(ConditionsNet.identity(BOTH)), INPUTS[0, 0]
    m, c = x[:3], x[3:]
    np.testing.assert_allclose(net(INPUTS)[0, 0], net.net(m) + net.bias @ c + m * (net.gain @ c), atol=1e-13)


@pytest.mark.parametrize(("start", "inputs"), STARTS)
@pytest.mark.parametrize("angles", [2, 3])
def test_columns_are_the_chain_rule(start, inputs, angles):
    sensitivity, net = RNG.normal(size=(4, 50, angles, 3)), some(start)

    def phi(vector):
        return torch.einsum("stdi,sti->sd", torch.as_tensor(sensitivity), start_t.with_vector(vector)(torch.as_tensor(inputs)))

    start_t = net
    exact = torch.autograd.functional.jacobian(phi, torch.as_tensor(net.vector)).numpy()
    np.testing.assert_allclose(net.columns(sensitivity, inputs), exact, atol=1e-9)


@pytest.mark.parametrize(("start", "inputs"), STARTS)
def test_the_first_rung_is_the_linear_model(start, inputs):
    tie, prior = start.rungs(1.0)[0]
    assert tie == 0
    assert np.sum(prior > 1e-6) == 12


@pytest.mark.parametrize(
    "model", [some(PublishedNet.identity()), ConditionsModel(some(ConditionsNet.identity(BOTH)), KNOWN)], ids=["26", "51"]
)
def test_as_a_file_and_back(model, tmp_path):
    path = tmp_path / "model.json"
    path.write_text(json.dumps(models.to_dict(model), allow_nan=False))
    again = models.load(path)
    assert type(again) is type(model)
    np.testing.assert_array_equal(getattr(again, "net", again).vector, getattr(model, "net", model).vector)


def test_conditions_come_from_the_log():
    """Temperature less that of the fit, force in g, beside the rate; the model applies them."""
    count = 300
    samples = Samples(
        np.arange(count) * 5_000_000, RNG.normal(size=(count, 3)), np.tile([0.0, 0.0, -9.80665], (count, 1)), np.full(count, 27.0)
    )
    inputs = inputs_of(samples, BOTH, KNOWN)
    np.testing.assert_allclose(inputs[:, 3:], np.tile([2.0, 0, 0, -1.0], (count, 1)), atol=1e-12)
    net = ConditionsNet(CalibrationNet.identity(), np.eye(3, 4), np.zeros((3, 4)), BOTH)
    np.testing.assert_allclose(ConditionsModel(net, KNOWN).calibrate(samples) - samples.gyro, np.tile([2.0, 0, 0], (count, 1)), atol=1e-12)
    with pytest.raises(FitError, match="temperature"):
        inputs_of(Samples(samples.t_ns, samples.gyro, samples.accel), ("temperature",), KNOWN)
