"""What the closure cannot fix of an effect's parameters, and what fixes it instead: declared here, done where there is a recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Convention:
    """Parameters that differ by what no recording shows; a rule chooses among them.

    settle(theta) -> theta (P,) by the rule; slope(theta) -> (P, P), its derivative there, which the covariance follows;
    delays: entries of theta (for x, y, z) that to first order delay an axis, where there are such.
    """

    settle: Callable[[np.ndarray], np.ndarray]
    slope: Callable[[np.ndarray], np.ndarray]
    delays: tuple[int, ...] = ()


@dataclass(frozen=True)
class CommonDelay:
    """Entries of theta that to first order delay x, y and z: what they share the closure hardly sees; gravity in the turns does.

    late: +1 where a positive entry is late, -1 where it is early; never_negative: of a lag, whose common part the closure sees by its
    square alone: it is moved only where it would be negative or gravity contradicts it, and as far as the closure allows.
    """

    delays: tuple[int, int, int]
    late: float = 1.0
    never_negative: bool = False


Gauge = Convention | CommonDelay
