"""One unit of the sensor on one bench: the errors that a calibration is to find, drawn once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.units import DEG, MG
from tinygc.simulation.options import SimulationOptions

FREQ_FINE_STEP = 0.0015  #: of the nominal rate, per LSB of INTERNAL_FREQ_FINE (int8)
ODR_SPREAD = 0.02  #: 1 sigma, of units seen
LARGEST_BIAS_DPS = 2.0
#: Digits that session.toml has.  The simulation uses the rounded numbers, so that the file is exact.
MATRIX_DIGITS, BIAS_DIGITS, HEADING_DIGITS = 8, 7, 4


@dataclass(frozen=True, eq=False)
class SimulatedUnit:
    """True errors: ``omega = E m + B`` with m as measured; ``f = accel_matrix @ (measured - accel_bias - accel_shift)``.

    E (3, 3), B (3,) rad/s; accel_matrix (3, 3), accel_bias (3,) m/s^2 as session.toml has them; accel_shift (3,) m/s^2 what
    session.toml does not know; odr_hz the true rate; heading_deg from true north to the table's index direction.
    """

    E: np.ndarray
    B: np.ndarray
    accel_matrix: np.ndarray
    accel_bias: np.ndarray
    accel_shift: np.ndarray
    odr_hz: float
    heading_deg: float

    def measured_rate(self, rate: np.ndarray) -> np.ndarray:
        """What the gyro makes of a true rate (N, 3) rad/s, before noise and low-pass: ``E^-1 (omega - B)``."""
        return (rate - self.B) @ np.linalg.inv(self.E).T

    def measured_force(self, force: np.ndarray) -> np.ndarray:
        """What the accelerometer makes of a true specific force (N, 3) m/s^2, before noise and low-pass."""
        return force @ np.linalg.inv(self.accel_matrix).T + self.accel_bias + self.accel_shift


def draw_unit(options: SimulationOptions, rng: np.random.Generator) -> SimulatedUnit:
    """Draw a unit.  Everything is drawn whatever the options say, so that one option does not change the others' draws."""
    bias_dps = np.clip(options.gyro_bias_dps * rng.standard_normal(3), -LARGEST_BIAS_DPS, LARGEST_BIAS_DPS)
    E = _near_identity(options.gyro_scale_error, options.gyro_misalignment, rng)
    accel_matrix = _near_identity(options.accel_scale_error, options.accel_misalignment, rng)
    accel_bias = options.accel_bias_mg * MG * rng.standard_normal(3)
    accel_shift = options.accel_calibration_error_mg * MG * rng.standard_normal(3)
    drawn_error, drawn_heading = ODR_SPREAD * rng.standard_normal(), rng.uniform(-180, 180)
    odr_error = drawn_error if options.odr_error is None else options.odr_error
    freq_fine = int(np.clip(np.rint(odr_error / FREQ_FINE_STEP), -128, 127))
    return SimulatedUnit(
        E=E,
        B=bias_dps * DEG,
        accel_matrix=np.round(accel_matrix, MATRIX_DIGITS),
        accel_bias=np.round(accel_bias, BIAS_DIGITS),
        accel_shift=accel_shift,
        odr_hz=options.odr_hz * (1 + FREQ_FINE_STEP * freq_fine),
        heading_deg=round(drawn_heading, HEADING_DIGITS) if options.heading_deg is None else options.heading_deg,
    )


def _near_identity(scale: float, cross: float, rng: np.random.Generator) -> np.ndarray:
    """(3, 3): 1 + N(0, scale) on the diagonal, N(0, cross) beside it."""
    return np.eye(3) + rng.standard_normal((3, 3)) * np.where(np.eye(3, dtype=bool), scale, cross)
