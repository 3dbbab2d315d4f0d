"""The variable along which an effect lives, of each sample, still and segment: one reading for the JSON, the page and the picture.

Gravity along an axis is +1 g where that axis points down: the specific force with its sign reversed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from session.common.units import DEG
from tinygc.effects import Effect, Movement
from tinygc.explanation.twin.twin import Twin

X, Y, Z = range(3)
#: what a movement knows of itself, (N,) or (N, 3) in people's units, and the unit
READ: dict[str, tuple[Callable[[Movement], np.ndarray], str]] = {
    "time": (lambda m: m.t_s, "s"),
    "temperature": (lambda m: m.temp_c, "°C"),
    "vibration": (lambda m: m.vibration_g2, "g²"),
    "rate": (lambda m: np.abs(m.rate) / DEG, "dps"),
    "angular acceleration": (lambda m: np.abs(m.acceleration), "rad/s²"),
    "attitude": (lambda m: -m.force_g, "g"),
}


@dataclass(frozen=True)
class Variable:
    """A variable of ``READ``; axis 0 to 2 where it is one component of a vector, None for a scalar or the greatest component."""

    variable: str
    axis: int | None = None

    @property
    def units(self) -> str:
        """Its unit, in words."""
        return READ[self.variable][1]

    @property
    def words(self) -> str:
        """``gravity along x``, ``temperature``, ``rate about y``."""
        if self.axis is None:
            return self.variable
        return f"gravity along {'xyz'[self.axis]}" if self.variable == "attitude" else f"{self.variable} about {'xyz'[self.axis]}"

    def of_samples(self, movement: Movement) -> np.ndarray:
        """(N,) at each sample of a log."""
        values = READ[self.variable][0](movement)
        if values.ndim == 1:
            return values
        return values.max(axis=1) if self.axis is None else values[:, self.axis]

    def of_stills(self, twin: Twin) -> np.ndarray:
        """(Q,) mean over each still."""
        values = [self.of_samples(movement) for movement in twin.movements]
        return np.array([values[log][still.start : still.stop].mean() for log, still in twin.stills])

    def of_segments(self, twin: Twin) -> np.ndarray:
        """(S,) greatest in each segment."""
        values = [self.of_samples(movement) for movement in twin.movements]
        return np.array([values[segment.log][segment.start : segment.stop].max() for segment in twin.segments])


def variable_of(effect: Effect | None, theta: np.ndarray | None = None) -> Variable:
    """Of an effect with parameters theta (P,): along the axis of the strongest column of a matrix, of the strongest entry of a vector.

    An effect that names a variable that a movement does not hold is drawn over time, and so is no effect.
    """
    variable = effect.regime[0] if effect is not None and effect.regime else "time"
    if variable not in READ:
        return Variable("time")
    if theta is not None and np.size(theta) == 9 and variable in ("attitude", "rate", "angular acceleration"):
        return Variable(variable, int(np.argmax(np.linalg.norm(np.reshape(theta, (3, 3)), axis=0))))
    if variable != "attitude":
        return Variable(variable)
    if effect is None or theta is None or np.size(theta) != 3 or effect.kind == "earth":
        return Variable(variable, Z)
    return Variable(variable, int(np.argmax(np.abs(theta))))
