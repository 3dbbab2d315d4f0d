"""What of a search is said: which laws stand, and what else each could be."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tinygc.discovery.grammar.as_effect import as_effect
from tinygc.discovery.grammar.bits import bits
from tinygc.discovery.grammar.form import Form
from tinygc.discovery.grammar.words import constant_of, equation, splits, what
from tinygc.discovery.judge.added import EQUAL
from tinygc.discovery.judge.answer import Beside, Discovery, HeldOut, Law, RunnerUp
from tinygc.discovery.judge.axes import differing
from tinygc.discovery.judge.exact import Constants, exact
from tinygc.discovery.judge.refusal import ALL_OF_IT, CHANCE, MOST_OF_IT, taken
from tinygc.discovery.judge.rivals import Rival, rivals
from tinygc.discovery.judge.search import Found
from tinygc.discovery.judge.searched import Searched
from tinygc.discovery.judge.weigh import FORM, FormEvidence, rms_of
from tinygc.discovery.screen.by_axis import ByAxis
from tinygc.discovery.screen.learnable import learnable, learnable_from
from tinygc.effects import Effect, catalogue
from tinygc.explanation.naming.evidence import Hypothesis
from tinygc.explanation.naming.naming import STAND_IN
from tinygc.explanation.twin.layout import claim_slice
from tinygc.explanation.verdict.explain import Explanation
from tinygc.explanation.verdict.readable import readable

#: chi-square that a law must take up to be told from any other whose added rate correlates less than EQUAL with its own: that much of it
#: the other would leave, whether the grammar can say the other or not
DECISIVE = STAND_IN / (1 - EQUAL**2)
#: sigmas, one-sided, that a chi-square's root is below its mean in one case of twenty: what ``learnable.SURE`` of cases have
SURE_SIGMAS = 1.645
#: runners-up that are told
MOST_RUNNERS_UP = 4


@dataclass(frozen=True, eq=False)
class _Judged:
    """One law of the best hypothesis; others: rivals that add another rate, same: those that add the same; axes: its constants, where
    those of the axes differ."""

    law: Effect
    form: Form
    round: Found
    better: float
    chance_p: float
    held_out: tuple[HeldOut, ...]
    others: list[Rival]
    same: list[Rival]
    axes: ByAxis | None


def answer(explanation: Explanation, searched: Searched, progress: Callable[[str], None]) -> Discovery:
    """The answer of a search."""
    first = searched.rounds[0].screening
    common: dict[str, Any] = {
        "forms": len(searched.forms),
        "distinct": first.distinct,
        "chance_promise": first.chance.level(0.05),
        "best_promise": first.best_beside_last,
    }
    share = taken(searched)
    if not searched.laws or share < MOST_OF_IT:
        progress("what could have been found")
        names = _beside(searched.catalogue)
        beside = f", beside {', '.join(name.id for name in names)}" if names else ""
        none = f"refitted exactly{beside}, no form makes the recording as much more probable as its description costs"
        why = _too_little(searched, share) or searched.why or none
        # Of chi-square, what the turns that are screened have of it.
        screened = len(first.responses.segments) / len(explanation.twin.segments)
        limits = learnable(first, CHANCE, DECISIVE * screened)
        return Discovery("none", why, (), names, learnable=limits, **common)
    progress("rivals")
    judged = [_judged(searched, law) for law in searched.laws]
    whole = _on_all(explanation, searched)
    names = _beside(whole.have, frozenset(whole.evidence.forms))
    progress("from what size it could have been found")
    ids = list[str]()
    for each in judged:
        ids.append(_free_id(each.form, ids))
    laws = tuple(_law(searched, each, whole, ids, number) for number, each in enumerate(judged))
    why = _undecided(judged, laws, share)
    return Discovery("ambiguous" if why else "found", why, laws, names, **common)


def _too_little(searched: Searched, share: float) -> str:
    """Why the laws that stand are not said, if there are any."""
    said = " and ".join(equation(form) for form in searched.evidence.form_in(searched.best.effects))
    return f"{said} takes away {100 * share:.0f} % of what is left out, and the rest is no noise" if said else ""


def _undecided(judged: list[_Judged], laws: tuple[Law, ...], share: float) -> str:
    """Why the laws are not found and no more is said than which they could be; empty where they are."""
    several = next((each for each in judged if each.others), None)
    if several is not None:
        return f"{len(several.others) + 1} forms of equal worth add different rates"
    for each in judged:
        if each.axes is not None:
            return _by_axis(each.form, each.axes)
    faint = min(laws, key=lambda law: law.gain)
    if faint.gain < DECISIVE:
        return (
            f"too little is seen of it to tell it from an equation that nobody has thought of: chi-square {faint.gain:.0f}, "
            f"and {DECISIVE:.0f} would tell it from all that add less than {100 * EQUAL:.0f} % the same rate"
        )
    if share < ALL_OF_IT:
        rest = "the rest is no noise: a near relative of it is left out, or something else beside it"
        return f"{100 * share:.1f} % of the excess goes with it, and {rest}"
    return ""


def _by_axis(form: Form, axes: ByAxis) -> str:
    word, own = constant_of(form, axes.constant)
    values = ", ".join(f"{value:.3g}" for value in axes.values * own)
    return f"its {word} seems to differ by axis ({values}; chi-square {axes.more:.0f}), and one for all makes another rate of it"


def _judged(searched: Searched, law: Effect) -> _Judged:
    evidence, best, round_ = searched.evidence, searched.best, searched.round_of(law)
    without = searched.without(law)
    weighed = sorted(rivals(evidence, best, law, searched.tried), key=lambda rival: rival.nearest)
    near = [rival for rival in weighed if rival.nearest < STAND_IN]
    return _Judged(
        law,
        evidence.forms[law.id],
        round_,
        without.score - best.score,
        searched.chance_p(law),
        searched.held_out_of(law),
        [rival for rival in near if rival.correlation <= EQUAL],
        [rival for rival in near if rival.correlation > EQUAL],
        differing(searched, law),
    )


@dataclass(frozen=True, eq=False)
class _Whole:
    """What was judged, refitted on all that was recorded: laws in the order of the judged, their constants for all."""

    evidence: FormEvidence
    have: Hypothesis
    laws: list[Effect]


def _on_all(explanation: Explanation, searched: Searched) -> _Whole:
    evidence = FormEvidence(explanation.twin)
    laws = [evidence.effect_of(searched.evidence.forms[law.id]) for law in searched.laws]
    names = [effect for effect in searched.best.effects if effect not in searched.laws]
    have = evidence.of((*names, *laws), evidence.nothing)
    for number, law in enumerate(laws):
        have, laws[number] = exact(evidence, have, law)
    return _Whole(evidence, have, laws)


def _beside(have: Hypothesis, laws: frozenset[str] = frozenset()) -> tuple[Beside, ...]:
    """The catalogue's effects of a hypothesis."""
    claims = [(number, claim) for number, claim in enumerate(have.fit.state.claims) if claim.effect.id not in laws]
    return tuple(Beside(claim.effect.id, *readable(claim, have.fit.theta_covariance(number))[1:]) for number, claim in claims)


def _free_id(form: Form, taken: Sequence[str]) -> str:
    """``discovered.…``, with the first number that no other has, where the name alone is one of the catalogue's or of those taken."""
    name, number, others = f"{FORM}{what(form)}", 1, {*catalogue(), *taken}
    while (found := name if number == 1 else f"{name}_{number}") in others:
        number += 1
    return found


def _law(searched: Searched, judged: _Judged, whole: _Whole, ids: list[str], number: int) -> Law:
    evidence, own = searched.evidence, whole.laws[number]
    form, fit = whole.evidence.forms[own.id], whole.have.fit
    at = next(i for i, effect in enumerate(whole.have.effects) if effect is own)
    theta, part = fit.state.claims[at].theta, claim_slice(fit.state.claims, at)
    held, constants = fit.covariance, Constants.of(whole.evidence.twin, whole.have, own, form) if form.constants else None
    covariance = (held if constants is None else constants.widened(held))[part, part]
    sigmas = () if constants is None else constants.sigmas(form)
    gain = float(theta @ np.linalg.solve(held[part, part], theta))
    shown = learnable_from(judged.round.screening, form, theta, CHANCE, searched.best.whiten)
    effect = as_effect(form, ids[number], rms_of(form, evidence.twin.movements), equation(form))
    return Law(
        form,
        effect,
        theta,
        covariance,
        sigmas,
        bits(form),
        gain,
        judged.better,
        judged.chance_p,
        judged.held_out,
        _same(judged, evidence),
        tuple(_runner_up(evidence, rival, ids) for rival in judged.others[:MOST_RUNNERS_UP]),
        None if shown is None or gain <= 0 else max(shown, float((np.sqrt(DECISIVE) + SURE_SIGMAS) / np.sqrt(gain))),
    )


def _same(judged: _Judged, evidence: FormEvidence) -> tuple[Form, ...]:
    """Forms that this recording cannot tell from the law: by their columns, or by the rate that they add where they are weighed."""
    weighed = [evidence.forms[rival.effect.id] for rival in judged.same if rival.effect.id in evidence.forms]
    found: dict[Form, Form] = {}  # of those that differ by their constants alone the first
    for form in [*judged.round.screening.same_as(judged.form), *weighed]:
        if form.shape != judged.form.shape:
            found.setdefault(form.shape, form)
    return tuple(found.values())


def _runner_up(evidence: FormEvidence, rival: Rival, ids: list[str]) -> RunnerUp:
    form = evidence.forms.get(rival.effect.id)
    if form is None:
        return RunnerUp(None, rival.effect, rival.nearest, rival.correlation, rival.effect.splits)
    effect = replace(rival.effect, id=_free_id(form, ids), equation=equation(form), splits=splits(form))
    return RunnerUp(form, effect, rival.nearest, rival.correlation, splits(form))
