"""What is named in a recording, with the probability of each name and of its rivals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from tinygc.effects import Effect
from tinygc.explanation.naming.evidence import Guess, Hypothesis
from tinygc.explanation.twin.refit import Refit

#: -2 log evidence by which a stand-in may be worse and still be said: beyond it evidence is "very strong" (Kass & Raftery 1995)
STAND_IN = 10.0


@dataclass(frozen=True, eq=False)
class NamedEffect:
    """One effect with its family-wise p-value, the chi-square it takes up, its probability, the effects that could stand in for it, and
    the probability of every rival that was weighed, by id."""

    effect: Effect
    p_value: float
    gain: float
    probability: float = 1.0
    equivalent: tuple[str, ...] = ()
    rivals: dict[str, float] = field(default_factory=dict)


@dataclass(eq=False)
class Naming:
    """named, strongest first; fit with all of them; first_p: family-wise p-value of the first look; first: the fit without any."""

    first: Refit
    first_p: float
    fit: Refit
    named: list[NamedEffect] = field(default_factory=list)


def probabilities(weighed: Sequence[Hypothesis | Guess]) -> dict[str, float]:
    """Posterior probability of each id, over all hypotheses that were weighed; "" for nothing at all."""
    scores = np.array([h.score for h in weighed])
    weight = np.exp(-(scores - scores.min()) / 2)
    weight /= weight.sum()
    found: dict[str, float] = {}
    for h, w in zip(weighed, weight, strict=True):
        for name in h.ids or ("",):
            found[name] = found.get(name, 0.0) + float(w)
    return {name: min(p, 1.0) for name, p in found.items()}


def rivals_of(weighed: Sequence[Hypothesis | Guess], best: Hypothesis, effect: Effect) -> dict[str, float]:
    """Of every effect that was weighed in an effect's place, -2 log evidence by which it is worse, by id."""
    others = best.ids - {effect.id}
    found: dict[str, float] = {}
    for h in weighed:
        extra = h.ids - others
        if others <= h.ids and len(extra) == 1 and effect.id not in extra:
            (name,) = extra
            found[name] = min(found.get(name, np.inf), h.score - best.score)
    return found
