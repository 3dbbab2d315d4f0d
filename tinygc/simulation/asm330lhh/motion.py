"""What the sensor feels, as a function of true time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: t_s (N,) s -> rate (N, 3) rad/s, specific force (N, 3) m/s^2, temperature (N,) degC, all of the sensor and with its errors
Motion = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray, np.ndarray]]

STANDARD_GRAVITY = 9.80665


@dataclass(frozen=True)
class Still:
    """The same for ever: level, unless told otherwise."""

    rate: tuple[float, float, float] = (0.0, 0.0, 0.0)
    force: tuple[float, float, float] = (0.0, 0.0, STANDARD_GRAVITY)
    temp_c: float = 25.0

    def __call__(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """At these times."""
        n = len(t_s)
        return np.tile(self.rate, (n, 1)), np.tile(self.force, (n, 1)), np.full(n, self.temp_c)


@dataclass(frozen=True, eq=False)
class Sampled:
    """Values at increasing times, linear between them and constant before and behind.

    t_s (N,) s, rate (N, 3) rad/s, force (N, 3) m/s^2, temp_c (N,) degC.
    """

    t_s: np.ndarray
    rate: np.ndarray
    force: np.ndarray
    temp_c: np.ndarray

    def __call__(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """At these times."""
        rate, force = (
            np.column_stack([np.interp(t_s, self.t_s, table[:, axis]) for axis in range(3)]) for table in (self.rate, self.force)
        )
        return rate, force, np.interp(t_s, self.t_s, self.temp_c)
