"""The search over forms beside a hypothesis: screened linearly, sharpened, weighed with the noise anew, refitted exactly."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from tinygc.discovery.grammar.bits import bits
from tinygc.discovery.grammar.form import Form
from tinygc.discovery.judge.believable import believable, takes_calibration
from tinygc.discovery.judge.exact import one_step
from tinygc.discovery.judge.weigh import FormEvidence
from tinygc.discovery.screen.screening import Screening, screened
from tinygc.discovery.screen.sharpen import sharpened_in
from tinygc.effects import Effect
from tinygc.explanation.naming.evidence import Hypothesis
from tinygc.explanation.naming.search import rewhitened
from tinygc.explanation.twin.replay import Replay

#: shapes that are sharpened and weighed by their linear columns, of each look: benchmarks/discover.py finds the law among the first three
#: in nearly all sessions
MOST_SHARPENED = 14
#: most promising forms that are asked, in each look, whether they would take the calibration's place
MOST_ASKED = 60
#: of those, refitted exactly and believed; and tried, where some are not
MOST_EXACT, MOST_TRIED = 4, 12
#: refitted exactly for their promise alone
MOST_PROMISED = 3
#: -2 log evidence within which one more is refitted exactly
NEAR = 12.0
#: -2 log evidence by linear columns, of a form beside a hypothesis
Trial = tuple[float, Effect, Hypothesis]


@dataclass(frozen=True, eq=False)
class Found:
    """best: the hypothesis with a form more, or None; screening: of all forms; tried: effects of forms that were weighed as the one more,
    the best first."""

    best: Hypothesis | None
    screening: Screening
    tried: list[Effect]


def with_a_form(
    evidence: FormEvidence, forms: Sequence[Form], bases: Sequence[Hypothesis], seed: int, progress: Callable[[str], None]
) -> Found:
    """The best hypothesis with one form more than one of the bases has, the likeliest of them last."""
    whitens = [(base, whiten) for base in bases for whiten in (evidence.first_whiten, base.whiten)]
    looks = [(whiten, rewhitened(base, whiten)) for base, whiten in whitens]
    priced = np.array([bits(form) for form in forms])
    screening = screened(Replay(evidence.twin, bases[-1].fit), forms, priced, looks, seed, progress=lambda what, done, of: progress(what))
    progress("sharpening the best forms")
    trials: list[Trial] = []
    promised: dict[str, float] = {}
    for number, (base, _) in enumerate(whitens):
        look, fit = screening.all_looks[number], looks[number][1]
        takes = partial(takes_calibration, responses=screening.all_responses, look=look, fit=fit)
        for at in _first_of_each_shape(forms, screening.promise[number], takes):
            sharp = sharpened_in(forms[at], screening.all_responses, look)
            effect = evidence.effect_of(sharp.form)
            promised[effect.id] = float(screening.tested[at])
            trials.append((evidence.guess(base, add=effect).score, effect, base))
    trials.sort(key=lambda trial: trial[0])
    progress("refitting the best forms exactly")
    trials = _best_of_each_shape(evidence, trials)
    refitted = _refitted(evidence, trials, promised)
    best = min(refitted, key=lambda h: h.score, default=None)
    stood = {effect.id for base in bases for effect in base.effects}
    new = [effect for have in refitted for effect in have.effects if effect.id in evidence.forms and effect.id not in stood]
    return Found(best, screening, list(dict.fromkeys([*new, *(effect for _, effect, _ in trials)])))


def _refitted(evidence: FormEvidence, trials: list[Trial], promised: dict[str, float]) -> list[Hypothesis]:
    """Exactly, with their constants, those that may be the best: by their linear columns with the noise anew, and by what the screening
    promised.  Where a strong law bends the calibration that all begin from, either may be misled."""
    found: list[Hypothesis] = []

    def refit(effect: Effect, base: Hypothesis) -> None:
        weighed = evidence.of((*base.effects, effect), base)
        if believable(weighed, base):
            best = min((have.score for have in found), default=weighed.score)
            found.append(one_step(evidence, weighed, effect, weighed.score - best)[0])

    for score, effect, base in trials[:MOST_TRIED]:
        if len(found) >= MOST_EXACT or (found and score > trials[0][0] + NEAR):
            break
        refit(effect, base)
    for _, effect, base in sorted(trials, key=lambda trial: -promised[trial[1].id])[:MOST_PROMISED]:
        refit(effect, base)
    return found


def _first_of_each_shape(forms: Sequence[Form], promise: np.ndarray, takes_calibration: Callable[[Form], bool]) -> list[int]:
    """Numbers of the most promising forms that leave the calibration its place, of those that differ by their constants alone the first."""
    found: dict[Form, int] = {}
    asked = 0
    for number in np.argsort(-promise, kind="stable"):
        form = forms[number]
        if promise[number] <= 0 or len(found) >= MOST_SHARPENED:
            break
        if form.shape in found:
            continue
        asked += 1
        if asked > MOST_ASKED or not takes_calibration(form):
            found[form.shape] = int(number)
    return list(found.values())


def _best_of_each_shape(evidence: FormEvidence, trials: list[Trial]) -> list[Trial]:
    """Of sorted trials, the first of those that differ by their constants, or by what they stand beside."""
    found: dict[Form, Trial] = {}
    for trial in trials:
        found.setdefault(evidence.forms[trial[1].id].shape, trial)
    return list(found.values())
