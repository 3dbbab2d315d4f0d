"""Several units as one gyroscope: weights, fused rate, and the file format ``tinygc-array-model/1``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from scipy.linalg import block_diag

from session import VERSION
from session.base.errors import CalibrationError, FormatError
from session.base.numeric import sigmas_in
from session.base.records import ROTATION, read_record
from session.base.results import Array, Keys, Maybe, Number, Text
from session.log.config import OWN_UNITS, Accelerometer, Sensor
from tinygc.features.arrays.clocks import UnitClock
from tinygc.features.arrays.feature import LARGEST_NUMBER, MOST_UNITS, SCHEMA
from tinygc.models.files import UNITS
from tinygc.models.model import (
    ACCELEROMETER,
    COVARIANCE,
    FACTOR,
    MATRIX,
    RATE,
    ROUNDING,
    certain,
    covariance,
    sensor_table,
)

# The best linear unbiased combination of units that measure one rate (Gauss and Markov; Aitken for correlated noise).
#
#     omega = sum_i W_i x_i,   sum_i W_i = I,   W = (A^T Q^-1 A)^-1 A^T Q^-1,   covariance (A^T Q^-1 A)^-1
#
# x_i is a unit's calibrated rate in the array's frame, Q the noise covariance of all of them, A identities stacked vertically.

#: ratio of eigenvalues to the largest one below which a covariance is singular
SINGULAR = 1e-12


def best_weights(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return ``(weights (N, 3, 3), covariance of the combination (3, 3))`` for a noise covariance (3 N, 3 N) of the units, unit by unit.

    Raises CalibrationError where the covariance is singular.  Weights may be negative where noise is correlated.
    """
    count = len(covariance) // 3
    scale = sigmas_in(covariance)
    if not (scale > 0).all():
        raise CalibrationError("a unit's noise is 0: no best combination; give the noise of every axis")
    whitened = covariance / np.outer(scale, scale)
    if np.linalg.eigvalsh(whitened)[0] <= SINGULAR:
        raise CalibrationError("the units' noise covariance is singular (two units with the same noise): no best combination")
    stacked = np.tile(np.eye(3), (count, 1)) / scale[:, None]
    solved = np.linalg.solve(whitened, stacked)  # of Q^-1 A, its rows times their scale
    fused = np.linalg.inv(stacked.T @ solved)
    fused = (fused + fused.T) / 2
    weights = fused @ (solved / scale[:, None]).T
    weights = weights.reshape(3, count, 3).transpose(1, 0, 2)
    return weights, fused


def combined(weights: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return (3, 3), the covariance of a combination by any weights (N, 3, 3) of units with covariance (3 N, 3 N)."""
    row = weights.transpose(1, 0, 2).reshape(3, -1)
    return row @ covariance @ row.T


# Several units as one gyroscope: each unit's model and noise, and the best linear combination.
#
#     omega = sum_i W_i R_i (E_i m_i + B_i),   sum_i W_i = I
#
# m_i is the rate that unit i measures (register x sensitivity, rad/s), R_i its mounting, omega the rate in the array's frame.

EQUATION = "omega = sum_i weights_i @ mounting_i @ (E_i @ m_i + B_i), m_i the measured rate of unit i in rad/s"
#: noise for which the weights can be optimal
WHITE, INSTABILITY = "white", "instability"


def _correlation(matrix: np.ndarray) -> str:
    if wrong := certain(matrix):
        return wrong
    return "" if np.abs(np.diag(matrix) - 1).max() < ROUNDING else "has a diagonal other than 1, expected a correlation"


class _OfSensor(Keys):
    """The table ``sensor`` of a unit."""

    written = staticmethod(sensor_table)

    def made(self, value: Any) -> Sensor:
        """Of a table that was checked."""
        return Sensor(**{"model": "", "serial": ""} | {key: each for key, each in super().made(value).items() if each is not None})


_SPACE = Array((3, 3), sound=covariance)
_SENSOR = _OfSensor(
    {"odr_hz": Number(0, above=True), "gyro_fs_dps": Number(0, above=True), "accel_fs_g": Number(0, above=True)},
    {"model": Maybe(Text()), "serial": Maybe(Text()), **dict.fromkeys(OWN_UNITS, Number())},
)
_SIGMAS = Array((3,), Number(0, RATE.high, above=True))


@dataclass(frozen=True, eq=False, kw_only=True)
class FusedUnit:
    """One unit of the fused gyroscope, and one of ``units`` in its file.

    E, B: omega = E m + B in its own body frame; covariance (12, 12) of E row by row, then B, rad/s, None where it is not known; clock,
    mounting and position as of a ``UnitPlace``; noise density (3,), one-sided, of its own axes; bias instability (3,), None where it is not
    known; weights (3, 3) of its rate in the combination; sha256 of the logs that it was fitted to; accelerometer: None where it is
    uncalibrated.
    """

    number: Annotated[int, Number(0, LARGEST_NUMBER, whole=True)]
    E: Annotated[np.ndarray, MATRIX]
    B: Annotated[np.ndarray, Array((3,), RATE)]
    covariance: Annotated[np.ndarray | None, Array((12, 12), sound=covariance)] = None
    mounting: Annotated[np.ndarray, Array((3, 3), sound=ROTATION.sound)]
    mounting_covariance: Annotated[np.ndarray, _SPACE] = field(default_factory=lambda: np.zeros((3, 3)))
    position_m: Annotated[np.ndarray | None, Array((3,), Number(-1e3, 1e3))] = None
    position_covariance: Annotated[np.ndarray | None, _SPACE] = None
    clock: UnitClock
    noise_density_rps_rthz: Annotated[np.ndarray, _SIGMAS]
    bias_instability_rps: Annotated[np.ndarray | None, _SIGMAS] = None
    accel_noise_density_mps2_rthz: Annotated[float | None, Number(0, above=True)] = None
    weights: Annotated[np.ndarray, Array((3, 3), FACTOR)]
    sha256: tuple[str, ...] = ()
    sensor: Annotated[Sensor | None, _SENSOR] = None
    accelerometer: Annotated[Accelerometer | None, ACCELEROMETER] = None

    @cached_property
    def matrix(self) -> np.ndarray:
        """Return (3, 3), which takes the measured rate to the array's frame."""
        return self.mounting @ self.E

    @cached_property
    def offset(self) -> np.ndarray:
        """Return (3,) rad/s in the array's frame."""
        return self.mounting @ self.B

    def in_array(self, per_axis: np.ndarray) -> np.ndarray:
        """Return the covariance (3, 3) in the array's frame of independent noise with sigmas (3,) on the unit's own axes."""
        return self.matrix @ np.diag(np.square(per_axis)) @ self.matrix.T


@dataclass(frozen=True, eq=False, kw_only=True)
class ArrayModel:
    """Model of an array as one gyroscope, and its file.

    rate_hz of the samples; best_for, ``white`` or ``instability``, and the reason; noise_correlation (3 N, 3 N) of the units' white noise
    in the array's frame, None where it is independent; joint_covariance (12 N, 12 N) of all units' E and B, None where only the units' own
    are known; session it comes from.
    """

    schema = SCHEMA
    written = (
        *("version", "equation", "rates", "session", "rate_hz", "best_for", "reason"),
        *("units", "noise_correlation", "joint_covariance", "fused"),
    )
    version: str = VERSION
    equation: str = EQUATION
    rates: Annotated[str, Text((UNITS,))] = UNITS
    session: str = ""
    rate_hz: Annotated[float, Number(0, 1e6, above=True)]
    best_for: Annotated[str, Text((WHITE, INSTABILITY))] = WHITE
    reason: str = ""
    units: tuple[FusedUnit, ...]
    noise_correlation: Annotated[np.ndarray | None, Array((None, None), Number(-1 - ROUNDING, 1 + ROUNDING), _correlation)] = None
    joint_covariance: Annotated[np.ndarray | None, COVARIANCE] = None

    @property
    def fused(self) -> Annotated[dict[str, np.ndarray | None], Keys()]:
        """The combination's own noise density, bias instability, and sigma of its parameters at rest, each (3,), for people."""
        return {
            "noise_density_rps_rthz": self.noise_density,
            "bias_instability_rps": self.bias_instability,
            "bias_sigma_rps": self.bias_sigma,
        }

    def __len__(self) -> int:
        return len(self.units)

    @property
    def numbers(self) -> tuple[int, ...]:
        """Return the units' numbers."""
        return tuple(unit.number for unit in self.units)

    @cached_property
    def density(self) -> np.ndarray:
        """Return (3 N, 3 N) (rad/s)^2/Hz, one-sided: the white noise of all units in the array's frame."""
        whole = white_covariance(self.units)
        if self.noise_correlation is None:
            return whole
        sigma = sigmas_in(whole)
        return self.noise_correlation * np.outer(sigma, sigma)

    @property
    def noise_density(self) -> np.ndarray:
        """Return (3,) rad/s/sqrt(Hz), one-sided, of the combination."""
        return sigmas_in(combined(self.weights, self.density))

    @property
    def bias_instability(self) -> np.ndarray | None:
        """Return (3,) rad/s of the combination, with independent units; None where a unit's is not known."""
        wander = instability_covariance(self.units)
        return None if wander is None else sigmas_in(combined(self.weights, wander))

    @property
    def bias_sigma(self) -> np.ndarray | None:
        """Return (3,) rad/s, the combination's sigma at rest from the parameters' uncertainty; None where a unit's covariance is not
        known."""
        own = [unit.covariance for unit in self.units]
        if self.joint_covariance is None and any(each is None for each in own):
            return None
        # (3, 12) of each unit: derivatives by E and B of the rate in the array's frame
        columns = [unit.mounting @ np.hstack([np.kron(np.eye(3), np.linalg.solve(unit.E, -unit.B)), np.eye(3)]) for unit in self.units]
        row = np.hstack(self.weights @ columns)
        return sigmas_in(row @ (block_diag(*own) if self.joint_covariance is None else self.joint_covariance) @ row.T)

    def __call__(self, measured: np.ndarray) -> np.ndarray:
        """Combine all units' measured rates (..., N, 3) rad/s of the same times into (..., 3) rad/s in the array's frame."""
        return np.einsum("nij,...nj->...i", self.weights @ self.matrices, measured) + np.einsum("nij,nj->i", self.weights, self.offsets)

    @cached_property
    def weights(self) -> np.ndarray:
        """Return (N, 3, 3), which sum to identity."""
        return np.stack([unit.weights for unit in self.units])

    @cached_property
    def matrices(self) -> np.ndarray:
        """Return (N, 3, 3) of ``FusedUnit.matrix``."""
        return np.stack([unit.matrix for unit in self.units])

    @cached_property
    def offsets(self) -> np.ndarray:
        """Return (N, 3) rad/s of ``FusedUnit.offset``."""
        return np.stack([unit.offset for unit in self.units])

    @property
    def wrong(self) -> str:
        """What is wrong with a model whose keys are each sound, or nothing."""
        count = len(self)
        if not 2 <= count <= MOST_UNITS:
            return f"units has {count} entries, expected 2 to {MOST_UNITS}"
        if twice := next((number for number in self.numbers if self.numbers.count(number) > 1), None):
            return f"unit {twice} stands twice, expected each number once"
        for key, each in (("noise_correlation", 3), ("joint_covariance", 12)):
            matrix = getattr(self, key)
            if matrix is not None and matrix.shape != (each * count, each * count):
                return f"{key} has {len(matrix)} rows, expected {each * count}, {each} of each unit"
        if (off := np.abs(self.weights.sum(axis=0) - np.eye(3)).max()) > ROUNDING:
            return f"the units' weights miss identity by {off:.2g}, expected weights that sum to identity"
        # ``fused^-1 W_i`` is a unit's information. Sums of positive ones have a positive symmetric part, so they can be inverted.
        wander = instability_covariance(self.units)
        best = self.density if self.best_for == WHITE or wander is None else wander
        information = np.linalg.solve(combined(self.weights, best), self.weights)
        if np.linalg.eigvalsh((information + information.transpose(0, 2, 1)) / 2).min() <= 0:
            return "a unit's weights are not positive, so that they cannot be shared out when a unit is out"
        return ""


def white_covariance(units: Sequence[FusedUnit]) -> np.ndarray:
    """Return (3 N, 3 N) (rad/s)^2/Hz of the units' white noise, each its own, in the array's frame."""
    return block_diag(*(unit.in_array(unit.noise_density_rps_rthz) for unit in units))


def instability_covariance(units: Sequence[FusedUnit]) -> np.ndarray | None:
    """Return (3 N, 3 N) (rad/s)^2 of the units' bias instability in the array's frame; None where a unit's is not known."""
    known = [unit.in_array(unit.bias_instability_rps) for unit in units if unit.bias_instability_rps is not None]
    return block_diag(*known) if len(known) == len(units) else None


def load_array_model(path: Path | str) -> ArrayModel:
    """Read a model file.  Raises FormatError, in one line, for a file that is no array's model."""
    model = read_record(ArrayModel, Path(path))
    if model.wrong:
        raise FormatError(f"{path}: {model.wrong}; fit again, or correct the file")
    return model
