"""Claims about a recording: an effect with its parameters in display units, and its certainty."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.special import stdtr

from session.base.texts import probability
from session.base.units import DEG
from tinygc.closure.problem import REPORTED_SIGMAS
from tinygc.effects import AppliedEffect, CommonDelay, Convention, Derived, Effect, catalogue
from tinygc.effects.effect import DIFFERENT_P
from tinygc.explanation.search import NamedEffect
from tinygc.inference.choose import chi_square_above, price
from tinygc.noise.refit import Refit
from tinygc.noise.turn_gravity import NUMBERS, TurnGravity

# A p-value that may underflow.

#: smallest p-value written; a double holds hardly less, and a smaller one is marked as an upper bound
SMALLEST_P = 1e-300


def p_entry(name: str, p_value: float, bound: bool = False) -> dict:
    """A p-value for JSON.  ``<name>_is_upper_bound`` is added if it underflows, since readers take logarithms, or if it is the threshold of
    a detector."""
    return {name: max(p_value, SMALLEST_P), **({f"{name}_is_upper_bound": True} if bound or p_value < SMALLEST_P else {})}


# Parameters as docs/formats.md names them, in display units, with their standard deviations.


def readable(claim: AppliedEffect, covariance: np.ndarray) -> tuple[np.ndarray, dict, dict]:
    """theta (P,) SI, its JSON parameters, and their std."""
    theta, effect = claim.theta, claim.effect
    if effect.derived is not None:
        return theta, *effect.derived.values(theta, covariance)
    covariance = _in_convention(effect, theta, covariance)
    parameter = effect.parameter
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0) + (effect.known_to * theta) ** 2)
    values, spread = ((x / parameter.si).reshape(parameter.shape).tolist() for x in (theta, sigma))
    return theta, {parameter.name: values, **effect.shape}, {parameter.name: spread}


def _in_convention(effect: Effect, theta: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Covariance (P, P) of parameters that follow their effect's convention."""
    if not isinstance(effect.gauge_convention, Convention):
        return covariance
    slope = effect.gauge_convention.slope(theta)
    return slope @ covariance @ slope.T


def described(effect: Effect, theta: np.ndarray, covariance: np.ndarray) -> str:
    """Return the effect's sentence about the parameters theta (P,) that its covariance (P, P) leaves significant.

    A sentence names the greatest parameter.  An axis that the recording hardly shows may have the greatest, and mean nothing.
    """
    if isinstance(effect.derived, Derived) or isinstance(effect.gauge_convention, CommonDelay):
        return effect.describe(theta)  # of all parameters in common
    covariance = _in_convention(effect, theta, covariance)
    sigmas = np.abs(theta) / np.maximum(np.sqrt(np.maximum(np.diag(covariance), 0)), 1e-300)
    sure = sigmas > REPORTED_SIGMAS
    sure[np.argmax(sigmas)] = True
    return effect.describe(np.where(sure, theta, 0.0))


# Display names of channels, and verdicts with a word of their own (all others: ``inference.decide.KINDS``).

#: ``unexplained`` where nothing but the scatter of turns and stills contradicts the model
DIFFERS = "turns or stills differ by more than noise"
#: verdicts with a misfit that has no name: probabilities then compare the catalogue's effects with one another, and no other cause
LEFT = ("partly_explained", "unexplained")


CHANNELS = {"closure": "closure of each segment", "still": "mean rate in each still", "length": "length of gravity in each still"}


# Claims: an effect with its parameters in display units, its certainty, and its equivalents.

#: probability of what the registers, or gravity within a still, show by themselves
CERTAIN = 0.999


@dataclass(frozen=True)
class AgainstStated:
    """The numbers fitted here against those that the effect's file states: chi-square of their difference, and its degrees of freedom."""

    chi_square: float
    freedom: int

    @property
    def p_value(self) -> float:
        """Probability of as large a difference of two recordings of one unit and law."""
        return chi_square_above(self.chi_square, self.freedom)

    @property
    def words(self) -> str:
        """Whether they agree, in words."""
        if self.p_value >= DIFFERENT_P:
            return f"the numbers agree with those that its file states ({probability(self.p_value)})"
        return (
            f"the numbers are not those that its file states ({probability(self.p_value)}): the law as stated is contradicted, "
            "unless this is another unit"
        )

    def to_json(self) -> dict:
        """Return ``against_stated`` of an entry of ``effects``."""
        return {"chi_square": self.chi_square, "freedom": self.freedom, **p_entry("p_value", self.p_value)}


def _against_stated(claim: AppliedEffect, covariance: np.ndarray) -> AgainstStated | None:
    """Compare a fitted claim with the numbers of its effect's file, None where it states none; covariance (P, P) of the claim."""
    effect, stated = claim.effect, claim.effect.stated
    if stated is None:
        return None
    covariance = _in_convention(effect, claim.theta, covariance)
    value = None if effect.scan is None else effect.shape.get(effect.scan.name)
    return AgainstStated(*stated.against(claim.theta, covariance, None if value is None else value * effect.scan.si))  # type: ignore[union-attr]


@dataclass(frozen=True, eq=False)
class Claim:
    """One claimed effect: parameters and their std in the units of their JSON names, p-value, and a sentence.

    theta (P,) SI and covariance (P, P), empty where it is moments. equivalent: ids of effects that fit as well. probability of the effect
    over all hypotheses evaluated. rivals: probability of each competing effect, by id. share of the chi-square beyond noise that it
    removes, None for what was found outside the fit. p_is_bound: the p-value is the threshold of a detector, an upper bound.
    against_stated: the numbers against those that the effect's file states.
    """

    effect: Effect
    parameters: dict
    std: dict
    p_value: float
    description: str
    equivalent: tuple[str, ...] = ()
    share: float | None = None
    p_is_bound: bool = False
    probability: float = 1.0
    rivals: dict[str, float] = field(default_factory=dict)
    against_stated: AgainstStated | None = None
    theta: np.ndarray = field(default_factory=lambda: np.zeros(0))
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def lookalikes(self) -> frozenset[str]:
        """Ids that fit as well or nearly."""
        return frozenset(self.equivalent) | self.rivals.keys()

    def to_json(self) -> dict:
        """Return one entry of ``effects`` of ``tinygc-explain/2``."""
        return {
            "id": self.effect.id,
            "equation": self.effect.equation,
            "parameters": self.parameters,
            "std": self.std,
            **p_entry("p_value", self.p_value, self.p_is_bound),
            "probability": self.probability,
            "rivals": self.rivals,
            "equivalent": list(self.equivalent),
            "description": self.description,
            **({} if self.against_stated is None else {"against_stated": self.against_stated.to_json()}),
        }


@dataclass(frozen=True)
class Considered:
    """A rejected candidate: id and probability; the number of moments that a detector proposed and closure rejected, or 0; and the rms tilt
    (rad) of their segments as recorded and with these moments repaired."""

    id: str
    probability: float
    moments: int = 0
    closure_rad: tuple[float, float] | None = None

    def to_json(self) -> dict:
        """Return one entry of ``considered`` of ``tinygc-explain/2``."""
        closure = None if self.closure_rad is None else {"before": self.closure_rad[0] / DEG, "after": self.closure_rad[1] / DEG}
        return {"id": self.id, "probability": self.probability, "moments": self.moments, "closure_rms_deg": closure}


def claim_of(applied: AppliedEffect, covariance: np.ndarray | None, p_value: float, **more: Any) -> Claim:
    """Claim an effect with its parameters and their covariance (P, P), None for moments, which have none; more: fields of the claim."""
    effect, parameter = applied.effect, applied.effect.parameter
    if covariance is None:
        values = (applied.theta / parameter.si).reshape(parameter.shape).tolist()
        return Claim(
            effect, {parameter.name: values, **effect.shape}, {parameter.name: None}, p_value, effect.describe(applied.theta), **more
        )
    theta, parameters, std = readable(applied, covariance)
    words, wide = described(effect, theta, covariance), covariance + np.diag((effect.known_to * theta) ** 2)
    return Claim(effect, parameters, std, p_value, words, theta=theta, covariance=wide, **more)


def common_delays() -> tuple[str, ...]:
    """Ids of effects that can delay all axes alike: the common part cannot be separated from an unknown clock offset."""
    return tuple(name for name, effect in catalogue().items() if effect.gauge_convention is not None and effect.gauge_convention.delays)


def offset_claim(gravity: TurnGravity) -> list[Claim]:
    """Claim the delay between gyro and accelerometer, which closure does not observe; it may as well be the common part of a lag."""
    if not gravity.is_offset:
        return []
    effect = catalogue()["timing.gyro_accel_offset"]
    sigma = gravity.whole_sigma_s
    # The sigma comes from the scatter of these turns, so use Student's t; its likelihood pays the complexity penalty of any effect.
    freedom, t = max(gravity.turns - NUMBERS, 1), gravity.offset_s / gravity.sigma_s
    p_value = float(2 * stdtr(freedom, -abs(t)))
    gain = freedom * np.log1p(t**2 / freedom)
    probability = float(1 / (1 + np.exp(-(gain - price(1, 1)) / 2)))
    applied = AppliedEffect(effect, np.array([gravity.offset_s]))
    return [claim_of(applied, np.array([[sigma**2]]), p_value, equivalent=common_delays(), probability=probability)]


def named_claims(fit: Refit, named: list[NamedEffect], beyond_noise: float) -> list[Claim]:
    """Claims about named and refitted effects, or shapes without a name; beyond_noise: chi-square of the first fit in excess of its degrees
    of freedom."""
    claims = []
    numbers = {claim.effect.id: i for i, claim in enumerate(fit.state.claims)}
    for each in named:
        number = numbers[each.effect.id]
        claim, covariance = fit.state.claims[number], fit.theta_covariance(number)
        share = float(np.clip(each.gain / beyond_noise, 0, 1)) if beyond_noise > 0 else None
        weighed = {"equivalent": each.equivalent, "probability": each.probability, "rivals": each.rivals}
        found = claim_of(claim, covariance, each.p_value, share=share, **weighed)
        if (stated := _against_stated(claim, covariance)) is not None:
            found = replace(found, description=f"{found.description}; {stated.words}", against_stated=stated)
        claims.append(found)
    return claims
