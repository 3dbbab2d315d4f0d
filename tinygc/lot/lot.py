"""A lot: what is known of the next unit of a kind before it is turned."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, eq=False)
class PooledEffect:
    """An effect over a lot: share of the units that have it; mean and spread (one sigma between units that have it) of each of its
    parameters, SI, by name; p_value: that no unit has it, of the whole catalogue; units: how many told; equivalent: what could as well be
    the cause."""

    share: float
    mean: Mapping[str, float]
    spread: Mapping[str, float]
    p_value: float
    units: int
    equivalent: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Lot:
    """The numbers of ``tinygc.lot.unit_result.NAMES`` over units of one kind.

    mean (21,) of the next unit, drift included; mean_covariance (21, 21) of that mean; spread (21, 21), the covariance between units,
    measurement noise taken out; tails: degrees of freedom of the units' distribution (Student's t, infinity where it is normal);
    repeatability (21, 21), the covariance of one unit from session to session beyond what a session states; units and sessions: how many
    it was made of; sensor: their model.  Numbers of which no session told are NaN, in rows and columns, too.
    """

    sensor: str
    units: int
    sessions: int
    mean: np.ndarray
    mean_covariance: np.ndarray
    spread: np.ndarray
    tails: float
    repeatability: np.ndarray
    effects: Mapping[str, PooledEffect] = field(default_factory=dict)
