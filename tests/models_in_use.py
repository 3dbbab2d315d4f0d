"""A log and a model of every kind, for the tests of models in use."""

import numpy as np
from conftest import DEG, Table

from tinygc.effects import AppliedEffect, Conditions, catalogue
from tinygc.models.denoiser import DenoisedNet, Denoiser
from tinygc.models.linear import LinearModel
from tinygc.models.nets import CalibrationNet
from tinygc.models.physics import CarriedNet, PhysicsModel

RATE_HZ = 104.0
SAMPLES = Table().tumble(3, rest_s=1.5).samples(odr_hz=RATE_HZ)
RNG = np.random.default_rng(5)
LINEAR = LinearModel(np.eye(3) + 0.01 * RNG.normal(size=(3, 3)), 0.01 * RNG.normal(size=3))
NET = CalibrationNet.from_vector(CalibrationNet.from_linear(LINEAR).vector + 0.01 * RNG.normal(size=27))
KNOWN = Conditions(duration_s=SAMPLES.duration_s + 20, fs_rps=500 * DEG, first_temp_c=25.0)


def smoothing():
    return Denoiser.from_vector(Denoiser.identity().vector + 0.05 * RNG.normal(size=(3, 56))).normalised()


def physics(*ids):
    claims = []
    for name in ids:
        effect = catalogue()[name]
        claims.append(AppliedEffect(effect, 0.02 * effect.parameter.plausible * (0.5 + RNG.random(effect.parameter.size))))
    return PhysicsModel(LINEAR, tuple(claims), KNOWN)


MANY = ("gyro.thermal_bias", "gyro.g_sensitivity", "gyro.bandwidth", "timing.axis_skew", "gyro.vibration_rectification")
MODELS = {
    "linear": LINEAR,
    "net": NET,
    "denoised": DenoisedNet(NET, smoothing(), RATE_HZ),
    "physics": physics(*MANY),
    "net behind physics": CarriedNet(physics("gyro.g_sensitivity", "gyro.scale_asymmetry"), NET),
}
