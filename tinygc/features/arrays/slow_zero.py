"""Slow motions of the units' zero-rate offsets: one family, whose members are weighed by the evidence of all units together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from session.base.units import DEG
from tinygc.effects import Effect
from tinygc.explanation.engine import Explanation
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.families import SLOW_ZERO, alternatives, motion, shares_of
from tinygc.explanation.search import guesses, slow_candidates
from tinygc.inference.choose import LEVEL, PRIOR_ODDS, Standing, Statement, linear_estimate, upper_limit
from tinygc.noise.refit import candidates
from tinygc.noise.twin import Twin


@dataclass(frozen=True, eq=False)
class _UnitEvidence:
    """Of one unit: -2 log evidence that each member adds, by id, with its best shape; and for each the chi-square that it takes up, its
    degrees of freedom, the number of shapes that were tried, and the motion of the zero-rate offset with its upper 95 % limit, rad/s."""

    score: dict[str, float]
    gain: dict[str, tuple[float, int]]
    shapes: dict[str, int]
    size_rps: dict[str, float]
    upper_rps: dict[str, float]


@dataclass(frozen=True, eq=False)
class PooledSlowZero:
    """The family over all units.

    shares: of each member in the family's probability, by the evidence of all units; statement; sizes_rps: motion of each unit's zero-rate
    offset by the best member, by number; named: what each unit's own explanation names, by number.
    """

    shares: dict[str, float]
    statement: Statement
    sizes_rps: dict[int, float]
    named: dict[int, tuple[str, ...]]


def slow_zero_of(explanations: Mapping[int, Explanation], progress: Callable[[int], None] = lambda unit: None) -> PooledSlowZero | None:
    """Weigh the family over all units; None where no unit's explanation names a member, or all units can have none."""
    named = {
        number: tuple(claim.effect.id for claim in (*e.claimed, *e.findings) if claim.effect.id in SLOW_ZERO)
        for number, e in explanations.items()
    }
    if not any(named.values()):
        return None
    found = {}
    for number, e in explanations.items():
        progress(number)
        found[number] = evidence_of(e)
    return pooled(found, named, all(e.twin.has_thermometer for e in explanations.values()))


def evidence_of(e: Explanation) -> _UnitEvidence:
    """Weigh each member in one unit, beside the effects that it names outside of the family."""
    evidence = Evidence(e.twin)
    tried = [effect for effect in (*candidates(e.twin), *slow_candidates(e.twin)) if effect.id in SLOW_ZERO]
    evidence.will_try(tried)
    others = tuple(claim.effect for claim in e.naming.fit.state.claims if claim.effect.id not in SLOW_ZERO)
    base = evidence.of(others, evidence.nothing)
    found = _UnitEvidence({}, {}, {}, {}, {})
    for name in dict.fromkeys(effect.id for effect in tried):
        of_name = [effect for effect in tried if effect.id == name]
        ranked = guesses(evidence, of_name, base)
        if not ranked:
            continue
        effect = ranked[0].effects[-1]
        found.score[name] = ranked[0].score - base.score
        (columns,) = base.whiten.each([evidence.columns(effect)])
        theta, covariance = linear_estimate(base.fit.r, base.fit.J, columns, effect.parameter.plausible)
        found.gain[name] = float(theta @ np.linalg.solve(covariance, theta)), len(theta)
        found.shapes[name] = len(of_name)
        found.size_rps[name], _ = motion(e.twin, [(effect, theta)])
        found.upper_rps[name] = upper_motion(e.twin, effect, theta, covariance)
    return found


def upper_motion(twin: Twin, effect: Effect, theta: np.ndarray, covariance: np.ndarray) -> float:
    """Upper 95 % limit, rad/s, of ``motion`` by one effect, on the axis where it is largest, between the estimate's extremes."""
    columns = np.concatenate([effect.columns(movement) for movement in twin.movements])
    added = columns @ theta
    axes = np.arange(added.shape[1])
    reach = columns[added.argmax(axis=0), axes] - columns[added.argmin(axis=0), axes]
    return max(upper_limit(float(d @ theta), float(np.sqrt(d @ covariance @ d))) for d in reach)


def pooled(units: Mapping[int, _UnitEvidence], named: dict[int, tuple[str, ...]], thermometer: bool) -> PooledSlowZero | None:
    """Add the units' evidence for each member that all of them can have; None if there is none.

    One cause moves all units or none: the prior odds are paid once, the scale of each unit's motion by each.
    """
    members = [name for name in SLOW_ZERO if all(name in unit.score for unit in units.values())]
    if not members:
        return None
    once = 2 * (len(units) - 1) * float(np.log(1 / PRIOR_ODDS))
    scores = {name: sum(unit.score[name] for unit in units.values()) - once for name in members}
    least = min(scores.values())
    shares = shares_of({name: float(np.exp(-(score - least) / 2)) for name, score in scores.items()})
    best = next(iter(shares))
    total = sum(unit.gain[best][0] for unit in units.values())
    freedom = sum(unit.gain[best][1] for unit in units.values())
    # The best member was looked for among all, and its best shape in each unit.
    tried = len(members) * float(np.prod([float(unit.shapes[best]) for unit in units.values()]))
    p_value = min(1.0, tried * float(chdtrc(freedom, total)))
    # Evidence and test must agree: the first pays for every number of every unit, the second knows no alternatives.
    standing = Standing.FOR if p_value < LEVEL and least < 0 else Standing.UNDECIDED
    sizes = {number: unit.size_rps[best] for number, unit in units.items()}
    low, high = min(sizes.values()) / DEG, max(sizes.values()) / DEG
    alone = sum(len(members) * unit.shapes[best] * float(chdtrc(unit.gain[best][1], unit.gain[best][0])) < LEVEL for unit in units.values())
    size = f"by {low:.2g} to {high:.2g} dps over the session, {alternatives(shares, thermometer)}; {alone} of {len(units)} show it alone"
    limit = f"{max(unit.upper_rps[best] for unit in units.values()) / DEG:.2g} dps"
    what = "the units' zero-rate offsets move slowly"
    statement = Statement(what, standing, f"chi-square, pooled over {len(units)} units", p_value, size, limit)
    return PooledSlowZero(shares, statement, sizes, named)
