"""An effect with its parameters, as a model undoes it and a state of the physics holds it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.effects.effect import Effect


@dataclass(frozen=True, eq=False)
class AppliedEffect:
    """An effect with its parameters theta (P,), SI."""

    effect: Effect
    theta: np.ndarray

    def __post_init__(self) -> None:
        if self.theta.shape != (self.effect.parameter.size,):
            raise ValueError(f"{self.effect.id}: theta has shape {self.theta.shape}, expected ({self.effect.parameter.size},)")
