"""Slow motions of the units' zero-rate offsets: one family, whose members are weighed by the evidence of all units together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from scipy.special import chdtrc

from session.base.records import in_unit
from session.base.units import DEG
from tinygc.effects import Effect
from tinygc.explanation.engine import Explanation
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.families import SLOW_ZERO, alternatives, motion, shares_of
from tinygc.explanation.search import guesses, slow_candidates
from tinygc.inference.choose import LEVEL, PRIOR_ODDS, Standing, Statement, linear_estimate, upper_limit
from tinygc.noise.refit import candidates
from tinygc.noise.twin import Twin


class Weighed(NamedTuple):
    """A member in one unit, with its best shape: -2 log evidence that it adds; the chi-square that it takes up, its degrees of freedom; the
    number of shapes that were tried; the motion of the zero-rate offset, and its upper 95 % limit, rad/s."""

    score: float
    chi_square: float
    freedom: int
    shapes: int
    size_rps: float
    upper_rps: float


def slow_zero_of(
    explanations: Mapping[int, Explanation], progress: Callable[[int], None] = lambda unit: None
) -> tuple[Statement, dict] | None:
    """Weigh the family over all units: a statement, and what else the JSON has of it.  None where no unit's explanation names a member, or
    there is none that all units can have."""
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
    return pooled(found, named, all(e.twin.has_thermometer for e in explanations.values()))


def members_in(e: Explanation) -> dict[str, Weighed]:
    """Weigh each member, by its id, in one unit, beside the effects that it names outside of the family."""
    evidence = Evidence(e.twin)
    tried = [effect for effect in (*candidates(e.twin), *slow_candidates(e.twin)) if effect.id in SLOW_ZERO]
    evidence.will_try(tried)
    others = tuple(claim.effect for claim in e.naming.fit.state.claims if claim.effect.id not in SLOW_ZERO)
    base = evidence.of(others, evidence.nothing)
    found = {}
    for name in dict.fromkeys(effect.id for effect in tried):
        of_name = [effect for effect in tried if effect.id == name]
        if not (ranked := guesses(evidence, of_name, base)):
            continue
        effect = ranked[0].effects[-1]
        (columns,) = base.whiten.each([evidence.columns(effect)])
        theta, covariance = linear_estimate(base.fit.r, base.fit.J, columns, effect.parameter.plausible)
        taken = float(theta @ np.linalg.solve(covariance, theta)), len(theta)
        size, upper = motion(e.twin, [(effect, theta)])[0], upper_motion(e.twin, effect, theta, covariance)
        found[name] = Weighed(ranked[0].score - base.score, *taken, len(of_name), size, upper)
    return found


def upper_motion(twin: Twin, effect: Effect, theta: np.ndarray, covariance: np.ndarray) -> float:
    """Upper 95 % limit, rad/s, of ``motion`` by one effect, on the axis where it is largest, between the estimate's extremes."""
    columns = np.concatenate([effect.columns(movement) for movement in twin.movements])
    added = columns @ theta
    axes = np.arange(added.shape[1])
    reach = columns[added.argmax(axis=0), axes] - columns[added.argmin(axis=0), axes]
    return max(upper_limit(float(d @ theta), float(np.sqrt(d @ covariance @ d))) for d in reach)


def pooled(
    units: Mapping[int, Mapping[str, Weighed]], named: dict[int, tuple[str, ...]], thermometer: bool
) -> tuple[Statement, dict] | None:
    """Add the units' evidence for each member that all of them can have; None if there is none.

    One cause moves all units or none: the prior odds are paid once, the scale of each unit's motion by each.
    """
    members = [name for name in SLOW_ZERO if all(name in unit for unit in units.values())]
    if not members:
        return None
    once = 2 * (len(units) - 1) * float(np.log(1 / PRIOR_ODDS))
    scores = {name: sum(unit[name].score for unit in units.values()) - once for name in members}
    least = min(scores.values())
    shares = shares_of({name: float(np.exp(-(score - least) / 2)) for name, score in scores.items()})
    best = [unit[next(iter(shares))] for unit in units.values()]
    # The best member was looked for among all, and its best shape in each unit.
    tried = len(members) * float(np.prod([float(each.shapes) for each in best]))
    p_value = min(1.0, tried * float(chdtrc(sum(each.freedom for each in best), sum(each.chi_square for each in best))))
    # Evidence and test must agree: the first pays for every number of every unit, the second knows no alternatives.
    standing = Standing.FOR if p_value < LEVEL and least < 0 else Standing.UNDECIDED
    low, high = (edge(each.size_rps for each in best) / DEG for edge in (min, max))
    alone = sum(len(members) * each.shapes * float(chdtrc(each.freedom, each.chi_square)) < LEVEL for each in best)
    size = f"by {low:.2g} to {high:.2g} dps over the session, {alternatives(shares, thermometer)}; {alone} of {len(units)} show it alone"
    test, limit = f"chi-square, pooled over {len(units)} units", f"{max(each.upper_rps for each in best) / DEG:.2g} dps"
    statement = Statement("the units' zero-rate offsets move slowly", standing, test, p_value, size, limit)
    by_unit = [{"number": n, **in_unit(DEG, size_dps=one.size_rps), "named": named.get(n, ())} for n, one in zip(units, best, strict=True)]
    return statement, {"shares": shares, "by_unit": by_unit}
