"""A model as a program of stages, with its register input and its self-test vectors."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from session.base.errors import FormatError
from session.base.rotation import unit_vectors
from session.log.config import Accelerometer, Config, Sensor
from session.log.registers import DEFAULT
from session.log.sensors import Thermometer
from tinygc.deploy import ExportError, feature_exports
from tinygc.deploy.embedded.stages import calibration_net, denoise, effect_stage, linear
from tinygc.effects.device import Stage, affine
from tinygc.models.denoiser import DenoisedNet
from tinygc.models.linear import LinearModel
from tinygc.models.model import Model
from tinygc.models.nets import CalibrationNet
from tinygc.models.physics import CarriedNet, PhysicsModel


@dataclass(frozen=True, eq=False)
class Inputs:
    """Inputs of N samples on a device, all float32: rate (N, 3) rad/s, force (N, 3) m/s^2 pre-calibrated, temp_c (N,)."""

    rate: np.ndarray
    force: np.ndarray
    temp_c: np.ndarray

    @classmethod
    def of(cls, rate: ArrayLike, force: ArrayLike | None = None, temp_c: ArrayLike | None = None) -> Inputs:
        """Round to float32; missing inputs are zero."""
        rates = np.asarray(rate, dtype=np.float32)
        zeros = np.zeros_like(rates)
        return cls(
            rates,
            zeros if force is None else np.asarray(force, dtype=np.float32),
            zeros[:, 0] if temp_c is None else np.asarray(temp_c, dtype=np.float32),
        )


# A model as stages in single precision, in the order in which a device runs them.


@dataclass(frozen=True, eq=False)
class Program:
    """stages: in order, their constants in single precision; parameters: number of parameters of the source model."""

    stages: tuple[Stage, ...]
    parameters: int

    def run(self, inputs: Inputs) -> np.ndarray:
        """Return calibrated rates (N, 3) float32, bit for bit those of the C code for the same N samples in sequence."""
        rate = inputs.rate
        for stage in self.stages:
            rate = stage.numpy(stage.constants, rate, inputs)
        return rate

    @property
    def constants(self) -> dict[str, np.ndarray]:
        """Constants of all stages, by name in C."""
        return {name: array for stage in self.stages for name, array in stage.constants.items()}

    @property
    def identity(self) -> int:
        """CRC-32 of the weights, which identifies the model on a device."""
        return zlib.crc32(b"".join(array.astype("<f4").tobytes() for array in self.constants.values()))


def program(model: Model, rate_hz: float | None = None) -> Program:
    """Convert any model that ``tinygc.models`` reads; rate_hz: samples a second, needed for a temperature lag.

    Raises ExportError, which names what cannot be carried.
    """
    feature = feature_exports(model)
    stages = _stages(model) if feature is None else [feature.stage(model, rate_hz)]
    names = [name for stage in stages for name in stage.constants]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ExportError(f"two parts of the model call a constant {twice[0]} in C; json carries it, or give one of them another name")
    return Program(tuple(replace(stage, constants=single(stage.constants, stage.formula)) for stage in stages), model.parameters)


def single(constants: Mapping[str, ArrayLike], what: str) -> dict[str, np.ndarray]:
    """Round constants to float32; raises ExportError where float32 cannot represent a value."""
    with np.errstate(over="ignore"):
        rounded = {name: np.asarray(values, dtype=float).astype(np.float32) for name, values in constants.items()}
    if not all(np.isfinite(values).all() for values in rounded.values()):
        raise ExportError(f"{what} holds numbers beyond single precision; C cannot carry it, json can")
    return rounded


def _stages(model: Model) -> list[Stage]:
    if type(model) not in STAGES:
        raise ExportError(f"a model of type {type(model).__name__} cannot be exported to C: there is no C for it; json carries it")
    return STAGES[type(model)](model)


def _net_behind_physics(model: CarriedNet) -> list[Stage]:
    known = model.physics.linear
    inverse = np.linalg.inv(known.E)
    back = linear(LinearModel(inverse, -inverse @ known.B), "BACK", "r = E^-1 (r - B)")
    return [*_stages(model.physics), back, *_stages(model.net)]


#: kind of model -> its stages; other kinds cannot be exported to C
STAGES: dict[type, Callable[[Any], list[Stage]]] = {
    LinearModel: lambda model: [linear(model, "LINEAR", "r = r + (E - 1) r + B")],
    CalibrationNet: lambda model: [calibration_net(model)],
    DenoisedNet: lambda model: [*_stages(model.calibration), denoise(model.denoiser)],
    PhysicsModel: lambda model: [*_stages(model.linear), *(effect_stage(claim, model.known) for claim in model.claims)],
    CarriedNet: _net_behind_physics,
}


# The meaning of a sensor's registers, in single precision: gx gy gz ax ay az temp, as in a log or a frame.


#: whose registers a self-test has where those of the sensor are not known
USUAL = Sensor(DEFAULT, "", 208.0, 500, 4)


@dataclass(frozen=True, eq=False)
class Registers:
    """Of a sensor, with the accelerometer's calibration."""

    sensor: Sensor = USUAL
    accelerometer: Accelerometer = field(default_factory=Accelerometer)

    @classmethod
    def of(cls, config: Config, accelerometer: Accelerometer | None = None) -> Registers | None:
        """Return the registers of a session; None where the meaning of a register is unknown.

        accelerometer: the calibration on which the fit is based, where it differs from session.toml's.
        """
        try:
            units = config.sensor.register_units
            known = units.gyro_rps and units.accel_mps2 and units.thermometer
        except FormatError:
            return None
        return cls(config.sensor, accelerometer or config.accelerometer) if known else None

    @property
    def thermometer(self) -> Thermometer:
        """Scale of the temperature register."""
        thermometer = self.sensor.register_units.thermometer
        assert thermometer is not None  # ``of`` has checked this
        return thermometer

    @property
    def constants(self) -> dict[str, np.ndarray]:
        """rad/s per LSB; the accelerometer's sensitivity, matrix and bias as one affine map; degC per LSB and at zero."""
        units, thermometer = self.sensor.register_units, self.thermometer
        constants: dict[str, ArrayLike] = {
            "RPS_PER_LSB": [units.gyro_rps],
            "FORCE": force_map(self.accelerometer, units.accel_mps2),
            "TEMPERATURE": [1 / thermometer.lsb_per_c, thermometer.at_zero_c],
        }
        return single(constants, "the meaning of the registers")

    def inputs(self, registers: np.ndarray) -> Inputs:
        """Convert (N, 7) int16, in the order of the C code."""
        constants, numbers = self.constants, np.asarray(registers).astype(np.float32)
        per_lsb, at_zero = constants["TEMPERATURE"]
        return Inputs(
            numbers[:, :3] * constants["RPS_PER_LSB"], affine(constants["FORCE"], numbers[:, 3:6]), numbers[:, 6] * per_lsb + at_zero
        )


def force_map(accelerometer: Accelerometer, unit: float = 1.0) -> np.ndarray:
    """(3, 4) matrix and offset of a calibration, for readings of so many m/s^2."""
    return np.column_stack([accelerometer.matrix * unit, -accelerometer.matrix @ accelerometer.bias_mps2])


FORCE_FUNCTION = """\
void tinygc_force(const float measured[3], float force[3])
{
    affine(ACCELEROMETER, measured, force);
}
"""

FUNCTION = """\
void tinygc_from_registers(const int16_t registers[7], tinygc_input *in)
{
    float a[3];
    for (int i = 0; i < 3; i++) {
        in->rate[i] = (float)registers[i] * RPS_PER_LSB[0];
        a[i] = (float)registers[3 + i];
    }
    affine(FORCE, a, in->force);
    in->temp_c = (float)registers[6] * TEMPERATURE[0] + TEMPERATURE[1];
}
"""


# Inputs and expected outputs of a device's self-test.

#: longer than the denoiser's window, so that its ring buffers wrap
COUNT = 64
#: of the expected rate, plus 1 rad/s: far below the sensor's noise, far above the effect of the order of operations
TOLERANCE = 2e-6
#: to either side of the zero of the temperature register
SPAN_C = 16.0
_SEED = 195


def vectors(program: Program, registers: Registers) -> tuple[np.ndarray, np.ndarray]:
    """Return registers (COUNT, 7) int16, and the rates (COUNT, 3) float32 rad/s that the program gives for them in sequence.

    They have rates over the full range, gravity in all directions, and 16 degC to either side of the register's zero.
    """
    rng = np.random.default_rng(_SEED)
    numbers = rng.integers(-28000, 28000, size=(COUNT, 7)).astype(np.int16)
    direction = rng.normal(size=(COUNT, 3))
    one_g = 8192 * 4 / registers.sensor.accel_fs_g
    numbers[:, 3:6] = np.rint(unit_vectors(direction) * one_g)
    span = round(SPAN_C * registers.thermometer.lsb_per_c)
    numbers[:, 6] = rng.integers(-span, span, size=COUNT)
    return numbers, program.run(registers.inputs(numbers))
