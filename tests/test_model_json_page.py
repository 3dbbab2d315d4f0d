"""A reader written from docs/model-json.md alone computes what an exported file says that must come out.

Only the files are made by the project: nothing that computes a model is imported here.
"""

import json

import numpy as np
import pytest
from exported_models import LINEAR, MODELS, NET, claim
from exports_read_back import KNOWN, context

from tinygc.deploy.exports import exporter
from tinygc.models.denoiser import DenoisedNet, Denoiser
from tinygc.models.physics import CarriedNet, PhysicsModel

G_MPS2 = 9.80665
INPUTS = ("measured_rps", "specific_force_mps2", "temperature_c")


def bend(h, slope):
    return np.where(h >= 0, h, slope * h)


def page_average(temperature, rate_hz):
    """(N,) degC, averaged over 1 s."""
    width, last = max(1, round(rate_hz)), len(temperature) - 1
    around = np.arange(len(temperature))[:, None] - width // 2 + np.arange(width)
    return temperature[np.clip(around, 0, last)].mean(axis=1)


def page_convolution(taps, dilation, x):
    """(out, N) of x (in, N), which stood still before its first sample."""
    before = np.repeat(x[:, :1], 6 * dilation, axis=1)
    held = np.concatenate([before, x], axis=1)
    n = np.arange(x.shape[1]) + 6 * dilation
    return sum(taps[:, :, i] @ held[:, n - (6 - i) * dilation] for i in range(7))


def page_net(table, axis, x):
    """(N,) of one axis' x (N,)."""
    y = x[None]
    for name, dilation in zip(("conv1", "conv2", "conv3"), table["dilations"], strict=True):
        y = page_convolution(np.array(table[name])[axis], dilation, y)
    return y[0]


def page_denoiser(table, rate):
    """(N, 3) of rate (N, 3), each axis by itself."""
    return np.stack([page_net(table, axis, x) for axis, x in enumerate(rate.T)], axis=1)


def page_reader(table, m, force, temperature, rate_hz):
    """(N, 3) rad/s: m (N, 3) rad/s, force (N, 3) m/s^2, temperature (N,) degC."""
    kind = table["kind"]
    w = {key: np.array(value) for key, value in table.get("weights", {}).items()}
    warmer = page_average(temperature, rate_hz) - table.get("conditions", {}).get("first_temp_c", np.nan)
    if kind == "linear":
        return m @ w["E"].T + w["B"]
    if kind == "tinygc":
        return m + bend(m @ w["W1"].T + w["b1"], w["slope"]) @ w["W2"].T + w["b2"]
    if kind == "tinygc_denoised":
        return page_denoiser(table["denoiser"], page_reader(table["calibration"], m, force, temperature, rate_hz))
    assert kind in ("physics", "tinygc_physics")
    E, B = (np.array(table["linear"][key]) for key in ("E", "B"))
    rate = m @ E.T + B
    for effect in table["effects"]:
        theta = np.array(effect["theta_si"])
        if effect["id"] == "gyro.g_sensitivity":
            rate = rate - force / G_MPS2 @ theta.reshape(3, 3).T
        elif effect["id"] == "gyro.thermal_bias":
            rate = rate - warmer[:, None] * theta
        else:
            assert effect["id"] == "gyro.thermal_scale"
            rate = rate / (1 + warmer[:, None] * theta)
    if kind == "physics":
        return rate
    return page_reader(table["net"], (rate - B) @ np.linalg.inv(E).T, force, temperature, rate_hz)


def random_denoiser():
    """Weights of either sign: the channels' sums stay positive, or no constant rate would pass."""
    return Denoiser.from_vector(np.random.default_rng(9).normal(size=(3, 56)) + 0.4).normalised()


PHYSICS = PhysicsModel(LINEAR, tuple(map(claim, ("gyro.thermal_scale", "gyro.g_sensitivity", "gyro.thermal_bias"))), KNOWN)
PAGE = {
    **{name: MODELS[name] for name in ("linear", "tinygc")},
    "physics": PHYSICS,
    "tinygc_physics": CarriedNet(PHYSICS, NET),
    "tinygc_denoised": DenoisedNet(NET, random_denoiser(), 208.0),
}


def exported(model):
    (text,) = exporter("json").export(model, context()).values()
    return json.loads(text)


def worst(table):
    """rad/s: the largest difference between the reader's answers and the file's own."""
    asked = table["self_test"]
    answers = page_reader(table, *(np.array(asked[key]) for key in INPUTS), asked["rate_hz"])
    return float(np.abs(answers - asked["omega_rps"]).max())


@pytest.mark.parametrize("name", PAGE)
def test_the_page_is_enough_to_compute_a_model(name):
    assert worst(exported(PAGE[name])) < 1e-12


def test_a_reader_without_a_dilation_or_the_bend_is_found_out():
    """So the tests above can fail."""
    table = exported(PAGE["tinygc_denoised"])
    table["denoiser"]["dilations"] = [1, 2, 4]
    assert worst(table) > 0.1
    table = exported(PAGE["tinygc"])
    table["weights"]["slope"] = [0.5, 0.5, 0.5]
    assert worst(table) > 0.01
