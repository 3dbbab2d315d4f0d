"""Where the physics of a twin stands, and the channels in which it is compared with the recording."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.common.units import G
from tinygc.effects import AppliedEffect, Effect
from tinygc.explanation.twin.layout import EARTH, GRAVITY, LINEAR, claim_slice
from tinygc.models.linear import LinearModel


@dataclass(frozen=True, eq=False)
class State:
    """Where the physics stands: the linear model; horizontal (2,) rad/s, a correction of the Earth's horizontal rate along axes (2, 3):
    as the heading's error moves it, and across; gravity_mps2; the claimed effects."""

    model: LinearModel
    horizontal: np.ndarray
    gravity_mps2: float
    axes: np.ndarray
    claims: tuple[AppliedEffect, ...] = ()

    @property
    def earth_t(self) -> np.ndarray:
        """(3,) rad/s beyond the problem's own Earth."""
        return self.horizontal[0] * self.axes[0] + self.horizontal[1] * self.axes[1] + self._claimed("earth")

    def freed(self, force: np.ndarray) -> np.ndarray:
        """Specific force (N, 3) m/s^2 without what the pre-calibration leaves."""
        return sum((-bent_by(claim.effect, force) @ claim.theta for claim in self.claims if claim.effect.kind == "force"), force)

    @property
    def bends(self) -> bool:
        """Whether the pre-calibration leaves anything."""
        return any(claim.theta.any() for claim in self.claims if claim.effect.kind == "force")

    def _claimed(self, kind: str) -> np.ndarray:
        return sum((claim.theta for claim in self.claims if claim.effect.kind == kind), np.zeros(3))

    @property
    def vector(self) -> np.ndarray:
        """All parameters, as ``layout`` has them: 12 linear, 2 of the Earth, gravity, and each claim's, in order."""
        return np.concatenate([self.model.vector, self.horizontal, [self.gravity_mps2], *(claim.theta for claim in self.claims)])

    def with_vector(self, vector: np.ndarray) -> State:
        """The same claims with other parameters."""
        claims = (replace(claim, theta=vector[claim_slice(self.claims, number)]) for number, claim in enumerate(self.claims))
        model = LinearModel.from_vector(vector[LINEAR])
        return State(model, vector[EARTH], float(vector[GRAVITY]), self.axes, tuple(claims))


def bent_by(effect: Effect, force: np.ndarray) -> np.ndarray:
    """(N, 3, P): what each number of an effect of kind "force" adds to specific force (N, 3) m/s^2."""
    assert effect.bends is not None
    return effect.bends(force / G)


@dataclass(frozen=True, eq=False)
class Channels:
    """Stacked residuals or columns: closure (S, d, …) rad, still (Q, 3, …) rad/s, length (Q, …) m/s^2."""

    closure: np.ndarray
    still: np.ndarray
    length: np.ndarray

    def stacked(self) -> np.ndarray:
        """(S d + 3 Q + Q, …)."""
        tail = self.length.shape[1:]
        return np.concatenate([self.closure.reshape(-1, *tail), self.still.reshape(-1, *tail), self.length])
