"""Effects of an array: each estimated in every unit, then tested for equality, pooled, and stated of the units that it differs in.

An effect that one unit's explanation names, and another's does not, need not differ between them.  So it is estimated in all of them, named
or not, each with its covariance.  Only where the chi-square of homogeneity rejects equality do units differ.  What must be common (the
Earth, motion, the table) is one term of all units, pooled in the array's axes.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from session.base import rotation
from session.base.numeric import sigmas_in
from session.base.texts import measured
from session.base.units import EARTH_RATE_RPS
from tinygc.effects import Effect
from tinygc.explanation.claims import Claim
from tinygc.explanation.engine import Explanation
from tinygc.explanation.evidence import without_claim
from tinygc.features.arrays.fit import ArrayFit
from tinygc.inference.choose import LEVEL, Standing, Statement, homogeneity_p, linear_estimate, standing_of, upper_limit
from tinygc.noise.refit import Replay, candidates, prior_sigmas

#: whose an effect is: common by nature, in all units with equality not rejected, different between units, not told, or in single readings
COMMON, ALIKE, DIFFERS, UNDECIDED, READINGS = "common", "alike", "differs", "undecided", "readings"
#: effects that belong to the body, whichever unit's explanation names them
EARTH, MOTION, NOT_STILL = "earth.rotation", "motion.undersampled", "reference.not_still"
OFFSET = "timing.gyro_accel_offset"
#: sigmas by which a number's prior lets it move the residuals; below it, the prior holds it
HELD = 0.01
HOMOGENEITY, POOLED = "chi-square of homogeneity", "chi-square, pooled over units"


@dataclass(frozen=True, eq=False)
class Estimate:
    """An effect in one unit: theta (P,) SI, its covariance (P, P), and whether the unit's own explanation names it."""

    theta: np.ndarray
    covariance: np.ndarray
    named: bool

    @property
    def sigma(self) -> np.ndarray:
        """Return (P,) sigmas."""
        return sigmas_in(self.covariance)


@dataclass(frozen=True, eq=False)
class Trait:
    """A named effect and whose it is.

    units: those that name it; says: a description for each of them, in order; apart: units that differ from the others, where these are
    alike; estimates of every unit, by number; unknown: units that could not be explained; instead: effects that the recording does not tell
    from it.
    """

    id: str
    scope: str
    statement: Statement
    units: tuple[int, ...]
    says: tuple[str, ...] = ()
    apart: tuple[int, ...] = ()
    estimates: Mapping[int, Estimate] | None = None
    unknown: tuple[int, ...] = ()
    instead: tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """Return a sentence that states what the test permits."""
        said = self.statement.words
        if self.instead:
            said += f"; or {' or '.join(self.instead)}: not told apart here"
        if self.unknown:
            said += f"; {_of_units(self.unknown)} could not be explained, and may have it too"
        return said


def traits_of(
    explanations: Mapping[int, Explanation], fit: ArrayFit, share: Callable[[Effect], float], unknown: tuple[int, ...], apart_from: set[str]
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
        instead = tuple(dict.fromkeys(other for claim in by_unit.values() for other in claim.equivalent))
        says = tuple(claim.says for claim in by_unit.values())
        units = tuple(by_unit)
        if effect.kind in ("register", "reference", "motion") and name != OFFSET:
            found.append(_in_readings(effect, by_unit, unknown))
            continue
        estimates = {n: x for n, e in explanations.items() if (x := estimate_in(e, effect, instead, n in by_unit)) is not None}
        if name == EARTH:
            found.append(_earth_trait(estimates, fit, units, says, tests, share(effect), unknown))
            continue
        found.append(_trait_of(effect, estimates, says, tests, share(effect), unknown, instead))
    return tuple(found)


def estimate_in(e: Explanation, effect: Effect, instead: Sequence[str], named: bool) -> Estimate | None:
    """Estimate an effect in one unit, beside what its explanation names, without the effects that stand for the same."""
    if effect.id == OFFSET:
        gravity = e.gravity
        if not np.isfinite(gravity.whole_sigma_s):
            return None
        return Estimate(np.array([gravity.offset_s]), np.array([[gravity.whole_sigma_s**2]]), named)
    fit = e.naming.fit
    claims = [claim.effect for claim in fit.state.claims]
    mine = [k for k, claimed in enumerate(claims) if claimed.id in (effect.id, *instead)]
    if len(mine) == 1 and claims[mine[0]].equation == effect.equation:
        return Estimate(fit.state.claims[mine[0]].theta, fit.theta_covariance(mine[0]), named)
    replay = Replay(e.twin, fit)
    for number in reversed(mine):  # from the last, so that the columns before it stay where they are
        fit = without_claim(fit, number)
    (columns,) = e.whiten.each([replay.columns(effect).stacked()])
    # A number that its prior holds, such as the Earth's horizontal rate where no latitude is given, takes nothing from the effect.
    prior = prior_sigmas(e.twin, [claimed for k, claimed in enumerate(claims) if k not in mine])
    free = fit.J[:, prior * np.linalg.norm(fit.J, axis=0) > HELD]
    theta, covariance = linear_estimate(fit.r, free, columns, effect.parameter.plausible)
    return Estimate(theta, covariance, named)


def departing(values: np.ndarray, covariances: np.ndarray) -> list[int]:
    """Indices of the estimates (U, P) that differ from the others: the one whose leaving lowers the chi-square most, until the rest is of
    one value at ``LEVEL``.  All of them where half or more would have to go, or where there are two: then nobody is the odd one."""
    rest = list(range(len(values)))
    gone: list[int] = []
    while len(rest) > 1 and homogeneity_p(values[rest], covariances[rest])[0] < LEVEL:
        without = [[k for k in rest if k != one] for one in rest]
        p = [homogeneity_p(values[part], covariances[part]) for part in without]
        chi = [
            float(sum(d @ np.linalg.solve(C, d) for d, C in zip(values[part] - pooled, covariances[part], strict=True)))
            for part, (_, pooled, _) in zip(without, p, strict=True)
        ]
        gone.append(rest[int(np.argmin(chi))])
        rest = without[int(np.argmin(chi))]
    return sorted(gone) if len(gone) < len(values) / 2 else list(range(len(values)))


def pooled_p(pooled: np.ndarray, covariance: np.ndarray) -> float:
    """p-value of a pooled value (P,) of zero."""
    return float(chdtrc(len(pooled), float(pooled @ np.linalg.solve(covariance, pooled))))


def widened(covariance: np.ndarray, units: int, share: float) -> np.ndarray:
    """Covariance of a mean of units whose errors have this share in common: (1 + (U - 1) share) times that of independent ones."""
    return covariance * (1 + (units - 1) * share)


def _trait_of(
    effect: Effect,
    estimates: Mapping[int, Estimate],
    says: tuple[str, ...],
    tests: int,
    share: float,
    unknown: tuple[int, ...],
    instead: tuple[str, ...],
) -> Trait:
    """State one effect of the units' estimates; tests: effects among which it was found, by which p-values are multiplied."""
    numbers = list(estimates)
    units = tuple(number for number in numbers if estimates[number].named)
    values = np.array([estimates[number].theta for number in numbers])
    covariances = np.array([estimates[number].covariance for number in numbers])

    def trait(scope: str, statement: Statement, apart: tuple[int, ...] = ()) -> Trait:
        return Trait(effect.id, scope, statement, units, says, apart, estimates, unknown, instead)

    if len(numbers) < 2:
        statement = Statement(f"{effect.id}, in one unit", Standing.UNDECIDED, HOMOGENEITY, 1.0, *_sizes(effect, values[0], covariances[0]))
        return trait(UNDECIDED, statement)
    p_equal, pooled, covariance = homogeneity_p(values, covariances)
    p_differ = min(1.0, tests * p_equal)  # the factor makes rejection harder; in favour of equality it would say too much
    if p_differ < LEVEL:
        odd = departing(values, covariances)
        apart = tuple(numbers[k] for k in odd)
        of_each = ", ".join(f"{_sizes(effect, values[k], covariances[k])[0]} in unit {numbers[k]}" for k in odd)
        rest = [k for k in range(len(numbers)) if k not in odd]
        if rest:
            _, usual, spread = homogeneity_p(values[rest], covariances[rest])
            of_each += f", {_sizes(effect, usual, widened(spread, len(rest), share))[0]} in the others"
        statement = Statement(f"{effect.id} differs between units", Standing.FOR, HOMOGENEITY, p_differ, of_each, "")
        return trait(DIFFERS, statement, apart)
    covariance = widened(covariance, len(numbers), share)
    p_value = min(1.0, tests * pooled_p(pooled, covariance))
    size, limit = _sizes(effect, pooled, covariance)
    largest = max((float(np.abs(estimates[n].theta).max()) for n in units), default=np.inf)
    standing = standing_of(p_value, upper=_upper(pooled, covariance), matters=largest)
    named = f"named in {_of_units(units)}"
    equal = f"equal sizes p = {p_equal:.2g}" + f", one of {tests} tests" * (tests > 1)
    if standing is not Standing.FOR:
        what, test = f"{effect.id} ({named}), pooled over {len(numbers)} units", f"{POOLED}; {equal}"
        statement = Statement(what, standing, test, p_value, size, limit)
        return trait(UNDECIDED, statement)
    # One exact unit outweighs others that are blind, and equality with them is then never rejected: the others must show it themselves.
    rest = [k for k in range(len(numbers)) if numbers[k] not in units]
    if rest:
        _, others, spread = homogeneity_p(values[rest], covariances[rest])
        spread = widened(spread, len(rest), share)
        p_others = pooled_p(others, spread)
        if p_others >= LEVEL:
            what = f"{effect.id}, {named}; {_of_units([numbers[k] for k in rest])} cannot show it ({equal})"
            statement = Statement(what, Standing.UNDECIDED, POOLED, p_others, *_sizes(effect, others, spread))
            return trait(UNDECIDED, statement)
    everywhere = "all units" if not unknown else _of_units(numbers)
    what = f"{effect.id} in {everywhere}, one size is not rejected ({equal})"
    return trait(ALIKE, Statement(what, standing, POOLED, p_value, size, limit))


def _of_units(numbers: Sequence[int]) -> str:
    return f"unit{'s' * (len(numbers) != 1)} {', '.join(map(str, numbers))}"


def _upper(theta: np.ndarray, covariance: np.ndarray) -> float:
    """Upper 95 % limit of the component that may be largest."""
    return max(upper_limit(float(x), float(s)) for x, s in zip(theta, sigmas_in(covariance), strict=True))


def _sizes(effect: Effect, theta: np.ndarray, covariance: np.ndarray) -> tuple[str, str]:
    """Words of the component with the largest magnitude, and of the upper limit of all, in the effect's unit."""
    si, unit = effect.parameter.si, effect.parameter.unit
    k = int(np.argmax(np.abs(theta)))
    return f"{measured(theta[k] / si, np.sqrt(covariance[k, k]) / si)} {unit}", f"{_upper(theta, covariance) / si:.2g} {unit}"


def _in_readings(effect: Effect, by_unit: Mapping[int, Claim], unknown: tuple[int, ...]) -> Trait:
    """State what a detector found in the registers or stills of units; it has no size in the others, so nothing is said of them."""
    units = tuple(by_unit)
    named = _of_units(units)
    body = effect.id == NOT_STILL
    what = f"{effect.id}, of the body, seen by {named}" if body else f"{effect.id} in the readings of {named}"
    p_value = min(claim.p_value for claim in by_unit.values())
    first = next(iter(by_unit.values())).says
    test = "detector in the stills" if body else "detector in the readings"
    statement = Statement(what, Standing.FOR, test, p_value, first, "")
    return Trait(effect.id, COMMON if body else READINGS, statement, units, tuple(c.says for c in by_unit.values()), (), None, unknown)


def _earth_trait(
    estimates: Mapping[int, Estimate],
    fit: ArrayFit,
    units: tuple[int, ...],
    says: tuple[str, ...],
    tests: int,
    share: float,
    unknown: tuple[int, ...] = (),
) -> Trait:
    """State the Earth's rotation as one term of all units: their estimates, turned to the array's table axes, are pooled, and the length is
    tested against the Earth's.  Undecided where the units' estimates are not equal: then no pooled sigma holds."""
    turned = {}
    for number, estimate in estimates.items():
        R = _yaw_to_array(fit, number)
        turned[number] = Estimate(R @ estimate.theta, R @ estimate.covariance @ R.T, estimate.named)
    values, covariances = (np.array([getattr(x, what) for x in turned.values()]) for what in ("theta", "covariance"))
    p_equal, pooled, covariance = homogeneity_p(values, covariances)
    covariance = widened(covariance, len(turned), share)
    p_value = min(1.0, tests * pooled_p(pooled, covariance))
    length = float(np.linalg.norm(pooled))
    widest = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    sigma = float(np.sqrt(pooled @ covariance @ pooled)) / length if length else widest
    p_claimed = float(chdtrc(1, ((length - EARTH_RATE_RPS) / sigma) ** 2))
    upper = upper_limit(length, widest)
    standing = standing_of(p_value, p_claimed=p_claimed if p_value < LEVEL else 1.0, upper=upper, matters=EARTH_RATE_RPS)
    per_hour = np.degrees(1) * 3600
    size = f"{measured(length * per_hour, sigma * per_hour)} °/h"
    test = f"{POOLED} in the array's axes; equal p = {p_equal:.2g}"
    claimed = f"the Earth's {EARTH_RATE_RPS * per_hour:.1f} °/h"
    p_shown = p_claimed if standing is Standing.AGAINST else p_value
    what = f"{EARTH}, one term of all units"
    if p_equal < LEVEL:
        standing, p_shown, test, what = Standing.UNDECIDED, p_equal, f"{HOMOGENEITY} in the array's axes", f"{what}, which disagree"
        lengths, sigmas = np.linalg.norm(values, axis=1), np.sqrt(np.linalg.eigvalsh(covariances)[:, -1])
        upper = max(map(upper_limit, lengths, sigmas))
        size = f"{lengths.min() * per_hour:.2g} to {lengths.max() * per_hour:.2g} °/h in single units"
    statement = Statement(what, standing, test, p_shown, size, f"{upper * per_hour:.2g} °/h", claimed)
    return Trait(EARTH, COMMON, statement, units, says, (), turned, unknown)


def _yaw_to_array(fit: ArrayFit, number: int) -> np.ndarray:
    """Rotation (3, 3) from a unit's own table axes to the array's: both are level, so it is a turn about the vertical, to its noise."""
    i = fit.numbers.index(number)
    prepared, joint = fit.prepared[i].problem, fit.joint
    own = {id(still): q for log in prepared.logs for q, still in zip(log.q_tb, log.stills, strict=True)}
    turns = []
    for q, still in enumerate(fit.same.stills[i]):
        if still is not None and fit.same.group[q] == fit.same.group[0]:
            turns.append(rotation.matrix(joint.state.q_tb[q]) @ joint.state.mountings[i] @ rotation.matrix(own[id(still)]).T)
    total = np.sum(turns, axis=0)
    yaw = np.arctan2(total[1, 0] - total[0, 1], total[0, 0] + total[1, 1])
    return np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
