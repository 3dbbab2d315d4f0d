"""A Gaussian prior of the gyroscope's linear model, and the use that a fit made of one.

Least squares takes any such prior.  Where it comes from, a production lot for one, is no matter of the core.
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

    centre (12,); covariance (12, 12); known (12,) bool: the parameters of which something is known, the others have the generous sigmas of
    a fit without a prior.  weight: the ratio of the fit's noise variance to its floor's.  The fit weighs its segments by the floor alone,
    and divides the prior's covariance by this weight, so that the prior keeps its share.
    """

    centre: np.ndarray
    covariance: np.ndarray
    known: np.ndarray
    weight: float = 1.0

    @property
    def root(self) -> np.ndarray:
        """(12, 12) lower triangular root of the covariance, as the fit weighs it."""
        return np.linalg.cholesky(self.covariance / self.weight)

    @property
    def information(self) -> np.ndarray:
        """(12, 12) inverse of the covariance, as the fit weighs it."""
        return np.linalg.inv(self.covariance / self.weight)

    def weighed(self, weight: float) -> GaussianPrior:
        """The prior with another weight."""
        return replace(self, weight=weight)

    def scaled(self, factor: float) -> GaussianPrior:
        """The prior with its covariance times a factor."""
        return replace(self, covariance=self.covariance * factor)


#: from a first model's vector (12,), the centre of the parameters of which nothing is known, to the prior of a unit
PriorOf = Callable[[np.ndarray], GaussianPrior]


def vague(start: np.ndarray) -> GaussianPrior:
    """The prior of a unit of which nothing is known: generous about a start (12,).  A fit to a few turns needs it stated."""
    return GaussianPrior(start, np.diag(PRIOR_SIGMA**2), np.zeros(PARAMETERS, dtype=bool))


class PriorUse(Protocol):
    """The use that a fit made of a prior from outside."""

    @property
    def used(self) -> str:
        """``yes``, ``no``, or ``partly`` where it is open whether the prior holds for this unit."""

    @property
    def more(self) -> np.ndarray:
        """(12, 12): what the prior, or not knowing whether it holds, adds to the covariance of the fit."""

    @property
    def words(self) -> str:
        """One line for the report."""

    def to_json(self) -> dict:
        """``lot`` of ``tinygc-fit/1``."""
