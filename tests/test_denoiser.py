"""The denoising subnet: its size, its reach, unit gain, either sign alike, and three forms of it that agree."""

import json

import numpy as np
import pytest
import torch

from session.io.errors import FormatError
from tinygc import models
from tinygc.models.denoiser import PARAMETERS, REACH, SHAPES, WINDOW, DenoisedNet, Denoiser
from tinygc.models.nets import CalibrationNet

RNG = np.random.default_rng(0)
RATE = RNG.normal(size=(200, 3)) + np.array([0.3, -0.2, 0.0])


def some_net():
    noise = 0.3 * np.random.default_rng(1).normal(size=(3, 56))
    return Denoiser.from_vector(Denoiser.identity().vector + noise).normalised()


def test_it_has_the_papers_195_parameters():
    """27 + 3 x 56."""
    assert [int(np.prod(shape[1:])) for shape in SHAPES.values()] == [14, 28, 14]
    assert Denoiser.identity().vector.shape == (3, 56)
    assert PARAMETERS == 168
    assert DenoisedNet(CalibrationNet.identity(), Denoiser.identity(), 208.0).parameters == 195


def test_it_starts_at_the_identity():
    np.testing.assert_allclose(Denoiser.identity()(RATE), RATE, atol=1e-14)


def test_it_reaches_49_of_the_50_samples_and_none_ahead():
    net, changed = some_net(), RATE.copy()
    changed[100, 1] += 1.0
    touched = np.flatnonzero(np.abs(net(changed) - net(RATE)).max(axis=1))
    assert (touched[0], touched[-1]) == (100, 148)
    assert REACH + 1 == 49 <= WINDOW
    untouched = np.abs(net(changed) - net(RATE))[:, [0, 2]]
    assert untouched.max() == 0  # each axis for itself


def test_a_constant_rate_passes_unchanged_at_either_sign():
    net = some_net()
    for rate in ([0, 0, 0], [1e-6, -1e-6, 3], [-5, 5, 0.1], [-0.02, 0.7, -8]):
        constant = np.tile(np.array(rate, float), (60, 1))
        np.testing.assert_allclose(net(constant), constant, rtol=1e-12, atol=0)


def test_it_is_odd_and_homogeneous():
    net = some_net()
    np.testing.assert_allclose(net(-RATE), -net(RATE), atol=1e-15)
    np.testing.assert_allclose(net(1e-3 * RATE), 1e-3 * net(RATE), atol=1e-15)


def test_it_keeps_the_integral_of_every_movement():
    """From rest to rest: what an attitude is made of."""
    movement = np.zeros((400, 3))
    movement[100:200] = np.cumsum(RNG.normal(size=(100, 3)), axis=0) * np.hanning(100)[:, None]
    total = movement.sum(axis=0)
    np.testing.assert_allclose(some_net()(movement).sum(axis=0), total, rtol=1e-12)


def test_windowed_and_whole_agree():
    net = some_net()
    whole = net(RATE)
    held = np.concatenate([np.tile(RATE[:1], (WINDOW - 1, 1)), RATE])
    windows = np.lib.stride_tricks.sliding_window_view(held, WINDOW, axis=0).transpose(0, 2, 1)
    np.testing.assert_allclose(net.windowed(windows)[:, -1], whole, atol=1e-14)


def test_single_precision_is_like_double():
    """A microcontroller's floats: the same to 1e-6 of the rate."""
    net = some_net()
    single = Denoiser(*(getattr(net, name).astype(np.float32) for name in SHAPES))
    np.testing.assert_allclose(single(RATE.astype(np.float32)), net(RATE), atol=3e-6 * np.abs(RATE).max())


def test_taps_and_delay_of_a_moving_average():
    """Seven sevenths in the first layer: 3 samples late, noise down by the root of 7."""
    net = Denoiser.identity()
    net.conv1[:, 0, 0, :] = 1 / 7
    np.testing.assert_allclose(net.taps()[:, :7], 1 / 7)
    assert np.abs(net.taps()[:, 7:]).max() == 0
    np.testing.assert_allclose(net.delay_samples, 3.0)
    noise = np.random.default_rng(2).normal(size=(20000, 3))
    assert net(noise).std() == pytest.approx(1 / np.sqrt(7), rel=0.02)


def test_without_its_delay_a_ramp_comes_back():
    model = DenoisedNet(CalibrationNet.identity(), some_net(), 208.0)
    model.denoiser.conv1[:], model.denoiser.conv2[:], model.denoiser.conv3[:] = 0, 0, 0
    model.denoiser.conv1[:, 0, 0, :] = 1 / 7
    model.denoiser.conv2[:, 0, 0, -1] = model.denoiser.conv3[:, 0, 0, -1] = 1
    ramp = np.tile(np.arange(100.0)[:, None], 3)
    np.testing.assert_allclose(model.undelayed(ramp)[10:-3], ramp[10:-3])
    assert model.delay_s == pytest.approx(3 / 208)


def test_torch_gives_what_numpy_gives():
    net = some_net()
    tensors = Denoiser.from_vector(torch.as_tensor(net.vector))
    np.testing.assert_allclose(tensors(torch.as_tensor(RATE)).numpy(), net(RATE), atol=1e-14)
    np.testing.assert_allclose(tensors.normalised().gain.numpy(), 1, atol=1e-14)


def test_a_net_that_passes_no_constant_is_refused():
    with pytest.raises(ValueError, match="no constant"):
        Denoiser.from_vector(np.zeros((3, 56))).normalised()


def test_as_a_file_and_back(tmp_path):
    model = DenoisedNet(CalibrationNet.from_vector(CalibrationNet.identity().vector + 0.01), some_net(), 211.3)
    path = tmp_path / "model.json"
    path.write_text(json.dumps(models.to_dict(model, session="s"), allow_nan=False))
    again = models.load(path)
    np.testing.assert_array_equal(again(RATE), model(RATE))
    assert (again.rate_hz, again.parameters) == (211.3, 195)
    earlier = json.loads(path.read_text())
    earlier["denoiser"]["slope"] = 1.0
    np.testing.assert_array_equal(models.from_dict(earlier)(RATE), model(RATE))


def broken(where="denoiser", **changes):
    table = json.loads(json.dumps(models.to_dict(DenoisedNet(CalibrationNet.identity(), Denoiser.identity(), 208.0))))
    (table if where is None else table[where]).update(changes)
    return table


@pytest.mark.parametrize(
    ("table", "complaint"),
    [
        (broken(conv1=[1, 2]), "conv1 has shape"),
        (broken(conv3=None), "denoiser"),
        (broken(slope="steep"), 'denoiser.slope is "steep", expected a number from 0 to 1'),
        (broken(slope=float("nan")), "denoiser.slope is NaN, which is not finite"),
        (broken(dilations=[1, 2, 60]), "dilations"),
        (broken(dilations=[1, 2, 4]), "other dilations than"),
        (broken(slope=0.3), "another slope than 1"),
        (broken(dilations=[1, 2, 0]), "dilations"),
        (broken(dilations=3), "denoiser.dilations is 3, expected 3 whole numbers from 1 to 50"),
        (broken(None, rate_hz=0), "rate_hz"),
        (broken(None, calibration=None), "calibration"),
        (broken(None, calibration=broken()), "does not follow"),
        (broken(None, denoiser=[]), "denoiser is a list of 0, expected a table"),
        (broken(conv1=(2 * Denoiser.identity().conv1).tolist()), "gain"),
        (broken(conv2=np.full(SHAPES["conv2"], np.nan).tolist()), "finite"),
    ],
)
def test_malformed_tables_are_refused_with_the_reason(table, complaint):
    with pytest.raises(FormatError, match=complaint):
        models.from_dict(table, "bad.json")
