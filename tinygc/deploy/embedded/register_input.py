"""What a sensor's registers mean, in single precision: gx gy gz ax ay az temp, as a log or a frame holds them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from session.common.errors import FormatError
from session.log.config import Accelerometer, Config
from session.sensor.known import DEFAULT
from session.sensor.profiles.profile import Thermometer
from session.sensor.registers import RegisterUnits
from tinygc.deploy.embedded.affine import affine, table
from tinygc.deploy.embedded.stage import Inputs, single


@dataclass(frozen=True, eq=False)
class Registers:
    """gyro_fs_dps and accel_fs_g of the sensor, its true or nominal odr_hz, the accelerometer's pre-calibration, what its registers mean;
    model: its name; own_units: as in session.toml."""

    gyro_fs_dps: float = 500
    accel_fs_g: float = 4
    odr_hz: float = 208.0
    accelerometer: Accelerometer = field(default_factory=Accelerometer)
    model: str = DEFAULT
    own_units: Mapping[str, float | None] = field(default_factory=dict)

    @classmethod
    def of(cls, config: Config, accelerometer: Accelerometer | None = None) -> Registers | None:
        """Of a session; None where it is not known what all of its sensor's registers mean.

        accelerometer: the calibration that the fit rests on, where that is not session.toml's.
        """
        sensor = config.sensor
        own = accelerometer or config.accelerometer
        registers = cls(sensor.gyro_fs_dps, sensor.accel_fs_g, sensor.odr_hz, own, sensor.model, sensor.own_units)
        try:
            return registers if registers.units.gyro_rps and registers.units.accel_mps2 and registers.units.thermometer else None
        except FormatError:
            return None

    @property
    def units(self) -> RegisterUnits:
        """Per LSB, SI."""
        return RegisterUnits(self.model, self.gyro_fs_dps, self.accel_fs_g, **self.own_units)

    @property
    def thermometer(self) -> Thermometer:
        """Of its temperature register."""
        assert self.units.thermometer is not None  # ``of`` has looked
        return self.units.thermometer

    @property
    def constants(self) -> dict[str, np.ndarray]:
        """rad/s per LSB; the accelerometer's sensitivity, matrix and bias as one affine map; degC per LSB and at zero."""
        calibration, lsb, thermometer = self.accelerometer, self.units.accel_mps2, self.thermometer
        force = table(calibration.matrix * lsb, -calibration.matrix @ calibration.bias_mps2, "the accelerometer's pre-calibration")
        return {
            "RPS_PER_LSB": single([self.units.gyro_rps], "the sensitivity"),
            "FORCE": force,
            "TEMPERATURE": single([1 / thermometer.lsb_per_c, thermometer.at_zero_c], "the temperature"),
        }

    def inputs(self, registers: np.ndarray) -> Inputs:
        """From (N, 7) int16, in the order of the C."""
        constants, numbers = self.constants, np.asarray(registers).astype(np.float32)
        per_lsb, at_zero = constants["TEMPERATURE"]
        return Inputs(
            numbers[:, :3] * constants["RPS_PER_LSB"], affine(constants["FORCE"], numbers[:, 3:6]), numbers[:, 6] * per_lsb + at_zero
        )


def force_constant(accelerometer: Accelerometer) -> np.ndarray:
    """(3, 4) float32: from m/s^2 as measured to calibrated specific force, as one affine map."""
    matrix, bias = accelerometer.matrix, accelerometer.bias_mps2
    return table(matrix, -matrix @ bias, "the accelerometer's calibration")


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
