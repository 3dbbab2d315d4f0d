"""What is found beside a truth file: claims, and the explanation that holds them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.checks.findings import Finding
from tinygc.effects import Effect
from tinygc.explanation.naming.selection import FAMILY_WISE
from tinygc.explanation.truth.evidence import (
    Force,
    Rests,
)
from tinygc.models.linear import LinearModel
from tinygc.problem.problem import Problem

KEPT_SIGMAS = 4.0  #: of a claim's greatest parameter, all fitted together: 5 % over some 300 directions is 3.8 (Bonferroni)
IMPLAUSIBLE = 2.0  #: times ``Parameter.plausible``, no gyroscope has that (benchmarks/thresholds.py: double lets false names in)
SLOW = 0.3  #: correlation of neighbours' errors: three sigmas of 30 segments' three angles, whose own is not above 0

LEFT_EXCESS = 1.5  #: chi-square per freedom: three sigmas of the same 90 angles


@dataclass(frozen=True, eq=False)
class TruthClaim:
    """An effect with its parameters theta (P,) SI, their sigma (None of moments, which are stamps), a p-value, and the share of chi-square
    it takes up (None of what was found beside the selection)."""

    effect: Effect
    theta: np.ndarray
    sigma: np.ndarray | None
    p_value: float
    share: float | None

    @property
    def says(self) -> str:
        """In a sentence."""
        return self.effect.says(self.theta)

    @property
    def idle(self) -> bool:
        """Whether beside the others it is no larger than its sigma lets it be by chance."""
        return self.sigma is not None and bool(np.abs(self.theta / self.sigma).max() < KEPT_SIGMAS)

    @property
    def implausible(self) -> bool:
        """Whether no gyroscope has so much of it."""
        return bool(np.abs(self.theta).max() > IMPLAUSIBLE * self.effect.parameter.plausible)


@dataclass(frozen=True, eq=False)
class TruthExplanation:
    """What was found; angles in rad.

    problem and model: linear, without the suspect moments; jumps: log and s of wrong moments; claims, strongest first; refused: what
    would fit, but at a size that no gyroscope has; p_value of the first look; before and after: angles (S, 3), each used segment's
    closure about the truth's axes, excess, chi-square over what is stated, and closure_rms; lengths_s (L,), closure_rad (L, 3): growth;
    truth_rad a moment and walk_rad per root second, from it; gyro_rad per root second, the gyro's own walk at its quietest;
    neighbours: correlation of neighbouring segments' errors, before and after; offset: s of the truth's clock and its sigma; turned (3,),
    turned_sigma (3,): the gyro against the truth; rests; force; warnings of the first look.
    """

    problem: Problem
    model: LinearModel
    jumps: list[tuple[int, float]]
    claims: list[TruthClaim]
    refused: list[TruthClaim]
    p_value: float
    angles: tuple[np.ndarray, np.ndarray]
    excess: tuple[float, float]
    closure_rms: tuple[float, float]
    lengths_s: np.ndarray
    closure_rad: np.ndarray
    truth_rad: float
    walk_rad: float
    gyro_rad: float
    neighbours: tuple[float, float]
    offset: tuple[float, float]
    turned: np.ndarray
    turned_sigma: np.ndarray
    rests: Rests | None
    force: Force | None
    warnings: list[Finding]

    @property
    def verdict(self) -> str:
        """As docs/explain.md names them."""
        if not self.claims:
            return "unexplained" if self.p_value <= FAMILY_WISE else "no_mismatch"
        slow = self.neighbours[1] > SLOW or any(claim.effect.id.startswith("unknown") for claim in self.claims)
        return "partly_explained" if self.excess[1] > LEFT_EXCESS or slow else "explained"
