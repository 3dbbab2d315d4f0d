"""The linear model every calibration begins with: omega = E m + B, 12 parameters (docs/model.md)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from session.common.units import DEG
from tinygc.attitude import rotation
from tinygc.models.model import BaseModel

#: where E, row by row, and B stand in ``LinearModel.vector``, and in whatever is in its order
MATRIX, BIAS = slice(0, 9), slice(9, 12)
PARAMETERS = BIAS.stop
#: sigma of the prior around "no correction": 20 % for each element of E, 20 dps for the bias
PRIOR_SIGMA = np.array([0.2] * 9 + [20 * DEG] * 3)
NAMES = (*(f"E_{i}{j}" for i in "xyz" for j in "xyz"), "B_x", "B_y", "B_z")


@dataclass(frozen=True, eq=False)
class LinearModel(BaseModel):
    """omega = E m + B with m the measured rate (register x sensitivity): E (3, 3), B (3,) rad/s."""

    kind: ClassVar[str] = "linear"
    SHAPES: ClassVar[dict[str, tuple[int, ...]]] = {"E": (3, 3), "B": (3,)}

    E: np.ndarray
    B: np.ndarray

    @classmethod
    def from_vector(cls, vector: np.ndarray) -> LinearModel:
        """From 12 numbers: E row by row, then B."""
        return cls(np.asarray(vector[MATRIX], dtype=float).reshape(3, 3), np.asarray(vector[BIAS], dtype=float))

    @property
    def parameters(self) -> int:
        """12."""
        return PARAMETERS

    @property
    def vector(self) -> np.ndarray:
        """(12,): E row by row, then B."""
        return np.concatenate([self.E.ravel(), self.B])

    def __call__(self, rate: np.ndarray) -> np.ndarray:
        """Calibrated rate (..., 3) rad/s from the measured one."""
        found = rotation.mapped(self.E, rate)
        found += self.B
        return found

    def with_bias_moved(self, change: np.ndarray) -> LinearModel:
        """B greater by ``change`` (3,) rad/s."""
        return replace(self, B=self.B + change)


def bias_only(still_rate: np.ndarray | None = None) -> LinearModel:
    """No correction but the bias that a still's mean rate (3,) shows; none at all without it."""
    return LinearModel(np.eye(3), np.zeros(3) if still_rate is None else -np.asarray(still_rate))


def columns(sensitivity: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """(S, 3, 12) rad per unit: how each parameter turns the end attitude, from sensitivity (S, T, 3, 3) and m (S, T, 3)."""
    segments, samples = rate.shape[:2]
    by_time = sensitivity.transpose(0, 2, 3, 1).reshape(segments, 9, samples)
    matrix = (by_time @ rate).reshape(segments, 3, 9)
    return np.concatenate([matrix, by_time.sum(-1).reshape(segments, 3, 3)], axis=-1)
