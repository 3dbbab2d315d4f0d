"""Models of every kind that C can carry, and inputs for them: shared by the tests of the C on the host and on the board."""

from __future__ import annotations

import numpy as np

from tinygc.deploy.embedded.stages import Inputs
from tinygc.effects import AppliedEffect, Conditions, NoC, catalogue
from tinygc.models.denoiser import DenoisedNet, Denoiser
from tinygc.models.linear import LinearModel
from tinygc.models.nets import CalibrationNet
from tinygc.models.physics import CarriedNet, PhysicsModel

DEG = np.pi / 180
CARRIED = [name for name, effect in catalogue().items() if not isinstance(effect.device, NoC)]
RNG = np.random.default_rng(5)
KNOWN = Conditions(duration_s=200.0, fs_rps=500 * DEG, first_temp_c=25.3)

LINEAR = LinearModel(np.eye(3) + 0.012 * RNG.normal(size=(3, 3)), 0.01 * RNG.normal(size=3))
NET = CalibrationNet.from_vector(CalibrationNet.identity().vector + 0.01 * RNG.normal(size=27))


def denoiser() -> Denoiser:
    """One that smooths."""
    return Denoiser.from_vector(np.abs(RNG.normal(size=(3, 56)))).normalised()


def claim(effect: str) -> AppliedEffect:
    """An effect of a size that a sensor may have."""
    parameter = catalogue()[effect].parameter
    return AppliedEffect(catalogue()[effect], 0.1 * parameter.plausible * RNG.normal(size=parameter.size))


def physics(*effects: str) -> PhysicsModel:
    return PhysicsModel(LINEAR, tuple(map(claim, effects)), KNOWN)


WHOLE = DenoisedNet(NET, denoiser(), 208.0)
MODELS = {
    "linear": LINEAR,
    "tinygc": NET,
    **{effect: physics(effect) for effect in CARRIED},
    "physics": physics(*CARRIED),
    "tinygc_physics": CarriedNet(physics("gyro.g_sensitivity", "gyro.thermal_bias"), NET),
    "tinygc_denoised": WHOLE,
    "all of it": DenoisedNet(CarriedNet(physics(*CARRIED), NET), denoiser(), 208.0),
}


def random_inputs(count: int = 10_000, top: float = 500 * DEG, seed: int = 0) -> np.ndarray:
    """(N, 7) float32: rates over the full scale, gravity and a hand's jerks, 10 to 40 degC."""
    rng = np.random.default_rng(seed)
    force = 9.8 * rng.normal(size=(count, 3))
    return np.column_stack([rng.uniform(-top, top, (count, 3)), force, rng.uniform(10, 40, count)]).astype(np.float32)


def as_inputs(table: np.ndarray) -> Inputs:
    return Inputs.of(table[:, :3], table[:, 3:6], table[:, 6])
