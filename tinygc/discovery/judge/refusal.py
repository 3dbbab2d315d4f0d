"""Why a law is not said."""

from __future__ import annotations

from tinygc.discovery.grammar.words import equation
from tinygc.discovery.judge.added import EQUAL
from tinygc.discovery.judge.rivals import rivals
from tinygc.discovery.judge.searched import NOISE_P, Searched
from tinygc.effects import Effect
from tinygc.explanation.naming.naming import STAND_IN

#: searches of which chance makes one as good, at most: benchmarks/discover.py states no law where none is hidden with it
CHANCE = 0.01
#: of chance, that what was put away improves as much: one-sided, as ``explain``'s own veto
HELD_OUT_P = 0.05
#: of the excess over the noise, that laws must take away to be said where what they leave is more than noise: stand-ins take about half
MOST_OF_IT = 0.9
#: and to be found.  A law whose rate correlates EQUAL with the truth's leaves 1 - EQUAL^2 of its square; a dozen turns
#: know that share to half
ALL_OF_IT = 1 - (1 - EQUAL**2) / 2


def refused(searched: Searched, law: Effect) -> str | None:
    """Why a law of the best hypothesis is not said, or None."""
    best, evidence = searched.best, searched.evidence
    chance_p, said = searched.chance_p(law), equation(evidence.forms[law.id])
    if chance_p > CHANCE:
        return f"the best form does no more than chance does in {100 * chance_p:.2g} % of such searches: {said}"
    if searched.catalogue.score < best.score + STAND_IN:
        names = ", ".join(sorted(searched.catalogue.ids))
        return f"on the turns that were searched {names} is of equal worth" if names else "noise alone explains the turns searched as well"
    if searched.without(law).score < best.score + STAND_IN:
        return f"the rest explains the turns that were searched as well without it: {said}"
    name = next(iter(rivals(evidence, best, law, searched.names)), None)
    if name is not None and name.worse < STAND_IN:
        return f"on the turns that were searched {name.effect.id} is of equal worth beside the rest: {said}"
    if evidence.unpriced(searched.shapes) < evidence.unpriced(best) - STAND_IN:
        return f"a shape without a law does better: {', '.join(sorted(searched.shapes.ids))}"
    for test in searched.held_out_of(law):
        if test.removed is not None and test.removed <= 0:
            return f"the best form makes what the search never saw close worse: {said}"
        if test.p_value > HELD_OUT_P:
            return f"chance improves what the search never saw as much as the best form does, with p = {test.p_value:.2g}: {said}"
    return None


def leaves_something(searched: Searched) -> bool:
    """Whether a further law is asked for; what was put away has no part in it, as it is to judge that law, too."""
    return searched.best.noise.unusual or not searched.closes_to_noise


def taken(searched: Searched) -> float:
    """The least share of the excess that a law takes away of what was put away; one where what is left is the sensor's own noise."""
    tests = [test.removed for test in searched.held_out if test.removed is not None and test.noise_p < NOISE_P]
    return min(tests, default=1.0)
