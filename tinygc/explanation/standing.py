"""The standing of a statement: for, against, bounded or undecided, and the only words that each permits.

A p-value above its level is no evidence of absence.  Absence is stated only as a bound: the upper 95 % limit of the size (two one-sided
tests, Schuirmann 1987).  A difference is stated only by a test of the difference.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

import numpy as np
from scipy.special import chdtrc, ndtri

from session.base.records import Key
from session.base.results import Maybe, Number, Text

#: level of every test of this table, and of the limits: they hold with 95 %
LEVEL = 0.05
#: sigmas of a one-sided limit at that level
ONE_SIDED = float(ndtri(1 - LEVEL))


class Standing(StrEnum):
    """What the evidence says of a statement."""

    FOR = "for"
    AGAINST = "against"
    BOUNDED = "bounded"
    UNDECIDED = "undecided"


def standing_of(p_value: float, *, p_claimed: float = 1.0, upper: float = np.inf, matters: float = 0.0) -> Standing:
    """Return the standing of a size.

    p_value: of the test that the size is zero; p_claimed: of the test that it is the claimed one, 1 if none is claimed; upper: its upper
    95 % limit, and matters: the size from which on it matters, in one unit.  A size that is neither zero nor the claimed one counts against
    the claim.
    """
    if p_claimed < LEVEL:
        return Standing.AGAINST
    if p_value < LEVEL:
        return Standing.FOR
    return Standing.BOUNDED if upper < matters else Standing.UNDECIDED


def upper_limit(value: float, sigma: float) -> float:
    """Upper 95 % limit of the magnitude of a normal estimate: each sign is excluded by a one-sided test."""
    return abs(value) + ONE_SIDED * sigma


def homogeneity_p(values: np.ndarray, covariances: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
    """Test whether independent estimates (U, P) with covariances (U, P, P) are estimates of one value (chi-square of homogeneity, Cochran
    1954).  Return the p-value, the pooled value (P,) and its covariance (P, P)."""
    weights = np.linalg.inv(covariances)
    covariance = np.linalg.inv(weights.sum(axis=0))
    pooled = covariance @ np.einsum("uij,uj->i", weights, values)
    apart = values - pooled
    chi_square = float(np.einsum("ui,uij,uj->", apart, weights, apart))
    freedom = values.size - len(pooled)
    return (float(chdtrc(freedom, chi_square)) if freedom else 1.0), pooled, covariance


@dataclass(frozen=True)
class Statement:
    """A statement with its evidence.  what: its subject; test: the name of the test; size, limit: with units; claimed: the size that was
    claimed, if one was."""

    written = ("standing", "test", "p_value", "words")
    what: str
    standing: Annotated[Standing, Text(tuple(each.value for each in Standing))]
    test: str
    p_value: Annotated[float, Maybe(Number(0, 1))]
    size: str
    limit: str
    claimed: str = ""

    @property
    def words(self) -> Annotated[str, Key("description")]:
        """Return one sentence without its full stop."""
        tested = f"{self.test}, p = {self.p_value:.2g}"
        if self.standing is Standing.FOR:
            return f"{self.what}: {self.size} ({tested})"
        if self.standing is Standing.AGAINST:
            return f"{self.what}: {self.size}, not {self.claimed} ({tested})"
        if self.standing is Standing.BOUNDED:
            return f"{self.what}: below {self.limit} with 95 % ({tested})"
        return f"{self.what}: undecided; {self.size}; more than {self.limit} is excluded with 95 % ({tested})"
