"""The search for the hypothesis with the most evidence: forward, with elimination and exchange after every step, and a beam.

Linear columns say what is worth weighing (``selection.py``), under the noise as it was known beforehand and as the present hypothesis
has estimated it: what a component has swallowed shows under the former, what is faint under the latter.  Weighing is exact.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tinygc.effects import Effect
from tinygc.explanation.naming.candidates import sharpened
from tinygc.explanation.naming.evidence import Evidence, Hypothesis
from tinygc.explanation.naming.selection import left_of, orthonormal
from tinygc.explanation.twin.refit import Refit
from tinygc.explanation.twin.whitening import Whitener

MOST_EFFECTS = 5  #: one more than `calibrate.py challenge` hides: each costs a round (benchmarks/explain_speed.py)
#: candidates that are weighed in each round, of either ranking
MOST_TRIALS = 3
#: -2 log evidence within which a hypothesis is worth going on from, and a rival worth weighing
WITHIN = 12.0
BEAM = 2
#: linear columns promise an exact fit's gain to this share; rivals that are weighed in an effect's place
LINEAR_SHARE, MOST_LOOKALIKES = 0.1, 3


def search(
    evidence: Evidence,
    tried: list[Effect],
    begin: Hypothesis,
    most: int = MOST_EFFECTS,
    progress: Callable[[str], None] = lambda what: None,
) -> Hypothesis:
    """The hypothesis with the most evidence that can be reached from ``begin``."""
    evidence.will_try(tried)
    best, beam = begin, [begin]
    for number in range(most):
        progress(f"naming, round {number + 1}")
        found = [trial for each in beam for trial in _with_one_more(evidence, tried, each)]
        if not found:
            break
        found.sort(key=lambda h: h.score)
        ahead = _improved(evidence, tried, found[0])
        if ahead.score >= best.score:
            break
        best = ahead
        beam = [best, *(h for h in found[1:BEAM] if h.score < best.score + WITHIN and h.ids != best.ids)]
    return best


def ranked(evidence: Evidence, tried: list[Effect], have: Hypothesis) -> list[Effect]:
    """Candidates worth weighing beside a hypothesis, each effect once, at its best shape."""
    rest = [effect for effect in tried if effect.id not in have.ids]
    found: dict[str, Effect] = {}
    for whiten in (evidence.first_whiten, have.whiten):
        fit = rewhitened(have, whiten)
        promise = promises(evidence, whiten, fit, rest)
        taken = 0
        for number in np.argsort(-promise):
            if promise[number] < 0 or taken >= MOST_TRIALS:
                break
            effect = rest[number]
            key = effect.id if effect.scan is not None else effect.equation
            if key not in found:
                found[key] = sharpened(evidence.twin, whiten, fit, effect)
                taken += 1
    return list(found.values())


def promises(evidence: Evidence, whiten: Whitener, fit: Refit, rest: list[Effect]) -> np.ndarray:
    """(len(rest),) twice the logarithm of the evidence that each candidate would add by its linear columns, the noise as it is."""
    q = orthonormal(fit.J)
    r = fit.r - q @ (q.T @ fit.r)
    found = np.empty(len(rest))
    for number, effect in enumerate(rest):
        basis = left_of(q, whiten(evidence.columns(effect)))
        gain, size = float(np.sum((basis.T @ r) ** 2)), max(basis.shape[1], 1)
        # The parameters' scale at its best: each pays the logarithm of its signal over its noise.
        found[number] = gain - size * np.log(max(gain / size, 1.0)) - evidence.price(effect)
    return found


def rewhitened(have: Hypothesis, whiten: Whitener) -> Refit:
    """The fit of a hypothesis as another covariance sees it."""
    return (
        have.fit if whiten is have.whiten else replace(have.fit, **{n: whiten(have.whiten.back(getattr(have.fit, n))) for n in ("r", "J")})
    )


def _with_one_more(evidence: Evidence, tried: list[Effect], have: Hypothesis) -> list[Hypothesis]:
    return [evidence.of((*have.effects, effect), have) for effect in ranked(evidence, tried, have)]


def _improved(evidence: Evidence, tried: list[Effect], best: Hypothesis) -> Hypothesis:
    """Elimination and exchange until neither helps."""
    while len(best.effects) > 1:
        fewer = [evidence.of(tuple(e for e in best.effects if e is not effect), best) for effect in best.effects[:-1]]
        ahead = min(fewer, key=lambda h: h.score)
        if ahead.score >= best.score:
            break
        best = ahead
    return best


def exchanged(evidence: Evidence, tried: list[Effect], best: Hypothesis) -> Hypothesis:
    """Each effect against the others that could take its place; an effect that was named while others were still in the way may go."""
    for _ in range(MOST_EFFECTS):
        trials = []
        for effect in best.effects:
            others = evidence.of(tuple(e for e in best.effects if e is not effect), best)
            gain = others.score - best.score
            whiten, fit = best.whiten, rewhitened(others, best.whiten)
            rest = [other for other in tried if other.id not in best.ids]
            promise = promises(evidence, whiten, fit, rest)
            own = promises(evidence, whiten, fit, [effect])[0]
            seen: set[str] = set()
            for number in np.argsort(-promise):
                other = rest[number]
                if promise[number] < min(own, gain) - WITHIN - LINEAR_SHARE * abs(own) or len(seen) >= MOST_LOOKALIKES:
                    break
                if other.id not in seen:
                    seen.add(other.id)
                    trials.append(evidence.of((*others.effects, sharpened(evidence.twin, whiten, fit, other)), others))
        ahead = min([*trials, best], key=lambda h: h.score)
        if ahead is best:
            break
        best = _improved(evidence, tried, ahead)
    return best
