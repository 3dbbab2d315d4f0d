"""TinyGC-Net's calibration subnet (Cui et al. 2024), and models that are arrays of weights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from session.base.results import Array, Keys, require
from tinygc.models.linear import PRIOR_SIGMA, LinearModel, mapped
from tinygc.models.model import FACTOR, MATRIX, RATE, Model

# TinyGC-Net's calibration subnet (Cui et al. 2024): two linear basic networks joined by a PReLU, with an identity path.
#
#     h = W1 m + b1,   omega = m + W2 PReLU(h) + b2,   PReLU(h) = h for h >= 0, a h below, one slope a per axis
#
# 12 + 3 + 12 = 27 parameters, as in the paper's table.  It starts at the exact identity: W1 = I, b1 = 0, a = 1, W2 = 0, b2 = 0.  With
# a = 1 it is the linear model; other slopes make it nonlinear.

PARAMETERS = 27
#: prior sigma of the slopes about 1, where the net is linear: from fixed to free
TIES = (0.0, 0.1, 0.3, 1.0, 3.0)
#: the prior of the inner weights is ten times tighter: they move the kinks away from zero rate, which has no physical reason
INNER_TIE = 0.1


@dataclass(frozen=True, eq=False)
class CalibrationNet(Model):
    """The subnet's weights: W1 (3, 3), b1 (3,) rad/s, slope (3,), W2 (3, 3), b2 (3,) rad/s."""

    kind: ClassVar[str] = "tinygc"
    SHAPES: ClassVar[dict[str, tuple[int, ...]]] = {"W1": (3, 3), "b1": (3,), "slope": (3,), "W2": (3, 3), "b2": (3,)}

    W1: np.ndarray
    b1: np.ndarray
    slope: np.ndarray
    W2: np.ndarray
    b2: np.ndarray

    @classmethod
    def identity(cls) -> CalibrationNet:
        """No correction, exactly."""
        return cls(np.eye(3), np.zeros(3), np.ones(3), np.zeros((3, 3)), np.zeros(3))

    @classmethod
    def from_linear(cls, model: LinearModel) -> CalibrationNet:
        """The net equivalent to a linear model."""
        return cls(np.eye(3), np.zeros(3), np.ones(3), model.E - np.eye(3), model.B)

    @classmethod
    def from_vector(cls, vector: np.ndarray) -> CalibrationNet:
        """Build from 27 weights in the order of the fields, matrices row by row."""
        parts, at = [], 0
        for shape in cls.SHAPES.values():
            size = int(np.prod(shape))
            parts.append(vector[at : at + size].reshape(shape))
            at += size
        return cls(*parts)

    def rungs(self, typical_rps: float, ties: tuple[float, ...] = TIES) -> list[tuple[float, np.ndarray]]:
        """(tie, prior sigma (27,) of the weights around the identity), from the linear model to a free one.

        The nonlinear part is tied to W1 = I, b1 = 0, slope = 1; the linear part, W2 and b2, only weakly.
        """
        inner = np.array([1.0] * 9 + [typical_rps] * 3) * INNER_TIE
        bent = np.concatenate([inner, np.ones(3)])
        return [(tie, np.concatenate([bent * max(tie, 1e-9), PRIOR_SIGMA])) for tie in ties]

    @property
    def parameters(self) -> int:
        """Number of parameters: 27."""
        return PARAMETERS

    def with_bias_moved(self, change: np.ndarray) -> CalibrationNet:
        """Increase b2 by ``change`` (3,) rad/s."""
        return replace(self, b2=self.b2 + change)

    @property
    def vector(self) -> np.ndarray:
        """(27,) all weights."""
        return np.concatenate([getattr(self, field.name).ravel() for field in fields(self)])

    def __call__(self, rate: np.ndarray) -> np.ndarray:
        """Calibrated rate (..., 3) rad/s from the measured one."""
        h = mapped(self.W1, rate) + self.b1
        return rate + mapped(self.W2, np.where(h >= 0, h, self.slope * h)) + self.b2

    def columns(self, sensitivity: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """(S, d, 27): rotation of the end attitude per weight, from sensitivity (S, T, d, 3) and measured rates (S, T, 3).

        This is the chain rule written out, with the sums over the samples taken first.
        """
        segments, samples, d = sensitivity.shape[:3]
        by_time, m = sensitivity.transpose(0, 2, 3, 1), rate.transpose(0, 2, 1)  # the samples last: sums run along memory
        h = self.W1 @ m + self.b1[:, None]
        active = np.where(h >= 0, 1.0, self.slope[:, None])
        one, rows = np.ones((segments, 1, samples)), (segments, d * 3, samples)
        outer = by_time.reshape(rows) @ np.concatenate([h * active, one], axis=1).swapaxes(1, 2)
        hidden = self.W2.T @ by_time
        inner = (hidden * active[:, None]).reshape(rows) @ np.concatenate([m, one], axis=1).swapaxes(1, 2)
        outer, inner = (sums.reshape(segments, d, 3, 4) for sums in (outer, inner))
        slope = np.einsum("sdjt,sjt->sdj", hidden, np.minimum(h, 0))
        parts = [inner[..., :3], inner[..., 3], slope, outer[..., :3], outer[..., 3]]
        return np.concatenate([part.reshape(segments, d, -1) for part in parts], axis=-1)


# Kinds that consist of arrays of weights: the linear model, and TinyGC-Net.

CLASSES: dict[str, Any] = {each.kind: each for each in (LinearModel, CalibrationNet)}
EQUATIONS = {
    "linear": "omega = E @ m + B, m the measured rate in rad/s",
    "tinygc": "h = W1 @ m + b1; omega = m + W2 @ (h if h >= 0 else slope * h) + b2, m the measured rate in rad/s",
}


def to_table(model: Any, write: Callable[..., dict]) -> dict:
    """Table with the equation and the weights by name."""
    return {"equation": EQUATIONS[model.kind], "weights": {name: getattr(model, name) for name in model.SHAPES}}


def from_table(table: dict, where: str, read: Callable[..., Any]) -> LinearModel | CalibrationNet:
    """Read the model from its table.  Raises FormatError for an invalid table."""
    cls = CLASSES[table["kind"]]
    shape = Keys({"weights": Keys({name: weight(name, shape) for name, shape in cls.SHAPES.items()})})
    require(table, shape, where)
    return cls(**shape.made(table)["weights"])


def weight(name: str, shape: tuple[int, ...]) -> Array:
    """Schema of an array of weights: E is invertible, offsets (B, b1, b2) are rates, all others are factors."""
    return MATRIX if name == "E" else Array(shape, RATE if name.lower().startswith("b") else FACTOR)
