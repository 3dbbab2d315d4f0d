"""Where a unit of an array is in time and space: its clock, its mounting, its position, against the array's first unit."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, eq=False)
class UnitClock:
    """``t_array = t_unit + offset_s + rate (t_unit - about_s)``, all in s; sigmas of offset and rate.

    rate is positive where the unit's own clock is slow.  The array's clock is that of its first unit, whose offset and rate are 0.
    """

    offset_s: float = 0.0
    rate: float = 0.0
    about_s: float = 0.0
    offset_sigma_s: float = 0.0
    rate_sigma: float = 0.0

    def array_time(self, t_unit_s: np.ndarray) -> np.ndarray:
        """(N,) s on the array's clock of moments (N,) s on the unit's."""
        return t_unit_s + self.offset_s + self.rate * (t_unit_s - self.about_s)


@dataclass(frozen=True, eq=False)
class UnitPlace:
    """Of one unit: number; clock; mounting (3, 3), the rotation that takes vectors from the unit's body frame (its accelerometer's triad,
    or what session.toml says) to the array's, and its covariance (3, 3) rad^2, of a turn about the array's axes; position (3,) m of its
    accelerometer from the first unit's, in the array's frame, and its covariance (3, 3) m^2, both None where the motion does not tell."""

    number: int
    clock: UnitClock = field(default_factory=UnitClock)
    mounting: np.ndarray = field(default_factory=lambda: np.eye(3))
    mounting_covariance: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))
    position_m: np.ndarray | None = None
    position_covariance: np.ndarray | None = None
