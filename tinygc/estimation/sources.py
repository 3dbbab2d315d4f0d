"""Where an uncertainty comes from: sources of variance with their degrees of freedom, and the coverage factor of their sum.

    u^2 = sum u_i^2          nu_eff = u^4 / sum (u_i^4 / nu_i)          U = k u,  k = t_p(nu_eff)

(GUM, JCGM 100:2008, 5.1.2 and annex G.4, Welch–Satterthwaite).  The sources' errors are independent of each other.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Annotated, Literal

import numpy as np

from session.base.records import Key
from session.base.results import Array, Maybe, Number

#: probability that an expanded uncertainty covers
COVERAGE = 0.95
#: evaluated from the scatter of this recording's data, or from anything else (GUM 2.3.2, 2.3.3)
Kind = Literal["A", "B"]


@dataclass(frozen=True, eq=False)
class Source:
    """One source of variance of P parameters.

    name: what it is, in words; kind; freedom: degrees of freedom of its size, infinite where that is taken as known; covariance (P, P), in
    the parameters' units.
    """

    written = ("name", "kind", "freedom", "variances")
    name: Annotated[str, Key("source")]
    kind: Annotated[Kind, Key("type")]
    freedom: Annotated[float, Maybe(Number(0)), Key("degrees_of_freedom")]
    covariance: np.ndarray

    def variance(self, slope: np.ndarray) -> np.ndarray:
        """(Q,) of quantities with this derivative (Q, P) by the parameters."""
        return np.einsum("qi,ij,qj->q", slope, self.covariance, slope)

    @property
    def variances(self) -> Annotated[np.ndarray, Array((None,)), Key("variance")]:
        """(P,)."""
        return np.diag(self.covariance)

    def through(self, response: np.ndarray) -> Source:
        """The source of what responds (Q, P) to its errors."""
        return replace(self, covariance=response @ self.covariance @ response.T)

    def of(self, part: slice) -> Source:
        """The source of some of the parameters."""
        return replace(self, covariance=self.covariance[part, part])


def freedom_of(size: float, sigma: float) -> float:
    """Degrees of freedom, 1 or more, of a variance whose root is known as ``size`` with a sigma: (size / sigma)^2 / 2 (GUM G.4.2)."""
    return float("inf") if sigma == 0 else max(1.0, float(size / sigma) ** 2 / 2)


def total(sources: Iterable[Source]) -> np.ndarray:
    """(P, P): sum of their covariances, in their order."""
    first, *others = (source.covariance for source in sources)
    found = np.array(first, dtype=float)
    for each in others:
        found = found + each
    return found


def effective_freedom(variances: Sequence[float], freedoms: Sequence[float]) -> float:
    """Degrees of freedom of a sum of independent variances (Welch–Satterthwaite, GUM G.2b); infinite where all of them are known."""
    v, nu = np.asarray(variances, dtype=float), np.asarray(freedoms, dtype=float)
    spread = float(np.sum(np.where(np.isfinite(nu), v**2 / np.where(np.isfinite(nu), nu, 1.0), 0.0)))
    return float(np.sum(v)) ** 2 / spread if spread > 0 else float("inf")


def coverage_factor(freedom: float, probability: float = COVERAGE) -> float:
    """k of an expanded uncertainty with this probability, two-sided; the effective degrees of freedom are cut to a whole number (GUM
    G.4.1)."""
    upper = (1 + probability) / 2
    if not np.isfinite(freedom):
        return NormalDist().inv_cdf(upper)
    from scipy.special import stdtrit  # late: only a certificate and a budget ask for it

    return float(stdtrit(max(1.0, np.floor(freedom)), upper))
