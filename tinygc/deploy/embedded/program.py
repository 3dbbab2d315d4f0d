"""A model as stages of single precision, in the order in which a device runs them."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from tinygc.deploy.embedded.affine import Linear
from tinygc.deploy.embedded.convolutions import Denoise
from tinygc.deploy.embedded.effects import effect_stage
from tinygc.deploy.embedded.nets import CalibrationNetStage, Conditioned, Published
from tinygc.deploy.embedded.stage import Cost, Inputs, ProgramStage
from tinygc.deploy.embedded.thermal import Thermal
from tinygc.deploy.errors import ExportError
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.conditions_net import ConditionsModel
from tinygc.models.denoiser import DenoisedNet
from tinygc.models.linear import LinearModel
from tinygc.models.model import Model
from tinygc.models.physics import CarriedNet, PhysicsModel
from tinygc.models.published_net import PublishedNet
from tinygc.models.thermal import ThermalModel


@dataclass(frozen=True, eq=False)
class Program:
    """stages in order; parameters of the model they were made of."""

    stages: tuple[ProgramStage, ...]
    parameters: int

    def run(self, inputs: Inputs) -> np.ndarray:
        """Calibrated rates (N, 3) float32: what the C gives, bit for bit, when it is fed the N samples one after the other."""
        rate = inputs.rate
        for stage in self.stages:
            rate = stage.run(inputs, rate)
        return rate

    @property
    def constants(self) -> dict[str, np.ndarray]:
        """Of all stages, by name in C."""
        return {name: array for stage in self.stages for name, array in stage.constants.items()}

    @property
    def cost(self) -> Cost:
        """Of one sample, all stages."""
        return sum((stage.cost for stage in self.stages), Cost())

    @property
    def identity(self) -> int:
        """A CRC-32 of the weights: which model a device holds."""
        return zlib.crc32(b"".join(array.astype("<f4").tobytes() for array in self.constants.values()))


def program(model: Model, rate_hz: float | None = None) -> Program:
    """Of any model that ``tinygc.models`` reads; rate_hz: samples a second, which a lag of the temperature asks for.

    ExportError says what cannot be carried.
    """
    stages: tuple[ProgramStage, ...] = (Thermal(model, rate_hz),) if isinstance(model, ThermalModel) else tuple(_stages(model))
    names = [name for stage in stages for name in stage.constants]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ExportError(f"two parts of the model call a constant {twice[0]} in C; json carries it, or give one of them another name")
    return Program(stages, model.parameters)


def _stages(model: Model) -> list[ProgramStage]:
    if type(model) not in STAGES:
        raise ExportError(f"a model of type {type(model).__name__} cannot be exported to C: there is no C for it; json carries it")
    return STAGES[type(model)](model)


def _linear(model: LinearModel) -> list[ProgramStage]:
    return [Linear(model, "LINEAR", "r = E r + B")]


def _denoised(model: DenoisedNet) -> list[ProgramStage]:
    return [*_stages(model.calibration), Denoise(model.denoiser)]


def _physics(model: PhysicsModel) -> list[ProgramStage]:
    return [*_linear(model.linear), *(effect_stage(claim, model.known) for claim in model.claims)]


def _net_behind_physics(model: CarriedNet) -> list[ProgramStage]:
    linear = model.physics.linear
    inverse = np.linalg.inv(linear.E)
    back = Linear(LinearModel(inverse, -inverse @ linear.B), "BACK", "r = E^-1 (r - B)")
    return [*_stages(model.physics), back, *_stages(model.net)]


#: kind of model -> its stages; a kind that is not here has no C
STAGES: dict[type, Callable[[Any], list[ProgramStage]]] = {
    LinearModel: _linear,
    CalibrationNet: lambda model: [CalibrationNetStage(model)],
    PublishedNet: lambda model: [Published(model)],
    ConditionsModel: lambda model: [Conditioned(model)],
    DenoisedNet: _denoised,
    PhysicsModel: _physics,
    CarriedNet: _net_behind_physics,
}
