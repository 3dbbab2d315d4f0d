"""What is claimed of a recording: an effect with its parameters in people's units, how sure, and what could stand in for it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy import stats

from tinygc.effects import Effect, catalogue
from tinygc.explanation.mends.mending import FROM_THE_BAR, Mended
from tinygc.explanation.naming.evidence import PRIOR_ODDS, SCALES
from tinygc.explanation.naming.naming import NamedEffect
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.turn_gravity import TurnGravity
from tinygc.explanation.verdict.readable import readable

#: of what the registers or gravity within a still show by themselves
CERTAIN = 0.999
#: lever arm and offset
OF_GRAVITY = 4


@dataclass(frozen=True, eq=False)
class Claim:
    """One effect that is claimed: parameters and their std in people's units, p-value, what could stand in for it.

    probability: of the name, after all that was weighed; rivals: probability of what was weighed in its place, by id;
    gain: chi-square that it took up; share: of what was beyond noise in all channels, None for what was mended before the fit;
    p_is_bound: the p-value is that of a detector's bar, and what was found beyond it is less probable still.
    """

    effect: Effect
    parameters: dict
    std: dict
    p_value: float
    gain: float
    equivalent: tuple[str, ...]
    says: str
    share: float | None = None
    p_is_bound: bool = False
    probability: float = 1.0
    rivals: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Considered:
    """What was weighed and is not borne out: id, its probability; moments that a detector proposed and closure did not bear out, or 0, with
    the rms tilt (rad) of their segments as they are and with these moments mended."""

    id: str
    probability: float
    moments: int = 0
    closure_rad: tuple[float, float] | None = None


def considered_of(mended: Mended, chance: dict[str, float]) -> list[Considered]:
    """The names, and the moments, that were not borne out; likeliest first."""
    found = [Considered(name, p) for name, p in chance.items()]
    for verdict in mended.verdicts:
        left = len(verdict.events) - len(verdict.accepted)
        if left:
            probability = verdict.probability if not verdict.accepted else 0.0
            found.append(Considered(verdict.id, probability, left, (verdict.before_rad, verdict.tried_rad)))
    if mended.clipping is not None and not mended.clipping.borne_out and np.isfinite(mended.clipping.excess):
        found.append(Considered("gyro.saturation", 0.0, len(mended.clipping.numbers)))
    return sorted(found, key=lambda each: -each.probability)


def mended_claims(mended: Mended) -> list[Claim]:
    """What was found in the registers and stills."""
    claims = []
    for name, (parameters, std) in mended.found.items():
        effect = catalogue()[name]
        value = parameters[effect.parameter.name]
        theta = np.array([len(value) if isinstance(value, list) else value * effect.parameter.si], dtype=float)
        probability = next((v.probability for v in mended.verdicts if v.id == name), CERTAIN)
        bound = name in FROM_THE_BAR
        claims.append(
            Claim(effect, parameters, std, mended.p_value[name], np.inf, (), effect.says(theta), p_is_bound=bound, probability=probability)
        )
    return claims


def _delays(effect: Effect) -> bool:
    """Whether to first order it delays each axis: what all axes share of that is a delay of the gyro."""
    return effect.gauge is not None and bool(effect.gauge.delays)


def offset_claim(gravity: TurnGravity, named: list[Claim]) -> list[Claim]:
    """The delay between gyro and accelerometer, which closure does not see.

    Beside a named lag, or what stands in for one, it could as well be that lag's common part.
    """
    if not gravity.is_offset:
        return []
    known = catalogue()
    names = {name for claim in named for name in (claim.effect.id, *claim.equivalent)}
    lags = sorted(name for name in names if name in known and _delays(known[name]))
    effect = known["timing.gyro_accel_offset"]
    sigma = float(np.hypot(gravity.sigma_s, gravity.bar_s / 3))
    # The sigma is from the scatter of so many turns: Student's tail, and its likelihood against the price of any name.
    freedom, t = max(gravity.turns - OF_GRAVITY, 1), gravity.offset_s / gravity.sigma_s
    p_value = float(2 * stats.t.sf(abs(t), freedom))
    gain = freedom * np.log1p(t**2 / freedom)
    probability = float(1 / (1 + np.exp(-(gain - 2 * np.log(SCALES / PRIOR_ODDS) - 1) / 2)))
    parameters, std, says = {"seconds": gravity.offset_s}, {"seconds": sigma}, effect.says(np.array([gravity.offset_s]))
    return [Claim(effect, parameters, std, p_value, 0.0, tuple(lags), says, probability=probability)]


def named_claims(fit: Refit, named: list[NamedEffect], beyond_noise: float) -> list[Claim]:
    """What was named and refitted, or found without a name; beyond_noise: chi-square of the first look beyond its freedom."""
    claims = []
    numbers = {claim.effect.id: i for i, claim in enumerate(fit.state.claims)}
    for each in named:
        number = numbers[each.effect.id]
        claim = fit.state.claims[number]
        theta, parameters, std = readable(claim, fit.theta_covariance(number))
        share = float(np.clip(each.gain / beyond_noise, 0, 1)) if beyond_noise > 0 else None
        claims.append(
            Claim(
                claim.effect,
                parameters,
                std,
                each.p_value,
                each.gain,
                each.equivalent,
                claim.effect.says(theta),
                share,
                probability=each.probability,
                rivals=each.rivals,
            )
        )
    return claims
