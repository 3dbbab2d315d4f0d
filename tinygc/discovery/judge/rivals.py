"""Which forms and names could stand in the law's place, by how much they are worse, and whether they add another rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.discovery.judge.added import added, beside_calibration, correlation
from tinygc.discovery.judge.believable import believable
from tinygc.discovery.judge.exact import one_step
from tinygc.discovery.judge.weigh import FormEvidence
from tinygc.effects import Effect
from tinygc.explanation.naming.evidence import Hypothesis
from tinygc.explanation.naming.naming import STAND_IN
from tinygc.explanation.twin.twin import Twin

#: -2 log evidence within which a rival is worth refitting exactly, beyond what is said: linear columns may misjudge it by as much
MARGIN = 6.0
#: refitted exactly, at most; more that come near are rivals of unknown rate
MOST_EXACT = 12


@dataclass(frozen=True, eq=False)
class Rival:
    """effect in the law's place; hypothesis with it, None where only its linear columns were weighed; worse: -2 log evidence; fits_worse:
    the same, had neither paid for its description; correlation of the whole rate that is added with the law's hypothesis', 0 where it is
    unknown."""

    effect: Effect
    hypothesis: Hypothesis | None
    worse: float
    fits_worse: float
    correlation: float

    @property
    def nearest(self) -> float:
        """How much worse it is by whichever is less: bits may decide what to search, and no more."""
        return min(self.worse, self.fits_worse)


def rivals(evidence: FormEvidence, best: Hypothesis, law: Effect, others: list[Effect]) -> list[Rival]:
    """Of the others, those that were weighed in the place of ``law`` and come nearest, the best first."""
    rest = [other for other in others if other.id != law.id and other.id not in best.ids]
    fits = evidence.unpriced(best)
    guessed = [evidence.guess(best, without=law, add=other) for other in rest]
    nearest = [min(guess.score - best.score, evidence.unpriced(guess) - fits) for guess in guessed]
    own, found = whole_added(evidence.twin, best), list[Rival]()
    for place, number in enumerate(np.argsort(nearest, kind="stable")):
        other, weighed, hypothesis, alike = rest[number], guessed[number], None, 0.0
        if place < MOST_EXACT and nearest[number] < STAND_IN + MARGIN:
            effects = (*(effect for effect in best.effects if effect is not law), other)
            weighed = evidence.of(effects, best)
            if not believable(weighed, best):
                continue
            if other.id in evidence.forms:  # the law's own constants are as good as can be: so must be a rival's
                lacking = min(weighed.score - best.score, evidence.unpriced(weighed) - fits) - STAND_IN
                weighed, other = one_step(evidence, weighed, other, lacking)
            hypothesis = weighed
            alike = correlation(own, whole_added(evidence.twin, hypothesis))
        found.append(Rival(other, hypothesis, weighed.score - best.score, evidence.unpriced(weighed) - fits, alike))
    return sorted(found, key=lambda rival: rival.worse)


def whole_added(twin: Twin, hypothesis: Hypothesis) -> np.ndarray:
    """(N, 3) rad/s that all effects of a hypothesis add to the rate, beside what a calibration takes up."""
    movements = twin.movements
    total = np.zeros((sum(len(movement.t_s) for movement in movements), 3))
    for claim in hypothesis.fit.state.claims:
        if claim.effect.kind == "rate":
            total += added(claim.effect, claim.theta, movements)
    return beside_calibration(total, movements)
