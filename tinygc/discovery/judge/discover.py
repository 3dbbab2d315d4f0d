"""The search for an equation, from an explanation to an answer.

1. A third of the turns and stills is put away (``parts``); what follows sees the rest alone.
2. The catalogue has its say first: the hypothesis of its effects with the most evidence.
3. All forms of the grammar are screened beside it, and beside nothing at all: a name may have stood in for the law (``search``).
4. The best are sharpened, weighed with the noise estimated anew, and refitted exactly, the constants of the best, too (``exact``); names
   that the law has made idle go.
5. A second law may stand beside the first.
6. Each law is judged (``verdict``); what is left is refitted on all that was recorded.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from tinygc.discovery.grammar.enumeration import enumerated
from tinygc.discovery.grammar.largest import largest_of
from tinygc.discovery.judge.answer import Discovery
from tinygc.discovery.judge.exact import exact
from tinygc.discovery.judge.held_out import Unseen
from tinygc.discovery.judge.parts import FEWEST, parted
from tinygc.discovery.judge.refusal import leaves_something, refused
from tinygc.discovery.judge.rivals import rivals
from tinygc.discovery.judge.search import Found, with_a_form
from tinygc.discovery.judge.searched import Searched
from tinygc.discovery.judge.verdict import answer
from tinygc.discovery.judge.weigh import FormEvidence
from tinygc.effects import Effect
from tinygc.explanation.naming.candidates import candidates
from tinygc.explanation.naming.evidence import Hypothesis
from tinygc.explanation.naming.search import exchanged, search, without_idle
from tinygc.explanation.naming.unknown import slow_candidates
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.verdict.explain import Explanation

#: laws of one answer: each is a pass over all forms
MOST_LAWS = 2
#: names that a law may uncover
MOST_NAMES = 2
#: forms that take a law's place, one after the other
MOST_EXCHANGES = 3
#: shapes without a name that are tried in the place of a law
MOST_SHAPES = 2
#: what is told of progress: steps of the whole
STEPS = 7


def discover(
    explanation: Explanation,
    *,
    seed: int = 0,
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
) -> Discovery:
    """Search a session's remainder for the equation that was left out; the explanation says what its catalogue names.

    seed: of what is put away, and of what chance draws.
    """
    whole = explanation.twin
    if len(whole.segments) < 3 * FEWEST:
        few = f"a third of {len(whole.segments)} turns is too few to judge an equation by: record {3 * FEWEST} or more"
        return Discovery("none", few, (), (), forms=0, distinct=0, chance_promise=0.0, best_promise=0.0)
    split = parted(whole.problem, seed)
    twin = Twin(split.seen)
    progress("discover: the catalogue on what is seen", 0, STEPS)
    evidence, tried = FormEvidence(twin), candidates(twin)
    # What is named, but for those whose shape, as the moment of a step, has been found with the turns that are put away.
    named = [one.effect for one in explanation.naming.named if one.effect.scan is None]
    begin = evidence.of(tuple(named), evidence.nothing)
    start = min(begin, evidence.nothing, key=lambda h: h.score)
    catalogue = exchanged(evidence, tried, search(evidence, tried, start))
    shapes = search(evidence, slow_candidates(twin), catalogue, most=MOST_SHAPES)
    forms = enumerated(largest_of(twin.movements))
    bases = [evidence.nothing, catalogue] if catalogue.effects else [catalogue]
    rounds: list[Found] = []
    searched = Searched(evidence, Unseen(whole, twin), split, tried, catalogue, shapes, catalogue, rounds, {}, forms)
    while len(rounds) < MOST_LAWS:
        step = 1 + 2 * len(rounds)
        found = with_a_form(evidence, forms, bases, seed, _told(progress, step))
        rounds.append(found)
        if found.best is None or found.best.score >= searched.best.score:
            break
        progress("discover: refitting the constants", step, STEPS)
        further = _exactly(searched, _settled(evidence, tried, found, searched.laws))
        why = next((why for law in further.laws if (why := refused(further, law))), None)
        if why is not None:
            searched = replace(searched, why=searched.why or why)
            break
        searched = further
        if not leaves_something(searched):
            break
        bases = [searched.best]
    return answer(explanation, searched, lambda what: progress(f"discover: {what}", STEPS - 1, STEPS))


def _told(progress: Callable[[str, int, int], None], step: int) -> Callable[[str], None]:
    return lambda what: progress(f"discover: {what}", step, STEPS)


def _exactly(searched: Searched, have: Hypothesis) -> Searched:
    """With all laws of a hypothesis, their constants where it is most probable; what is new among them the last round has brought."""
    evidence, last, entered = searched.evidence, len(searched.rounds) - 1, dict[str, int]()
    for law in [effect for effect in have.effects if effect.id in evidence.forms]:
        have, own = exact(evidence, have, law)
        entered[own.id] = searched.entered.get(law.id, last)
    return replace(searched, best=have, entered=entered)


def _settled(evidence: FormEvidence, tried: list[Effect], found: Found, before: list[Effect]) -> Hypothesis:
    """The laws with the catalogue's effects that stand beside them: those that they have made idle go, those that they uncovered come.  Of
    forms that linear columns have misjudged the best takes the law's place; before: laws of earlier rounds, which stay."""
    assert found.best is not None
    have = without_idle(evidence, found.best)
    have = without_idle(evidence, exchanged(evidence, tried, search(evidence, tried, have, most=MOST_NAMES)))
    for _ in range(MOST_EXCHANGES):
        law = next((effect for effect in have.effects if effect.id in evidence.forms and effect not in before), None)
        if law is None:
            break
        nearest = next((rival for rival in rivals(evidence, have, law, found.tried) if rival.hypothesis is not None), None)
        if nearest is None or nearest.hypothesis is None or nearest.worse >= 0:
            break
        have = without_idle(evidence, nearest.hypothesis)
    return have
