"""The calibration subnet of the authors' published code: a scalar PReLU after each of the two blocks, 12 + 1 + 12 + 1 = 26 parameters.

    h = P1(W1 m + b1),   omega = m + P2(W2 h + b2),   P(x) = x for x >= 0, slope x below, one slope each

The second kink lies where the *correction* changes its sign, which for a gyroscope with a bias is nowhere near zero rate.  Here, too,
it starts at the exact identity (both slopes 1), is tied to the linear model, and bends only where left-out segments ask for it.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np

from session.common.errors import CalibrationError
from tinygc.attitude import rotation
from tinygc.models.calibration_net import INNER_TIE, TIES
from tinygc.models.linear import PRIOR_SIGMA
from tinygc.models.model import BaseModel

PARAMETERS = 26


@dataclass(frozen=True, eq=False)
class PublishedNet(BaseModel):
    """The weights, NumPy or torch: W1 (3, 3), b1 (3,) rad/s, slope1 (1,), W2 (3, 3), b2 (3,) rad/s, slope2 (1,)."""

    kind: ClassVar[str] = "tinygc_published"
    SHAPES: ClassVar[dict[str, tuple[int, ...]]] = {"W1": (3, 3), "b1": (3,), "slope1": (1,), "W2": (3, 3), "b2": (3,), "slope2": (1,)}

    W1: np.ndarray
    b1: np.ndarray
    slope1: np.ndarray
    W2: np.ndarray
    b2: np.ndarray
    slope2: np.ndarray

    @classmethod
    def identity(cls) -> PublishedNet:
        """No correction, exactly."""
        return cls(np.eye(3), np.zeros(3), np.ones(1), np.zeros((3, 3)), np.zeros(3), np.ones(1))

    def with_vector(self, vector: Any) -> PublishedNet:
        """From 26 numbers in the order of the fields, matrices row by row."""
        parts, at = [], 0
        for shape in self.SHAPES.values():
            size = int(np.prod(shape))
            parts.append(vector[at : at + size].reshape(shape))
            at += size
        return type(self)(*parts)

    @property
    def parameters(self) -> int:
        """26."""
        return PARAMETERS

    def with_bias_moved(self, change: np.ndarray) -> PublishedNet:
        """b2 greater by ``change`` (3,) rad/s.  CalibrationError where the net bends behind it."""
        if not np.allclose(self.slope2, 1):
            raise CalibrationError("the stored net bends behind its bias (published variant): its bias cannot be moved; give another model")
        return replace(self, b2=self.b2 + change)

    @property
    def vector(self) -> Any:
        """(26,)."""
        xp = rotation.namespace(self.W1)
        return xp.concatenate([getattr(self, field.name).reshape(-1) for field in fields(self)], 0)

    def rungs(self, typical_rps: float, ties: tuple[float, ...] = TIES) -> list[tuple[float, np.ndarray]]:
        """(tie, prior sigma (26,)), as ``CalibrationNet.rungs``."""
        inner = np.array([1.0] * 9 + [typical_rps] * 3) * INNER_TIE
        bent = np.concatenate([inner, np.ones(1)])
        return [(tie, np.concatenate([bent * max(tie, 1e-9), PRIOR_SIGMA, [max(tie, 1e-9)]])) for tie in ties]

    def __call__(self, rate: Any) -> Any:
        """Calibrated rate (..., 3) rad/s from the measured one."""
        xp = rotation.namespace(rate)
        h = rate @ self.W1.T + self.b1
        u = xp.where(h >= 0, h, self.slope1 * h) @ self.W2.T + self.b2
        return rate + xp.where(u >= 0, u, self.slope2 * u)

    def columns(self, sensitivity: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """(S, d, 26): how each weight turns the end attitude, from sensitivity (S, T, d, 3) and rates (S, T, 3) (NumPy only)."""
        h = rate @ self.W1.T + self.b1
        bent = np.where(h >= 0, h, self.slope1 * h)
        u = bent @ self.W2.T + self.b2
        segments, d = len(rate), sensitivity.shape[2]
        outer = sensitivity * np.where(u >= 0, 1.0, self.slope2)[:, :, None]
        inner = (outer @ self.W2) * np.where(h >= 0, 1.0, self.slope1)[:, :, None]

        def by(turn: np.ndarray, values: np.ndarray) -> np.ndarray:
            return np.einsum("stdi,stj->sdij", turn, values, optimize=True).reshape(segments, d, -1)

        parts = [
            by(inner, rate),
            inner.sum(1),
            np.einsum("stdi,sti->sd", outer @ self.W2, np.minimum(h, 0))[..., None],
            by(outer, bent),
            outer.sum(1),
            np.einsum("stdi,sti->sd", sensitivity, np.minimum(u, 0))[..., None],
        ]
        return np.concatenate(parts, axis=-1)
