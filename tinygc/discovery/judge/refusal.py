"""Why a law is not said."""

from __future__ import annotations

from tinygc.discovery.grammar.words import equation
from tinygc.discovery.judge.added import EQUAL
from tinygc.discovery.judge.answer import HeldOut
from tinygc.discovery.judge.rivals import rivals
from tinygc.discovery.judge.searched import Searched
from tinygc.effects import Effect
from tinygc.explanation.naming.naming import STAND_IN

#: searches of which chance makes one as good, at most: benchmarks/discover.py states no law where none is hidden with it
CHANCE = 0.01
#: of chance, that what was put away improves as much: one-sided, as ``explain``'s own veto
HELD_OUT_P = 0.05
#: of the excess over the noise, that laws must take away where what they leave is more than noise.  A law whose rate correlates EQUAL with
#: the truth's leaves 1 - EQUAL^2 of its square; a dozen turns know that share to half.  Stand-ins remove about half
REMOVED = 1 - (1 - EQUAL**2) / 2
#: chance that noise leaves as much as laws leave, below which something is left
NOISE_P = 0.01


def refused(searched: Searched, law: Effect) -> str | None:
    """Why a law of the best hypothesis is not said, or None."""
    best, evidence = searched.best, searched.evidence
    chance_p = searched.round_of(law).chance_p(law)
    if chance_p > CHANCE:
        return f"the best form does no more than chance does in {100 * chance_p:.2g} % of such searches"
    if searched.catalogue.score < best.score + STAND_IN:
        return f"names of the catalogue are of equal worth: {', '.join(sorted(searched.catalogue.ids)) or 'none at all'}"
    name = next(iter(rivals(evidence, best, law, searched.names)), None)
    if name is not None and name.worse < STAND_IN:
        return f"a name of the catalogue is of equal worth beside the rest: {name.effect.id}"
    if evidence.unpriced(searched.shapes) < evidence.unpriced(best) - STAND_IN:
        return f"a shape without a law does better: {', '.join(sorted(searched.shapes.ids))}"
    for test in searched.held_out_of(law):
        if test.p_value > HELD_OUT_P:
            return f"the best form does not hold on what the search never saw (chance improves it as much with p = {test.p_value:.2g})"
    return None


def _takes_too_little(test: HeldOut) -> bool:
    return test.removed is not None and test.removed < REMOVED and test.noise_p < NOISE_P


def leaves_something(searched: Searched) -> bool:
    """Whether the best hypothesis asks for more than a sensor's own noise, or closes what was put away no better than that."""
    return searched.best.noise.unusual or any(_takes_too_little(test) for test in searched.held_out)


def leaves_more(searched: Searched) -> str | None:
    """Why all laws together are not said, or None: what they take away of the excess is too little, and the rest is no noise."""
    for test in searched.held_out:
        if test.removed is not None and _takes_too_little(test):
            said = " and ".join(equation(form) for form in searched.evidence.form_in(searched.best.effects))
            share = f"takes away {100 * test.removed:.0f} % of" if test.removed > 0 else "adds to"
            return f"the best form {share} what is left out, and the rest is no noise: {said}"
    return None
