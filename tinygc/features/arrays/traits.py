"""Effects of an array: each estimated in every unit, and whose it is by the evidence of all units together.

An effect that one unit's explanation names, and another's does not, need not differ between them.  So it is estimated in all of them, named
or not, each with its covariance, and the evidence decides whether they have one value, each its own, or none (``choose.divided``).  What
must be common (the Earth, motion, the table) is one term of all units, in the array's axes.  Slow motions of the zero-rate offsets are one
family, whose members are weighed by the evidence of all units together.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from scipy.special import chdtrc

from session.base import rotation
from session.base.numeric import sigmas_in
from session.base.records import in_unit
from session.base.texts import measured, probability, significant
from session.base.units import DEG, DEG_PER_HOUR, EARTH_RATE_RPS
from tinygc.effects import Effect
from tinygc.explanation.claims import Claim
from tinygc.explanation.engine import Explanation
from tinygc.explanation.evidence import Evidence, without_claim
from tinygc.explanation.families import SLOW_ZERO, alternatives, motion, shares_of
from tinygc.explanation.search import guesses, slow_candidates
from tinygc.features.arrays.fit import ArrayFit
from tinygc.inference.choose import (
    LEVEL,
    ONE_VALUE,
    PRIOR_ODDS,
    Division,
    Standing,
    Statement,
    divided,
    linear_estimate,
    probabilities,
    upper_limit,
    weights_of,
)
from tinygc.noise.refit import Replay, candidates, prior_sigmas
from tinygc.noise.twin import Twin

#: whose an effect is: common by nature, of one value in all units, different between units, undecided, or in single readings
COMMON, ALIKE, DIFFERS, UNDECIDED, READINGS = "common", "alike", "differs", "undecided", "readings"
#: effects that belong to the body, whichever unit's explanation names them
EARTH, MOTION, NOT_STILL = "earth.rotation", "motion.undersampled", "reference.not_still"
OFFSET = "timing.gyro_accel_offset"
#: sigmas by which a number's prior lets it move the residuals; below it, the prior holds it
HELD = 0.01
#: its p is the probability that what is stated is not so
EVIDENCE = "evidence of all units"

#: an effect in one unit: theta (P,) SI, and its covariance (P, P)
Estimate = tuple[np.ndarray, np.ndarray]


def traits_of(
    explanations: Mapping[int, Explanation], fit: ArrayFit, share: Callable[[Effect], float], unknown: Sequence[int], apart_from: set[str]
) -> list[Statement]:
    """State every effect that any unit's explanation names, but for those in ``apart_from``.

    share: of the errors of an effect's estimates that the units have in common, 0 to 1, which more units do not reduce; unknown: units
    without an explanation.
    """
    claims: dict[str, dict[int, Claim]] = {}
    for number, e in explanations.items():
        for claim in e.claimed:
            claims.setdefault(claim.effect.id, {})[number] = claim
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
        found.append(trait_of(effect, by_unit, estimates, share(effect), unknown))
    return found


def _instead(by_unit: Mapping[int, Claim]) -> tuple[str, ...]:
    return tuple(dict.fromkeys(other for claim in by_unit.values() for other in claim.equivalent))


def estimate_in(e: Explanation, effect: Effect, instead: Sequence[str]) -> Estimate | None:
    """Estimate an effect in one unit, next to the effects that its explanation names, without the effects that stand for the same."""
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
    effect: Effect, by_unit: Mapping[int, Claim], estimates: Mapping[int, Estimate], share: float, unknown: Sequence[int]
) -> Statement:
    """State one effect that these units claim, by the units' estimates.

    Its table has the scope; the units that name it; a description for each of them, in order; those that are apart from the others; the
    estimates of every unit; effects that the recording cannot separate from it.
    """
    units, instead = tuple(by_unit), _instead(by_unit)
    more = f"; or {' or '.join(instead)}: not separable here" if instead and estimates else ""
    more += f"; {_of_units(unknown)} could not be explained, and may have it too" if unknown else ""
    figures: dict[str, Any] = {
        "id": effect.id,
        "units": units,
        "scope": UNDECIDED,
        "apart": (),
        "equivalent": instead if estimates else (),
        "of_units": tuple(claim.description for claim in by_unit.values()),
        "by_unit": [
            {"number": number, "named": number in units, "value": theta, "std": sigmas_in(covariance)}
            for number, (theta, covariance) in estimates.items()
        ],
    }
    named = f"{effect.id}, named in {_of_units(units)}"
    if not estimates:
        # What a detector found in the registers or stills of units has no size in the others, so nothing is stated of them.
        what, figures["scope"] = ("stills", COMMON) if effect.id == NOT_STILL else ("readings", READINGS)
        p_value, words = min(claim.p_value for claim in by_unit.values()), figures["of_units"][0]
        return Statement(named, Standing.FOR, f"detector in the {what}", p_value, words, "", more=more, figures=figures)
    numbers, (values, covariances) = list(estimates), (np.array(each) for each in zip(*estimates.values(), strict=True))
    information = np.linalg.inv(covariances)
    pull = np.einsum("uij,uj->ui", information, values)

    def pooled(part: Sequence[int]) -> tuple[str, str, dict[str, float]]:
        few = 1 + (len(part) - 1) * share
        covariance = few * np.linalg.inv(information[part].sum(axis=0))
        return _sized(effect, covariance @ pull[part].sum(axis=0) / few, covariance)

    plausible = effect.parameter.plausible
    divisions = divided(values / plausible, covariances / plausible**2, share)
    chances = {ids: float(p) for (ids, _), p in zip(divisions, weights_of([each.score for each in divisions]), strict=True)}
    p_same = sum(p for ids, p in chances.items() if not ids - {ONE_VALUE})
    one = {ONE_VALUE} if effect.id != EARTH or len(numbers) > 1 else {"0"}  # one unit shows nothing of the others, but the Earth it does
    p_other = sum(p for ids, p in chances.items() if ids != one)
    odd = [k for k in range(len(numbers)) if str(k) in divisions[0].ids]
    if odd and len(numbers) > 1 and (p_same < LEVEL or effect.id == EARTH):
        rest = [k for k in range(len(numbers)) if k not in odd]
        size = ", ".join(f"{pooled([k])[0]} in unit {numbers[k]}" for k in odd)
        size += f", {pooled(rest)[0]} in the others" if rest else ""
        figures |= {"apart": tuple(numbers[k] for k in odd), "scope": COMMON if effect.id == EARTH else DIFFERS}
        standing = Standing.UNDECIDED if effect.id == EARTH else Standing.FOR
        limit = max((pooled([k]) for k in odd), key=lambda each: each[2]["upper"])[1]
        return Statement(f"{effect.id} differs between units", standing, EVIDENCE, p_same, size, limit, more=more, figures=figures)
    size, limit, found = pooled(range(len(numbers)))
    how: dict[str, Any] = {"matters": max((float(np.abs(estimates[n][0]).max()) for n in units if n in estimates), default=np.inf)}
    if effect.id == EARTH:
        p_earth = float(chdtrc(1, ((found["value"] - EARTH_RATE_RPS) / found["sigma"]) ** 2))
        how = {"matters": EARTH_RATE_RPS, "claimed": f"the Earth's {EARTH_RATE_RPS / DEG_PER_HOUR:.1f} °/h"}
        how["p_claimed"] = p_earth if p_other < LEVEL else 1.0
    everywhere = f"{effect.id} in all units" if not unknown else f"{effect.id} in {_of_units(numbers)}"
    p_missing = sum(p for ids, p in chances.items() if ONE_VALUE not in ids and len(ids) < len(numbers))  # some unit has none
    p_value = p_missing if p_missing < LEVEL <= p_other and len(numbers) > 1 else p_other
    what = f"{everywhere}, of one size" if p_value < LEVEL else named
    if p_value < LEVEL <= p_other:
        what += f", or each its own ({probability(p_other)}), in the mean"
    elif p_value >= LEVEL and len(numbers) > 1:
        what += f", of one size in {len(numbers)} units"
    if odd:  # a limit of one size is none of theirs
        limit = max((pooled([k]) for k in range(len(numbers))), key=lambda each: each[2]["upper"])[1]
        found["upper"] = np.inf
    statement = Statement.of(what, EVIDENCE, p_value, size, limit, **found, **how, more=more, figures=figures)
    if effect.id == EARTH or (statement.standing is Standing.FOR and p_other < LEVEL):
        figures["scope"] = COMMON if effect.id == EARTH else ALIKE
    return statement


def _of_units(numbers: Sequence[int]) -> str:
    return f"unit{'s' * (len(numbers) != 1)} {', '.join(map(str, numbers))}"


def _sized(effect: Effect, theta: np.ndarray, covariance: np.ndarray) -> tuple[str, str, dict[str, float]]:
    """Words of a size and of its upper 95 % limit, and both as numbers: of the component with the largest magnitude, the limit of all; of
    the Earth's rotation its length."""
    if effect.id == EARTH:
        value, widest = float(np.linalg.norm(theta)), float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
        sigma = float(np.sqrt(theta @ covariance @ theta)) / value if value else widest
        si, unit, upper = DEG_PER_HOUR, "°/h", upper_limit(value, widest)
    else:
        sigmas, k = sigmas_in(covariance), int(np.argmax(np.abs(theta)))
        si, unit, upper = effect.parameter.si, effect.parameter.unit, max(map(upper_limit, theta.tolist(), sigmas.tolist()))
        value, sigma = float(theta[k]), float(sigmas[k])
    return (
        f"{measured(value / si, sigma / si)} {unit}",
        f"{significant(upper / si, 2)} {unit}",
        {"value": value, "sigma": sigma, "upper": upper},
    )


# Slow motions of the zero-rate offsets.

#: a member in one unit, with its best shape: the -2 log evidence that it adds, and the motion of the zero-rate offset, and its upper 95 %
#: limit, rad/s
Member = tuple[float, float, float]


def slow_zero_of(explanations: Mapping[int, Explanation], progress: Callable[[int], None] = lambda unit: None) -> Statement | None:
    """Weigh the family over all units.  None where no unit's explanation names a member, or there is none that all units can have."""
    named = {
        number: tuple(claim.effect.id for claim in (*e.claimed, *e.findings) if claim.effect.id in SLOW_ZERO)
        for number, e in explanations.items()
    }
    if not any(named.values()):
        return None
    found = {}
    for number, e in explanations.items():
        progress(number)
        found[number] = members_in(e)
    return slow_zero(found, named, all(e.twin.has_thermometer for e in explanations.values()))


def members_in(e: Explanation) -> dict[str, Member]:
    """Weigh each member, by its id, in one unit, next to the effects that it names outside of the family."""
    evidence = Evidence(e.twin)
    tried = [effect for effect in (*candidates(e.twin), *slow_candidates(e.twin)) if effect.id in SLOW_ZERO]
    evidence.will_try(tried)
    others = tuple(claim.effect for claim in e.naming.fit.state.claims if claim.effect.id not in SLOW_ZERO)
    base = evidence.of(others, evidence.nothing)
    found = {}
    for name in dict.fromkeys(effect.id for effect in tried):
        if not (ranked := guesses(evidence, [effect for effect in tried if effect.id == name], base)):
            continue
        effect = ranked[0].effects[-1]
        (columns,) = base.whiten.each([evidence.columns(effect)])
        theta, covariance = linear_estimate(base.fit.r, base.fit.J, columns, effect.parameter.plausible)
        found[name] = ranked[0].score - base.score, motion(e.twin, [(effect, theta)])[0], upper_motion(e.twin, effect, theta, covariance)
    return found


def upper_motion(twin: Twin, effect: Effect, theta: np.ndarray, covariance: np.ndarray) -> float:
    """Upper 95 % limit, rad/s, of ``motion`` by one effect, on the axis where it is largest, between the estimate's extremes."""
    columns = np.concatenate([effect.columns(movement) for movement in twin.movements])
    added = columns @ theta
    axes = np.arange(added.shape[1])
    reach = columns[added.argmax(axis=0), axes] - columns[added.argmin(axis=0), axes]
    return max(upper_limit(float(d @ theta), float(np.sqrt(d @ covariance @ d))) for d in reach)


def slow_zero(units: Mapping[int, Mapping[str, Member]], named: Mapping[int, tuple[str, ...]], thermometer: bool) -> Statement | None:
    """Add the units' evidence for each member that all of them can have; None if there is none.

    One cause moves all units or none: the prior odds are paid once, the scale of each unit's motion by each.
    """
    members = [name for name in SLOW_ZERO if all(name in unit for unit in units.values())]
    if not members:
        return None

    def chances(of: Sequence[Mapping[str, Member]]) -> dict[str, float]:
        once = 2 * (len(of) - 1) * float(np.log(1 / PRIOR_ODDS))
        sums = [Division(frozenset({name}), sum(unit[name][0] for unit in of) - once) for name in members]
        return probabilities([Division(frozenset(), 0.0), *sums])

    weights = chances(list(units.values()))
    nothing = weights.pop("")
    shares = shares_of(weights)
    best = [unit[next(iter(shares))] for unit in units.values()]
    low, high = (significant(edge(size for _, size, _ in best) / DEG, 2) for edge in (min, max))
    alone = sum(chances([unit])[""] < LEVEL for unit in units.values())
    size = f"by {low} to {high} dps over the session, {alternatives(shares, thermometer)}; {alone} of {len(units)} show it alone"
    limit = f"{significant(max(upper for *_, upper in best) / DEG, 2)} dps"
    by_unit = [{"number": n, **in_unit(DEG, size_dps=one[1]), "named": bool(named.get(n))} for n, one in zip(units, best, strict=True)]
    figures = {"id": "slow_zero", "scope": COMMON, "shares": shares, "by_unit": by_unit}
    return Statement.of("the units' zero-rate offsets move slowly", EVIDENCE, nothing, size, limit, figures=figures)


def _yaw_to_array(fit: ArrayFit, number: int) -> np.ndarray:
    """Rotation (3, 3) from a unit's own table axes to the array's: both are level, so it is a turn about the vertical, to its noise."""
    i = fit.numbers.index(number)
    prepared, joint = fit.units[i].problem, fit.joint
    own = {id(still): q for log in prepared.logs for q, still in zip(log.q_tb, log.stills, strict=True)}
    total = np.zeros((3, 3))
    for q, still in enumerate(fit.same.stills[i]):
        if still is not None and fit.same.group[q] == fit.same.group[0]:
            total += rotation.matrix(joint.state.q_tb[q]) @ joint.state.mountings[i] @ rotation.matrix(own[id(still)]).T
    yaw = np.arctan2(total[1, 0] - total[0, 1], total[0, 0] + total[1, 1])
    return np.array([[np.cos(yaw), -np.sin(yaw), 0.0], [np.sin(yaw), np.cos(yaw), 0.0], [0.0, 0.0, 1.0]])
