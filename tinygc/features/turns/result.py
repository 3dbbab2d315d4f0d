"""What a fit by known turns has found: scales, asymmetry, bias, and the model of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from session.base.numeric import sigmas_in
from session.log.folder import Session
from tinygc.features.turns.angles import LogOfTurns, RestNoise, TurnAngle
from tinygc.features.turns.estimate import TurnsEstimate
from tinygc.models.linear import MATRIX, NAMES, PRIOR_SIGMA, LinearModel


@dataclass(frozen=True, eq=False)
class RestBias:
    """What the gyroscope reads at rest, each (3,) rad/s: mean over the rests, its sigma, and wander, the scatter from rest to rest.  The
    Earth's rotation, at most 0.0042 dps, is in it."""

    mean: np.ndarray
    sigma: np.ndarray
    wander: np.ndarray
    rests: int


@dataclass(frozen=True, eq=False)
class AxisScale:
    """A scale factor error, measured / true - 1: of one sense (1 or -1), or of both (0), their mean; its sigma; turns that it is from; and
    by how much the scale of the sensor's own axis may differ (1 sigma, ``TurnsResult.axis_bound``)."""

    axis: int
    sense: int
    value: float
    sigma: float
    turns: int
    axis_bound: float


@dataclass(frozen=True, eq=False)
class TurnsResult:
    """All numbers of a fit.

    angles: each stated turn, with what was measured; estimate: scales, play, and which turns are lost; bias; noise of the rests.
    """

    session: Session
    sha256: dict[str, str]
    angles: tuple[TurnAngle, ...]
    logs: tuple[LogOfTurns, ...]
    noise: RestNoise
    estimate: TurnsEstimate
    bias: RestBias

    @cached_property
    def scales(self) -> tuple[AxisScale, ...]:
        """One of each axis and sense that was turned, in the order of axes, + before -."""
        return tuple(
            AxisScale(axis, sense, float(value), float(sigma), turns, self.axis_bound)
            for (axis, sense), value, sigma, turns in zip(
                self.estimate.groups,
                self.estimate.scale,
                sigmas_in(self.covariance),
                self.estimate.turns,
                strict=True,
            )
        )

    @cached_property
    def covariance(self) -> np.ndarray:
        """(G, G) of ``scales``; where samples were counted at a nominal rate, its uncertainty is in all of them."""
        rate = self.session.nominal_rate
        return self.estimate.covariance + (0 if rate is None else rate.covariance(1 + self.estimate.scale))

    @cached_property
    def axis_scales(self) -> tuple[AxisScale, ...]:
        """One of each axis that was turned, of both senses the mean."""
        found = []
        for axis in sorted({axis for axis, _ in self.estimate.groups}):
            mine = [g for g, group in enumerate(self.estimate.groups) if group[0] == axis]
            value, variance = np.mean(self.estimate.scale[mine]), self.covariance[np.ix_(mine, mine)].mean()
            turns, sense = sum(self.estimate.turns[g] for g in mine), self.estimate.groups[mine[0]][1] if len(mine) == 1 else 0
            found.append(AxisScale(axis, sense, float(value), float(np.sqrt(variance)), turns, self.axis_bound))
        return tuple(found)

    @cached_property
    def asymmetry(self) -> dict[int, tuple[float, float]]:
        """Of each axis that was turned both ways: (gain of + less gain of -) / their mean, and its sigma."""
        found = {}
        groups = {group: g for g, group in enumerate(self.estimate.groups)}
        for axis in range(3):
            if (axis, 1) in groups and (axis, -1) in groups:
                gain = np.zeros(len(groups))
                gain[groups[axis, 1]], gain[groups[axis, -1]] = 1, -1
                mean = 1 + float(np.abs(gain) @ self.estimate.scale) / 2
                found[axis] = float(gain @ self.estimate.scale) / mean, float(np.sqrt(gain @ self.covariance @ gain)) / mean
        return found

    @cached_property
    def axis_bound(self) -> float:
        """Of (S_kj + S_jk) u_j, were misalignments and leans as large as the leans that show: sqrt(2) times their mean square, of axes."""
        used = [angle for angle, good in zip(self.angles, self.estimate.used, strict=True) if good]
        leans = [np.mean([angle.lean_rad**2 for angle in used if angle.axis == axis]) for axis in {angle.axis for angle in used}]
        return float(np.sqrt(2) * np.mean(leans))

    @cached_property
    def model(self) -> LinearModel:
        """omega = E m + B: the scale of each axis that was turned, the zero of all; an axis that was not turned has the scale 1."""
        gain = np.ones(3)
        for scale in self.axis_scales:
            gain[scale.axis] += scale.value
        return LinearModel(np.diag(1 / gain), -self.bias.mean / gain)

    @property
    def unobserved(self) -> tuple[str, ...]:
        """Parameters of ``model`` that no turn shows, by their names."""
        shown = {f"E_{'xyz'[scale.axis]}{'xyz'[scale.axis]}" for scale in self.axis_scales}
        return tuple(name for name in NAMES[MATRIX] if name not in shown)

    @cached_property
    def model_covariance(self) -> np.ndarray:
        """(12, 12) of ``model``; what no turn shows has its prior's variance."""
        variance = PRIOR_SIGMA**2
        E = np.diag(self.model.E)
        variance[9:] = (E * self.bias.sigma) ** 2
        for scale in self.axis_scales:
            variance[4 * scale.axis] = (scale.sigma * E[scale.axis] ** 2) ** 2
        return np.diag(variance)
