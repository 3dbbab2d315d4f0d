"""Effects of an array: each estimated in every unit, then tested for equality, pooled, and stated of the units that it differs in.

An effect that one unit's explanation names, and another's does not, need not differ between them.  So it is estimated in all of them, named
or not, each with its covariance.  Only where the chi-square of homogeneity rejects equality do units differ.  What must be common (the
Earth, motion, the table) is one term of all units, pooled in the array's axes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.special import chdtrc

from session.base import rotation
from session.base.numeric import sigmas_in
from session.base.records import table_of
from session.base.texts import measured
from session.base.units import DEG_PER_HOUR, EARTH_RATE_RPS
from tinygc.effects import Effect
from tinygc.explanation.claims import Claim
from tinygc.explanation.engine import Explanation
from tinygc.explanation.evidence import without_claim
from tinygc.features.arrays.fit import ArrayFit
from tinygc.inference.choose import LEVEL, Standing, Statement, agreement, linear_estimate, upper_limit
from tinygc.noise.refit import Replay, candidates, prior_sigmas

#: whose an effect is: common by nature, in all units with equality not rejected, different between units, not told, or in single readings
COMMON, ALIKE, DIFFERS, UNDECIDED, READINGS = "common", "alike", "differs", "undecided", "readings"
#: effects that belong to the body, whichever unit's explanation names them
EARTH, MOTION, NOT_STILL = "earth.rotation", "motion.undersampled", "reference.not_still"
OFFSET = "timing.gyro_accel_offset"
#: sigmas by which a number's prior lets it move the residuals; below it, the prior holds it
HELD = 0.01
HOMOGENEITY, POOLED = "chi-square of homogeneity", "chi-square, pooled over units"

#: an effect in one unit: theta (P,) SI, and its covariance (P, P)
Estimate = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True, eq=False)
class Trait:
    """A named effect and whose it is.

    units: those that name it; says: a description for each of them, in order; apart: units that differ from the others, where these are
    alike; estimates of every unit, by number; instead: effects that the recording does not tell from it.
    """

    id: str
    scope: str
    statement: Statement
    units: tuple[int, ...]
    says: tuple[str, ...] = ()
    apart: tuple[int, ...] = ()
    estimates: Mapping[int, Estimate] = field(default_factory=dict)
    instead: tuple[str, ...] = ()

    def table(self) -> dict:
        """Return one of ``traits`` of the JSON."""
        by_unit = [
            {"number": number, "named": number in self.units, "value": theta, "std": sigmas_in(covariance)}
            for number, (theta, covariance) in self.estimates.items()
        ]
        whose = {"units": self.units, "scope": self.scope, "apart": self.apart, "equivalent": self.instead}
        return {"id": self.id, **whose, **table_of(self.statement), "of_units": self.says, "by_unit": by_unit}


def traits_of(
    explanations: Mapping[int, Explanation], fit: ArrayFit, share: Callable[[Effect], float], unknown: Sequence[int], apart_from: set[str]
) -> tuple[Trait, ...]:
    """State every effect that any unit's explanation names, but for those in ``apart_from``.

    share: of the errors of an effect's estimates that the units have in common, 0 to 1, which more units do not reduce; unknown: units
    without an explanation.
    """
    claims: dict[str, dict[int, Claim]] = {}
    for number, e in explanations.items():
        for claim in e.claimed:
            claims.setdefault(claim.effect.id, {})[number] = claim
    tests = max((len({effect.id for effect in candidates(e.twin)}) for e in explanations.values()), default=1)
    found = []
    for name, by_unit in claims.items():
        if name in apart_from or name == MOTION:
            continue
        effect = max(by_unit.values(), key=lambda claim: claim.probability).effect
        estimates = {}
        if effect.kind not in ("register", "reference", "motion") or name == OFFSET:
            each = {number: estimate_in(e, effect, _instead(by_unit)) for number, e in explanations.items()}
            estimates = {number: estimate for number, estimate in each.items() if estimate is not None}
        if name == EARTH:
            turns = {number: _yaw_to_array(fit, number) for number in estimates}
            estimates = {n: (R @ theta, R @ C @ R.T) for (n, (theta, C)), R in zip(estimates.items(), turns.values(), strict=True)}
        found.append(trait_of(effect, by_unit, estimates, tests, share(effect), unknown))
    return tuple(found)


def _instead(by_unit: Mapping[int, Claim]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(other for claim in by_unit.values() for other in claim.equivalent))


def estimate_in(e: Explanation, effect: Effect, instead: Sequence[str]) -> Estimate | None:
    """Estimate an effect in one unit, beside what its explanation names, without the effects that stand for the same."""
    if effect.id == OFFSET:
        return e.measured.get(OFFSET) if e.gravity is not None and np.isfinite(e.gravity.whole_sigma_s) else None
    fit = e.naming.fit
    claims = [claim.effect for claim in fit.state.claims]
    mine = [k for k, claimed in enumerate(claims) if claimed.id in (effect.id, *instead)]
    if len(mine) == 1 and claims[mine[0]].equation == effect.equation:
        return fit.state.claims[mine[0]].theta, fit.theta_covariance(mine[0])
    replay = Replay(e.twin, fit)
    for number in reversed(mine):  # from the last, so that the columns before it stay where they are
        fit = without_claim(fit, number)
    (columns,) = e.whiten.each([replay.columns(effect).stacked()])
    # A number that its prior holds, such as the Earth's horizontal rate where no latitude is given, takes nothing from the effect.
    prior = prior_sigmas(e.twin, [claimed for k, claimed in enumerate(claims) if k not in mine])
    free = fit.J[:, prior * np.linalg.norm(fit.J, axis=0) > HELD]
    return linear_estimate(fit.r, free, columns, effect.parameter.plausible)


def trait_of(
    effect: Effect, by_unit: Mapping[int, Claim], estimates: Mapping[int, Estimate], tests: int, share: float, unknown: Sequence[int]
) -> Trait:
    """State one effect that these units claim, by the units' estimates; tests: effects among which it was found, by which p-values are
    multiplied."""
    units, instead = tuple(by_unit), _instead(by_unit)
    apart: tuple[int, ...] = ()
    if not estimates:
        scope, statement = _in_readings(effect, by_unit)
        instead = ()
    elif effect.id == EARTH:
        scope, statement = COMMON, _earth(estimates, tests, share)
    else:
        scope, statement, apart = _of_sensors(effect, tuple(n for n in units if n in estimates), estimates, tests, share, unknown)
    more = f"; or {' or '.join(instead)}: not told apart here" if instead else ""
    more += f"; {_of_units(unknown)} could not be explained, and may have it too" if unknown else ""
    says = tuple(claim.says for claim in by_unit.values())
    return Trait(effect.id, scope, replace(statement, more=more), units, says, apart, estimates, instead)


def departing(values: np.ndarray, covariances: np.ndarray) -> list[int]:
    """Indices of the estimates (U, P) that differ from the others: the one whose leaving lowers the chi-square most, until the rest is of
    one value at ``LEVEL``.  All of them where half or more would have to go, or where there are two: then nobody is the odd one."""
    rest = list(range(len(values)))
    while len(rest) > 1 and agreement(values[rest], covariances[rest]).p_value < LEVEL:
        rest = min(([k for k in rest if k != one] for one in rest), key=lambda part: agreement(values[part], covariances[part]).chi_square)
    gone = [k for k in range(len(values)) if k not in rest]
    return gone if len(gone) < len(values) / 2 else list(range(len(values)))


def _pooled(estimates: Sequence[Estimate], share: float) -> tuple[float, np.ndarray, np.ndarray, float]:
    """Return the p-value of one value of all, the value and its covariance, and its p-value of zero.

    The covariance of a mean of U units whose errors have this share in common is (1 + (U - 1) share) times that of independent ones.
    """
    values, covariances = (np.array(each) for each in zip(*estimates, strict=True))
    found = agreement(values, covariances)
    mean, covariance = found.pooled, found.covariance * (1 + (len(values) - 1) * share)
    return found.p_value, mean, covariance, float(chdtrc(len(mean), float(mean @ np.linalg.solve(covariance, mean))))


def _of_sensors(
    effect: Effect, units: tuple[int, ...], estimates: Mapping[int, Estimate], tests: int, share: float, unknown: Sequence[int]
) -> tuple[str, Statement, tuple[int, ...]]:
    """State an effect that units name, each sensor's own or alike in all."""
    numbers, each = list(estimates), list(estimates.values())
    if len(numbers) < 2:
        statement = Statement(f"{effect.id}, in one unit", Standing.UNDECIDED, HOMOGENEITY, 1.0, *_sizes(effect, *each[0]))
        return UNDECIDED, statement, ()
    p_equal, pooled, covariance, p_pooled = _pooled(each, share)
    p_differ = min(1.0, tests * p_equal)  # the factor makes rejection harder; in favour of equality it would say too much
    if p_differ < LEVEL:
        odd = departing(*(np.array(part) for part in zip(*each, strict=True)))
        of_each = ", ".join(f"{_sizes(effect, *each[k])[0]} in unit {numbers[k]}" for k in odd)
        if rest := [each[k] for k in range(len(each)) if k not in odd]:
            of_each += f", {_sizes(effect, *_pooled(rest, share)[1:3])[0]} in the others"
        statement = Statement(f"{effect.id} differs between units", Standing.FOR, HOMOGENEITY, p_differ, of_each, "")
        return DIFFERS, statement, tuple(numbers[k] for k in odd)
    largest = max((float(np.abs(estimates[n][0]).max()) for n in units), default=np.inf)
    named, everywhere = f"named in {_of_units(units)}", "all units" if not unknown else _of_units(numbers)
    equal = f"equal sizes p = {p_equal:.2g}" + f", one of {tests} tests" * (tests > 1)
    figures: dict[str, Any] = {"upper": _upper(pooled, covariance), "matters": largest}
    what = f"{effect.id} in {everywhere}, one size is not rejected ({equal})"
    statement = Statement.of(what, POOLED, min(1.0, tests * p_pooled), *_sizes(effect, pooled, covariance), **figures)
    if statement.standing is not Standing.FOR:
        what, test = f"{effect.id} ({named}), pooled over {len(numbers)} units", f"{POOLED}; {equal}"
        return UNDECIDED, replace(statement, what=what, test=test), ()
    # One exact unit outweighs others that are blind, and equality with them is then never rejected: the others must show it themselves.
    blind = [n for n in numbers if n not in units]
    if blind:
        _, others, spread, p_others = _pooled([estimates[n] for n in blind], share)
        if p_others >= LEVEL:
            what = f"{effect.id}, {named}; {_of_units(blind)} cannot show it ({equal})"
            return UNDECIDED, Statement(what, Standing.UNDECIDED, POOLED, p_others, *_sizes(effect, others, spread)), ()
    return ALIKE, statement, ()


def _of_units(numbers: Sequence[int]) -> str:
    return f"unit{'s' * (len(numbers) != 1)} {', '.join(map(str, numbers))}"


def _upper(theta: np.ndarray, covariance: np.ndarray) -> float:
    """Upper 95 % limit of the component that may be largest."""
    return max(map(upper_limit, theta.tolist(), sigmas_in(covariance).tolist()))


def _sizes(effect: Effect, theta: np.ndarray, covariance: np.ndarray) -> tuple[str, str]:
    """Words of the component with the largest magnitude, and of the upper limit of all, in the effect's unit."""
    si, unit = effect.parameter.si, effect.parameter.unit
    k = int(np.argmax(np.abs(theta)))
    return f"{measured(theta[k] / si, sigmas_in(covariance)[k] / si)} {unit}", f"{_upper(theta, covariance) / si:.2g} {unit}"


def _in_readings(effect: Effect, by_unit: Mapping[int, Claim]) -> tuple[str, Statement]:
    """State what a detector found in the registers or stills of units; it has no size in the others, so nothing is said of them."""
    named, body = _of_units(list(by_unit)), effect.id == NOT_STILL
    what = f"{effect.id}, of the body, seen by {named}" if body else f"{effect.id} in the readings of {named}"
    p_value, first = min(claim.p_value for claim in by_unit.values()), next(iter(by_unit.values())).says
    test = "detector in the stills" if body else "detector in the readings"
    return COMMON if body else READINGS, Statement(what, Standing.FOR, test, p_value, first, "")


def _earth(estimates: Mapping[int, Estimate], tests: int, share: float) -> Statement:
    """State the Earth's rotation as one term of all units, by their estimates in the array's table axes: pooled, and the length tested
    against the Earth's.  Undecided where the units' estimates are not equal: then no pooled sigma holds."""
    p_equal, pooled, covariance, p_zero = _pooled(list(estimates.values()), share)
    length, widest = float(np.linalg.norm(pooled)), float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    sigma = float(np.sqrt(pooled @ covariance @ pooled)) / length if length else widest
    p_zero, p_claimed = min(1.0, tests * p_zero), float(chdtrc(1, ((length - EARTH_RATE_RPS) / sigma) ** 2))
    what, upper = f"{EARTH}, one term of all units", upper_limit(length, widest)
    if p_equal < LEVEL:
        each = [(float(np.linalg.norm(theta)), float(np.sqrt(np.linalg.eigvalsh(C)[-1]))) for theta, C in estimates.values()]
        size = f"{min(each)[0] / DEG_PER_HOUR:.2g} to {max(each)[0] / DEG_PER_HOUR:.2g} °/h in single units"
        limit = f"{max(upper_limit(*one) for one in each) / DEG_PER_HOUR:.2g} °/h"
        test = f"{HOMOGENEITY} in the array's axes"
        return Statement(f"{what}, which disagree", Standing.UNDECIDED, test, p_equal, size, limit)
    size = f"{measured(length / DEG_PER_HOUR, sigma / DEG_PER_HOUR)} °/h"
    how: dict[str, Any] = {
        "claimed": f"the Earth's {EARTH_RATE_RPS / DEG_PER_HOUR:.1f} °/h",
        "p_claimed": p_claimed if p_zero < LEVEL else 1.0,
    }
    test = f"{POOLED} in the array's axes; equal p = {p_equal:.2g}"
    return Statement.of(what, test, p_zero, size, f"{upper / DEG_PER_HOUR:.2g} °/h", upper=upper, matters=EARTH_RATE_RPS, **how)


def _yaw_to_array(fit: ArrayFit, number: int) -> np.ndarray:
    """Rotation (3, 3) from a unit's own table axes to the array's: both are level, so it is a turn about the vertical, to its noise."""
    i = fit.numbers.index(number)
    prepared, joint = fit.prepared[i].problem, fit.joint
    own = {id(still): q for log in prepared.logs for q, still in zip(log.q_tb, log.stills, strict=True)}
    total = np.zeros((3, 3))
    for q, still in enumerate(fit.same.stills[i]):
        if still is not None and fit.same.group[q] == fit.same.group[0]:
            total += rotation.matrix(joint.state.q_tb[q]) @ joint.state.mountings[i] @ rotation.matrix(own[id(still)]).T
    yaw = np.arctan2(total[1, 0] - total[0, 1], total[0, 0] + total[1, 1])
    return np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
