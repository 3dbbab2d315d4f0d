"""Search for the hypothesis with the most evidence, and the detection limits of all other effects."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from tinygc.effects import Effect, catalogue
from tinygc.explanation.evidence import Evidence, Guess, Hypothesis, candidates, least_gain, left_of, orthonormal, sharpened
from tinygc.noise.refit import Refit, Replay
from tinygc.noise.twin import Twin, claim_slice
from tinygc.noise.whitening import TOGETHER, Whitener

# The search for the hypothesis with the most evidence: forward, with elimination and exchange after every step, and a beam.
#
# Candidates are ranked by a linear approximation under two noise estimates: the prior one and that of the present hypothesis. The former
# shows what a noise component has absorbed, the latter a weak effect.  The best are refitted exactly.

MOST_EFFECTS = 5  #: one more than `calibrate.py challenge` hides: each costs a round (benchmarks/explain_speed.py)
#: candidates evaluated in each round, from either ranking
MOST_TRIALS = 3
#: -2 log evidence within which a hypothesis is extended further, and a competing effect is evaluated
WITHIN = 12.0
BEAM = 2
#: error of -2 log evidence from linear columns; hypotheses evaluated exactly in a round
NEAR, MOST_EXACT = 8.0, 3
#: relative error of a gain from linear columns; competing effects evaluated in place of an effect
LINEAR_SHARE, MOST_LOOKALIKES = 0.1, 4


def search(
    evidence: Evidence,
    tried: list[Effect],
    begin: Hypothesis,
    most: int = MOST_EFFECTS,
    progress: Callable[[str], None] = lambda what: None,
) -> Hypothesis:
    """Find the hypothesis with the most evidence that can be reached from ``begin``."""
    evidence.will_try(tried)
    best, beam = begin, [begin]
    for number in range(most):
        progress(f"naming, round {number + 1}")
        found = [trial for each in beam for trial in _with_one_more(evidence, tried, each)]
        if not found:
            break
        found.sort(key=lambda h: h.score)
        ahead = without_idle(evidence, found[0])
        if ahead.score >= best.score:
            break
        best = ahead
        beam = [best, *(h for h in found[1:BEAM] if h.score < best.score + WITHIN and h.ids != best.ids)]
    return best


def ranked(evidence: Evidence, tried: list[Effect], have: Hypothesis) -> list[Effect]:
    """Candidates to add to a hypothesis, each effect once, at its best shape."""
    rest = [effect for effect in tried if effect.id not in have.ids]
    found: dict[str, Effect] = {}
    replay = Replay(evidence.twin, have.fit)
    looks = [(whiten, rewhitened(have, whiten)) for whiten in (evidence.first_whiten, have.whiten)]
    for (whiten, fit), promise in zip(looks, promises(evidence, looks, rest), strict=True):
        found |= _most_promising(evidence, (whiten, fit, replay), rest, promise, 0.0, MOST_TRIALS, found)
    return list(found.values())


def _most_promising(
    evidence: Evidence,
    beside: tuple[Whitener, Refit, Replay],
    rest: list[Effect],
    promise: np.ndarray,
    least: float,
    most: int,
    known: Mapping[str, Effect],
) -> dict[str, Effect]:
    """Up to ``most`` new candidates with the greatest promise, each at least ``least``; each once, at its best shape."""
    found: dict[str, Effect] = {}
    for number in np.argsort(-promise):
        if promise[number] < least or len(found) >= most:
            break
        effect = rest[number]
        key = effect.id if effect.scan is not None else effect.equation
        if key not in found and key not in known:
            whiten, fit, replay = beside
            found[key] = sharpened(evidence.twin, whiten, fit, effect, replay)
    return found


def promises(evidence: Evidence, looks: list[tuple[Whitener, Refit]], rest: list[Effect]) -> np.ndarray:
    """(len(looks), len(rest)) twice the log evidence that each candidate would add by its linear columns, for each fit and its whitening,
    with the noise fixed.  Columns are computed once for all fits."""
    found = np.empty((len(looks), len(rest)))
    beside = []
    for _, fit in looks:
        q = orthonormal(fit.J)
        beside.append((q, fit.r - q @ (q.T @ fit.r)))
    for first in range(0, len(rest), TOGETHER):
        some = rest[first : first + TOGETHER]
        stacked = [evidence.columns(effect) for effect in some]
        for look, ((whiten, _), (q, r)) in enumerate(zip(looks, beside, strict=True)):
            for number, (effect, columns) in enumerate(zip(some, whiten.each(stacked), strict=True), first):
                basis = left_of(q, columns)
                gain, size = float(np.sum((basis.T @ r) ** 2)), max(basis.shape[1], 1)
                # With the best scale, each parameter costs the logarithm of its signal-to-noise ratio.
                found[look, number] = gain - size * np.log(max(gain / size, 1.0)) - evidence.price(effect)
    return found


def rewhitened(have: Hypothesis, whiten: Whitener) -> Refit:
    """The fit of a hypothesis whitened with another covariance."""
    if whiten is have.whiten:
        return have.fit
    return replace(have.fit, r=whiten(have.whiten.back(have.fit.r)), J=whiten(have.whiten.back(have.fit.J)))


def _with_one_more(evidence: Evidence, tried: list[Effect], have: Hypothesis) -> list[Hypothesis]:
    """The best hypotheses with one more effect: the best by linear columns and those near it, evaluated exactly."""
    found = guesses(evidence, tried, have)
    near = [g for g in found[:MOST_EXACT] if g.score < found[0].score + NEAR]
    if any(_delays(g.effects[-1]) for g in near):
        near += [g for g in found if _delays(g.effects[-1]) and g not in near]
    return [evidence.of(g.effects, have) for g in near]


def _delays(effect: Effect) -> bool:
    """Whether an effect is a delay, which linear columns rank poorly: they miss the curvature of a long delay and cannot separate two."""
    return effect.gauge is not None


def guesses(evidence: Evidence, tried: list[Effect], have: Hypothesis) -> list[Guess]:
    """Approximate hypotheses with each ranked candidate added, by linear columns, the best first."""
    evidence.will_try(tried)
    return sorted((evidence.guess(have, add=effect) for effect in ranked(evidence, tried, have)), key=lambda g: g.score)


def without_idle(evidence: Evidence, best: Hypothesis) -> Hypothesis:
    """Remove effects that others have made redundant."""
    while len(best.effects) > 1:
        several = sum(map(_delays, best.effects)) > 1  # delays can replace one another
        without = [(effect, evidence.guess(best, without=effect)) for effect in best.effects]
        fewer = [
            evidence.of(guess.effects, best)
            for effect, guess in without
            if guess.score < best.score + NEAR / 2 or (several and _delays(effect))
        ]
        ahead = min([*fewer, best], key=lambda h: h.score)
        if ahead is best:
            break
        best = ahead
    return best


def exchanged(evidence: Evidence, tried: list[Effect], best: Hypothesis) -> Hypothesis:
    """Try to replace each effect by others that fit in its place; an effect named before others were found may thus be removed."""
    for _ in range(MOST_EFFECTS):
        trials = []
        for effect in best.effects:
            own = evidence.guess(best, without=effect).score - best.score
            for other in _in_place_of(evidence, tried, best, effect, own):
                guess = evidence.guess(best, without=effect, add=other)
                if guess.score < best.score + NEAR or (_delays(effect) and _delays(other)):
                    trials.append(evidence.of(guess.effects, best))
        ahead = min([*trials, best], key=lambda h: h.score)
        if ahead is best:
            break
        best = without_idle(evidence, ahead)
    return best


def _in_place_of(evidence: Evidence, tried: list[Effect], best: Hypothesis, effect: Effect, own: float) -> list[Effect]:
    """Candidates whose linear columns remove nearly as much as an effect worth ``own`` in -2 log evidence."""
    whiten, number = best.whiten, next(i for i, e in enumerate(best.effects) if e is effect)
    part = claim_slice(best.fit.state.claims, number)
    r = best.fit.r - best.fit.J[:, part] @ best.fit.state.claims[number].theta
    fit = replace(best.fit, r=r, J=np.delete(best.fit.J, part, axis=1))
    others = best.ids - {effect.id}
    rest = [other for other in tried if other.id not in others and other is not effect and (other.id != effect.id or other.scan is None)]
    looks, replay = [(whiten, fit)], Replay(evidence.twin, fit)
    (promise,), ((mine,),) = promises(evidence, looks, rest), promises(evidence, looks, [effect])
    least = max(mine - WITHIN - LINEAR_SHARE * abs(mine), 0)
    return list(_most_promising(evidence, (whiten, fit, replay), rest, promise, least, MOST_LOOKALIKES, {}).values())


# Detection limits: the size from which each effect would have been detected in this recording.


def seen_from(twin: Twin, whiten: Whitener, fit: Refit) -> dict[str, float]:
    """Effect id -> detection limit in the parameter's unit, for half of the effect's directions; inf if no plausible size would be
    detected.

    An effect is detected if it is more probable than no effect (``evidence.least_gain``).  An effect with a scanned shape (a step) is taken
    at the value that shows it best.  Linear, in addition to everything in ``fit``.
    """
    q, _ = np.linalg.qr(fit.J / np.linalg.norm(fit.J, axis=0))
    sizes: dict[str, float] = {}
    tried, replay = candidates(twin), Replay(twin, fit)
    shapes = Counter(effect.id for effect in tried)
    for effect in tried:
        columns = whiten(replay.columns(effect).stacked())
        left, plausible = columns - q @ (q.T @ columns), effect.parameter.plausible
        # Use the median: the part of a delay common to all axes belongs to the clock and is hardly observable in any recording.
        strength = float(np.median(np.linalg.svd(left * plausible, compute_uv=False)))
        sigmas = float(np.sqrt(least_gain(effect, shapes[effect.id])))
        size = sigmas / strength * plausible / effect.parameter.si if strength > sigmas else np.inf
        sizes[effect.id] = min(size, sizes.get(effect.id, np.inf))
    return sizes


def in_words(sizes: dict[str, float]) -> list[str]:
    """At most two lines: the detection limit of each effect, and the effects that this recording cannot show."""
    known = catalogue()
    shown = ", ".join(f"{name} {size:.2g} {known[name].parameter.unit}" for name, size in sizes.items() if np.isfinite(size))
    blind = ", ".join(name for name, size in sizes.items() if not np.isfinite(size))
    lines = [f"detection limits: {shown}"] if shown else []
    return lines + ([f"not observable in this recording: {blind}"] if blind else [])


# The probability of each effect and of its competitors.

#: -2 log evidence by which an equivalent may be worse and still be listed: beyond it evidence is "very strong" (Kass & Raftery 1995)
STAND_IN = 10.0


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """One effect with its family-wise p-value, the chi-square it removes, its probability, its equivalents, and the probability of every
    competing effect that was evaluated, by id."""

    effect: Effect
    p_value: float
    gain: float
    probability: float = 1.0
    equivalent: tuple[str, ...] = ()
    rivals: dict[str, float] = field(default_factory=dict)


def probabilities(weighed: Sequence[Guess]) -> dict[str, float]:
    """Posterior probability of each id, over all evaluated hypotheses; "" for no effect."""
    scores = np.array([h.score for h in weighed])
    weight = np.exp(-(scores - scores.min()) / 2)
    weight /= weight.sum()
    found: dict[str, float] = {}
    for h, w in zip(weighed, weight, strict=True):
        for name in h.ids or ("",):
            found[name] = found.get(name, 0.0) + float(w)
    return {name: min(p, 1.0) for name, p in found.items()}


def rivals_of(weighed: Sequence[Guess], best: Hypothesis, effect: Effect) -> dict[str, float]:
    """-2 log evidence by which each effect that was evaluated in place of this one is worse, by id."""
    others = best.ids - {effect.id}
    found: dict[str, float] = {}
    for h in weighed:
        extra = h.ids - others
        if others <= h.ids and len(extra) == 1 and effect.id not in extra:
            (name,) = extra
            found[name] = min(found.get(name, np.inf), h.score - best.score)
    return found
