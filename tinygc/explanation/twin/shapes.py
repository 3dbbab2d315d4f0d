"""Scanned shapes that may be fitted, since what the effect adds changes smoothly with them: a time constant, a period, a dead zone's width.

A scan puts them near their best by linear columns, in rates that the effect still disturbs.  Here they are fitted with all else, a
Gauss-Newton step at a time, and their own uncertainty widens that of the parameters: a time constant that is a little longer asks for
other coefficients.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.effects import AppliedEffect, Effect
from tinygc.explanation.twin.state import State
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener

#: of the value: a central difference is then off by a ten-thousandth of what it shows
STEP = 0.01
#: of the value: a prior's sigma, as wide as any grid; and the farthest that one step goes
LOOSE, FARTHEST = 1.0, 0.3


@dataclass(frozen=True, eq=False)
class Shapes:
    """Of a fit with whitened residuals r (n,), columns J (n, p) and covariance (p, p) that held its shapes: numbers of the claims whose
    shape may be fitted; moves (n, m), whitened, how the residuals change with these values, each as a share of itself."""

    claims: tuple[AppliedEffect, ...]
    numbers: tuple[int, ...]
    moves: np.ndarray

    @classmethod
    def of(cls, twin: Twin, whiten: Whitener, state: State, rates: list[np.ndarray], sensitivity: np.ndarray) -> Shapes:
        """Of a state, with its rates and sensitivity."""
        numbers = tuple(number for number, claim in enumerate(state.claims) if is_fitted(claim.effect))
        moves = [_moves(twin, state.claims[number], state, rates, sensitivity) for number in numbers]
        return cls(state.claims, numbers, whiten(np.stack(moves, axis=1)) if moves else np.zeros((0, 0)))

    def widened(self, J: np.ndarray, covariance: np.ndarray) -> np.ndarray:
        """The covariance of the parameters where these shapes are fitted, too."""
        if not self.numbers:
            return covariance
        along = covariance @ (J.T @ self.moves)
        return covariance + along @ np.linalg.solve(self._information(J, along), along.T)

    def stepped(self, r: np.ndarray, J: np.ndarray, held: np.ndarray) -> list[Effect]:
        """All effects, with these shapes where their linear columns are best; held: the covariance that ``widened`` was given."""
        along = held @ (J.T @ self.moves)
        left = r - J @ (held @ (J.T @ r))
        step = np.clip(-np.linalg.solve(self._information(J, along), self.moves.T @ left), -FARTHEST, FARTHEST)
        effects = [claim.effect for claim in self.claims]
        for number, share in zip(self.numbers, step, strict=True):
            effects[number] = effects[number].at(value_of(effects[number]) * (1 + float(share)))
        return effects

    def _information(self, J: np.ndarray, along: np.ndarray) -> np.ndarray:
        """(m, m) of the values, whatever the parameters are."""
        return self.moves.T @ self.moves - (self.moves.T @ J) @ along + np.eye(len(self.numbers)) / LOOSE**2


def is_fitted(effect: Effect) -> bool:
    """Whether it has a shape, at a value, that may be fitted."""
    return effect.scan is not None and effect.scan.smooth and effect.shape.get(effect.scan.name, 0.0) != 0


def value_of(effect: Effect) -> float:
    """Of its scanned shape, SI."""
    assert effect.scan is not None  # who asks has seen it
    return float(effect.shape[effect.scan.name] * effect.scan.si)


def _moves(twin: Twin, claim: AppliedEffect, state: State, rates: list[np.ndarray], sensitivity: np.ndarray) -> np.ndarray:
    """(n,) how the residuals change with the value of a claim's shape, as a share of itself."""
    value = value_of(claim.effect)
    low, high = (
        twin.effect_columns(claim.effect.at(value * (1 + side * STEP)), state, sensitivity, rates).stacked() @ claim.theta
        for side in (-1, 1)
    )
    return (high - low) / (2 * STEP)
