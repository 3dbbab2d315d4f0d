"""What is found beside a truth file: claims, and the explanation that holds them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from session.checks.findings import Finding
from session.log.truth_reading import TruthAlignment
from tinygc.effects import Effect
from tinygc.explanation.naming.selection import FAMILY_WISE
from tinygc.explanation.noise.session_noise import SessionNoise
from tinygc.explanation.truth.evidence import Force, Rests
from tinygc.models.linear import LinearModel
from tinygc.problem.problem import Problem

IMPLAUSIBLE = 2.0  #: times ``Parameter.plausible``, no gyroscope has that (benchmarks/thresholds.py: double lets false names in)
SLOW = 0.3  #: correlation of neighbours' errors: three sigmas of 30 segments' three angles, whose own is not above 0

LEFT_EXCESS = 1.5  #: chi-square per freedom: three sigmas of the same 90 angles


@dataclass(frozen=True, eq=False)
class TruthClaim:
    """An effect with its parameters theta (P,) SI, their sigma (None of moments, which are stamps), a p-value, and the share of chi-square
    it takes up (None of what was found beside the naming); probability of the name after all that was weighed, rivals: of what was
    weighed in its place, by id; equivalent: ids that could stand in for it."""

    effect: Effect
    theta: np.ndarray
    sigma: np.ndarray | None
    p_value: float
    share: float | None
    probability: float = 1.0
    rivals: dict[str, float] = field(default_factory=dict)
    equivalent: tuple[str, ...] = ()

    @property
    def says(self) -> str:
        """In a sentence."""
        return self.effect.says(self.theta)

    @property
    def implausible(self) -> bool:
        """Whether no gyroscope has so much of it."""
        return bool(np.abs(self.theta).max() > IMPLAUSIBLE * self.effect.parameter.plausible)


@dataclass(frozen=True, eq=False)
class TruthExplanation:
    """What was found; angles in rad.

    problem and model: linear, without the suspect moments; jumps: log and s of wrong moments; claims, strongest first; refused: what
    would fit, but at a size that no gyroscope has; p_value of the first look; before and after: angles (S, 3), each used segment's
    closure about the truth's axes, held_out: the same by fits that did not see it, and excess, chi-square over what is stated; noise: its
    components as they are; considered: names that are not borne out, with their probability; lengths_s (L,), closure_rad (L, 3): growth;
    truth_rad a moment and walk_rad per root second, from it; gyro_rad per root second, the gyro's own walk at its quietest;
    neighbours: correlation of neighbouring segments' errors, before and after; alignment: clock and frame of the truth
    against the gyro; rests; force; warnings of the first look.
    """

    problem: Problem
    model: LinearModel
    jumps: list[tuple[int, float]]
    claims: list[TruthClaim]
    refused: list[TruthClaim]
    p_value: float
    angles: tuple[np.ndarray, np.ndarray]
    held_out: tuple[np.ndarray, np.ndarray]
    excess: tuple[float, float]
    noise: SessionNoise
    considered: dict[str, float]
    lengths_s: np.ndarray
    closure_rad: np.ndarray
    truth_rad: float
    walk_rad: float
    gyro_rad: float
    neighbours: tuple[float, float]
    alignment: TruthAlignment | None
    rests: Rests | None
    force: Force | None
    warnings: list[Finding]

    @property
    def offset(self) -> tuple[float, float]:
        """s of the truth's clock as it was recorded, and its sigma; nan where they are not known."""
        return (float("nan"), float("nan")) if self.alignment is None else (self.alignment.offset_s, self.alignment.offset_sigma_s)

    @property
    def turned(self) -> np.ndarray:
        """(3,) rad from the gyro's axes to the truth's body as it was recorded; nan where that is not known."""
        return np.full(3, np.nan) if self.alignment is None else self.alignment.turned

    @property
    def turned_sigma(self) -> np.ndarray:
        """(3,) rad, of the same."""
        return np.full(3, np.nan) if self.alignment is None else self.alignment.turned_sigma

    @property
    def closure_rms(self) -> tuple[float, float]:
        """rad, of all three angles together, before and after."""
        return rms(self.angles[0]), rms(self.angles[1])

    @property
    def held_out_rms(self) -> tuple[float, float]:
        """The same of segments that the fit did not see."""
        return rms(self.held_out[0]), rms(self.held_out[1])

    @property
    def verdict(self) -> str:
        """As docs/explain.md names them."""
        if not self.claims:
            return "unexplained" if self.p_value <= FAMILY_WISE else "no_mismatch"
        slow = self.neighbours[1] > SLOW or any(claim.effect.id.startswith("unknown") for claim in self.claims)
        return "partly_explained" if self.excess[1] > LEFT_EXCESS or slow else "explained"


def rms(angles: np.ndarray) -> float:
    """rad, of all three of the angles (S, 3) together."""
    return float(np.sqrt(np.mean(np.sum(angles**2, axis=1))))
