"""Several units as one gyroscope: what each measures and is worth, and the best linear combination of them.

    omega = sum_i W_i R_i (E_i m_i + B_i),   sum_i W_i = I

m_i is the rate that unit i measures (register x sensitivity, rad/s), R_i its mounting, omega the rate in the array's frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from session.log.config import Accelerometer, Sensor
from tinygc.array.fused.weights import blocks, combined
from tinygc.array.places.place import UnitPlace
from tinygc.models.linear import LinearModel

EQUATION = "omega = sum_i weights_i @ mounting_i @ (E_i @ m_i + B_i), m_i the measured rate of unit i in rad/s"
#: what the weights can be best for
WHITE, INSTABILITY = "white", "instability"


@dataclass(frozen=True, eq=False)
class FusedUnit:
    """One unit: place (number, clock, mounting, position); model, omega = E m + B in its own body frame; sensor; accelerometer, None where
    nobody has calibrated it; noise_density (3,) rad/s/sqrt(Hz), one-sided, of its own axes; bias_instability (3,) rad/s, None where it
    is not known; covariance (12, 12) of E row by row, then B, rad/s, None where it is not known; accel_noise_density m/s^2/sqrt(Hz);
    sha256 of the logs that it was fitted to."""

    place: UnitPlace
    model: LinearModel
    noise_density: np.ndarray
    bias_instability: np.ndarray | None = None
    covariance: np.ndarray | None = None
    sensor: Sensor | None = None
    accelerometer: Accelerometer | None = None
    accel_noise_density: float | None = None
    sha256: tuple[str, ...] = ()

    @property
    def number(self) -> int:
        """The unit's, as its files name it."""
        return self.place.number

    @cached_property
    def matrix(self) -> np.ndarray:
        """(3, 3): from the measured rate to the array's frame."""
        return self.place.mounting @ self.model.E

    @cached_property
    def offset(self) -> np.ndarray:
        """(3,) rad/s in the array's frame."""
        return self.place.mounting @ self.model.B

    def in_array(self, per_axis: np.ndarray) -> np.ndarray:
        """(3, 3): the covariance in the array's frame of noise that has sigmas (3,) on the unit's own axes, independent."""
        return self.matrix @ np.diag(np.square(per_axis)) @ self.matrix.T

    def parameter_columns(self, rate: np.ndarray) -> np.ndarray:
        """(3, 12): how E and B move the rate in the array's frame, at a true rate (3,) rad/s there."""
        measured = np.linalg.solve(self.model.E, self.place.mounting.T @ rate - self.model.B)
        return self.place.mounting @ np.hstack([np.kron(np.eye(3), measured), np.eye(3)])


@dataclass(frozen=True)
class Disagreement:
    """By how much units of this array differ beyond their white noise, one sigma of each: bias_rps at rest; scale, of the rate; delay_s, of
    the rate's change: their moments within a sample, and filters."""

    bias_rps: float = 0.0
    scale: float = 0.0
    delay_s: float = 0.0


@dataclass(frozen=True, eq=False)
class ArrayModel:
    """units; weights (N, 3, 3); rate_hz of the samples; best_for, ``white`` or ``instability``, and the reason; correlation (3 N, 3 N) of
    the units' white noise in the array's frame, None where it is independent; disagreement; joint_covariance (12 N, 12 N) of all units'
    E and B, None where the units' own stand alone; session it comes from."""

    units: tuple[FusedUnit, ...]
    weights: np.ndarray
    rate_hz: float
    best_for: str = WHITE
    reason: str = ""
    correlation: np.ndarray | None = None
    disagreement: Disagreement = field(default_factory=Disagreement)
    joint_covariance: np.ndarray | None = None
    session: str = ""

    def __len__(self) -> int:
        return len(self.units)

    @property
    def numbers(self) -> tuple[int, ...]:
        """Of the units."""
        return tuple(unit.number for unit in self.units)

    @cached_property
    def density(self) -> np.ndarray:
        """(3 N, 3 N) (rad/s)^2/Hz, one-sided: the white noise of all units in the array's frame."""
        return white_covariance(self.units, self.correlation)

    @cached_property
    def fused_density(self) -> np.ndarray:
        """(3, 3) (rad/s)^2/Hz, one-sided, of the combination."""
        return combined(self.weights, self.density)

    @property
    def best_covariance(self) -> np.ndarray:
        """(3, 3) of the combination, of the noise that the weights are best for; white noise where no bias instability is known."""
        wander = instability_covariance(self.units)
        return self.fused_density if self.best_for == WHITE or wander is None else combined(self.weights, wander)

    @property
    def noise_density(self) -> np.ndarray:
        """(3,) rad/s/sqrt(Hz), one-sided, of the combination."""
        return np.sqrt(np.diag(self.fused_density))

    @property
    def bias_instability(self) -> np.ndarray | None:
        """(3,) rad/s of the combination, the units' being independent; None where a unit's is not known."""
        wander = instability_covariance(self.units)
        return None if wander is None else np.sqrt(np.diag(combined(self.weights, wander)))

    def parameter_sigma(self, rate: np.ndarray | None = None) -> np.ndarray | None:
        """(3,) rad/s: what the parameters' uncertainty leaves in the combination at a true rate (3,) rad/s, at rest without it.

        None where a unit's covariance is not known.
        """
        rate = np.zeros(3) if rate is None else rate
        columns = np.stack([unit.parameter_columns(rate) for unit in self.units])
        row = (self.weights @ columns).transpose(1, 0, 2).reshape(3, -1)
        if self.joint_covariance is not None:
            return np.sqrt(np.diag(row @ self.joint_covariance @ row.T))
        own = [unit.covariance for unit in self.units]
        if any(each is None for each in own):
            return None
        return np.sqrt(np.diag(row @ blocks(np.stack([each for each in own if each is not None])) @ row.T))

    def __call__(self, measured: np.ndarray) -> np.ndarray:
        """(..., 3) rad/s in the array's frame, of all units' measured rates (..., N, 3) rad/s of the same moments: no unit is left out."""
        return np.einsum("nij,...nj->...i", self.weights @ self.matrices, measured) + np.einsum("nij,nj->i", self.weights, self.offsets)

    @cached_property
    def matrices(self) -> np.ndarray:
        """(N, 3, 3) of ``FusedUnit.matrix``."""
        return np.stack([unit.matrix for unit in self.units])

    @cached_property
    def offsets(self) -> np.ndarray:
        """(N, 3) rad/s of ``FusedUnit.offset``."""
        return np.stack([unit.offset for unit in self.units])


def white_covariance(units: tuple[FusedUnit, ...], correlation: np.ndarray | None = None) -> np.ndarray:
    """(3 N, 3 N) (rad/s)^2/Hz of the units' white noise in the array's frame; correlation (3 N, 3 N) between units, None for none."""
    whole = blocks(np.stack([unit.in_array(unit.noise_density) for unit in units]))
    if correlation is None:
        return whole
    sigma = np.sqrt(np.diag(whole))
    return correlation * np.outer(sigma, sigma)


def instability_covariance(units: tuple[FusedUnit, ...]) -> np.ndarray | None:
    """(3 N, 3 N) (rad/s)^2 of the units' bias instability in the array's frame; None where a unit's is not known."""
    known = [unit.in_array(unit.bias_instability) for unit in units if unit.bias_instability is not None]
    return blocks(np.stack(known)) if len(known) == len(units) else None
