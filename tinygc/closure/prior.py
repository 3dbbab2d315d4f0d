"""A Gaussian prior of the gyroscope's linear model, and the use that a fit made of one.

Least squares accepts any such prior; its origin, does not matter here.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from tinygc.models.linear import PARAMETERS, PRIOR_SIGMA


@dataclass(frozen=True, eq=False)
class GaussianPrior:
    """Mean and covariance of the 12 parameters of ``LinearModel.vector`` before the session.

    centre (12,); covariance (12, 12); known (12,) bool: the parameters with prior knowledge; the others have wide sigmas, as without
    a prior.  weight: the ratio of the fit's noise variance to its floor's.  The fit weights its segments by the floor alone and divides
    the prior's covariance by this weight, so that the prior keeps its influence.
    """

    centre: np.ndarray
    covariance: np.ndarray
    known: np.ndarray
    weight: float = 1.0

    @property
    def root(self) -> np.ndarray:
        """(12, 12) lower triangular root of the covariance, as weighted by the fit."""
        return np.linalg.cholesky(self.covariance / self.weight)

    @property
    def information(self) -> np.ndarray:
        """(12, 12) inverse of the covariance, as weighted by the fit."""
        return np.linalg.inv(self.covariance / self.weight)

    def weighed(self, weight: float) -> GaussianPrior:
        """The prior with another weight."""
        return replace(self, weight=weight)

    def scaled(self, factor: float) -> GaussianPrior:
        """The prior with its covariance times a factor."""
        return replace(self, covariance=self.covariance * factor)


#: function from a first model's vector (12,), the centre of the parameters without prior knowledge, to the prior of a unit
PriorOf = Callable[[np.ndarray], GaussianPrior]


def vague(start: np.ndarray) -> GaussianPrior:
    """Prior of an unknown unit: wide sigmas about a start (12,).  A fit to a few turns needs it explicitly."""
    return GaussianPrior(start, np.diag(PRIOR_SIGMA**2), np.zeros(PARAMETERS, dtype=bool))


class PriorUse(Protocol):
    """How a fit used an external prior."""

    @property
    def used(self) -> str:
        """``yes``, ``no``, or ``partly`` if it is undecided whether the prior applies to this unit."""

    @property
    def source(self) -> str:
        """What the addition to the covariance is called."""

    @property
    def more(self) -> np.ndarray:
        """(12, 12) addition to the covariance of the fit, due to the prior or to doubt about it."""

    @property
    def words(self) -> str:
        """One line for the report."""

    def to_json(self) -> dict:
        """Keys of ``tinygc-fit/2`` that say it."""

    def of_model(self) -> dict:
        """Keys of the file of the least-squares model that say it."""
