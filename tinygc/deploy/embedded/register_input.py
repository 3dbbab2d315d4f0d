"""What a sensor's registers mean, in single precision: gx gy gz ax ay az temp, as a log or a frame holds them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from session.log.config import Accelerometer, Config
from session.sensor.registers import (
    ACCEL_MG_PER_LSB,
    GYRO_MDPS_PER_LSB,
    TEMP_AT_ZERO_C,
    TEMP_LSB_PER_C,
    accel_mps2_per_lsb,
    gyro_rps_per_lsb,
)
from tinygc.deploy.embedded.affine import affine, table
from tinygc.deploy.embedded.stage import Inputs, single


@dataclass(frozen=True, eq=False)
class Registers:
    """gyro_fs_dps and accel_fs_g of the sensor, its true or nominal odr_hz, and the accelerometer's pre-calibration."""

    gyro_fs_dps: float = 500
    accel_fs_g: float = 4
    odr_hz: float = 208.0
    accelerometer: Accelerometer = field(default_factory=Accelerometer)

    @classmethod
    def of(cls, config: Config) -> Registers | None:
        """Of a session; None where its full scales are no ASM330LHH's, so that nothing is known of its registers."""
        sensor = config.sensor
        if sensor.gyro_fs_dps not in GYRO_MDPS_PER_LSB or sensor.accel_fs_g not in ACCEL_MG_PER_LSB:
            return None
        return cls(sensor.gyro_fs_dps, sensor.accel_fs_g, sensor.odr_hz, config.accelerometer)

    @property
    def constants(self) -> dict[str, np.ndarray]:
        """rad/s per LSB; the accelerometer's sensitivity, matrix and bias as one affine map; degC per LSB and at zero."""
        calibration, lsb = self.accelerometer, accel_mps2_per_lsb(self.accel_fs_g)
        force = table(calibration.matrix * lsb, -calibration.matrix @ calibration.bias_mps2, "the accelerometer's pre-calibration")
        return {
            "RPS_PER_LSB": single([gyro_rps_per_lsb(self.gyro_fs_dps)], "the sensitivity"),
            "FORCE": force,
            "TEMPERATURE": single([1 / TEMP_LSB_PER_C, TEMP_AT_ZERO_C], "the temperature"),
        }

    def inputs(self, registers: np.ndarray) -> Inputs:
        """From (N, 7) int16, in the order of the C."""
        constants, numbers = self.constants, np.asarray(registers).astype(np.float32)
        per_lsb, at_zero = constants["TEMPERATURE"]
        return Inputs(
            numbers[:, :3] * constants["RPS_PER_LSB"], affine(constants["FORCE"], numbers[:, 3:6]), numbers[:, 6] * per_lsb + at_zero
        )


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
