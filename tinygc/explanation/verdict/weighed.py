"""What else was weighed, in words that terminal and report share: names and moments that are not borne out, rivals, and the noise."""

from __future__ import annotations

from session.common.units import DEG
from tinygc.explanation.mends.events import LOST
from tinygc.explanation.verdict.claims import Claim, Considered
from tinygc.explanation.verdict.explain import Explanation
from tinygc.explanation.verdict.measured import measured

MOST_SAID = 6  #: of each list, on a page; the JSON has all
#: a name that is less probable is not worth a line
LEAST_CHANCE = 0.01


def chance_words(probability: float) -> str:
    """``0.87``, ``> 0.999`` or ``< 0.001``."""
    return "> 0.999" if probability > 0.999 else "< 0.001" if probability < 0.001 else f"{probability:.3g}"


def considered_lines(e: Explanation) -> list[str]:
    """Moments that a detector proposed and closure refuses, which have no probability of their own, then the likeliest names."""
    told = [each for each in e.considered if each.moments or each.probability >= LEAST_CHANCE]
    return [_considered(each) for each in sorted(told, key=lambda each: each.moments == 0)[:MOST_SAID]]


def _considered(each: Considered) -> str:
    if not each.moments:
        return f"{each.id}: probability {chance_words(each.probability)}"
    if each.closure_rad is None:
        reach, close = ("segment reaches", "closes") if each.moments == 1 else ("segments reach", "close")
        return f"{each.id}: {each.moments} {reach} a level, and {close} like the others"
    before, after = (f"{rad / DEG:.3f}°" for rad in each.closure_rad)
    where = f"{each.id} at {each.moments} {'moment' if each.moments == 1 else 'moments'}: closure there is {before}"
    if before == after:
        return f"{where}, and {'no number of lost samples makes it' if each.id == LOST else 'once mended it is no'} better"
    return f"{where} as recorded, {after} once mended"


def rival_words(claim: Claim) -> list[str]:
    """``gyro.bias_step (0.04)``: what was weighed in a claim's place and is worth a line, likeliest first; what could as well be the cause
    is told apart from them."""
    rivals = sorted(claim.rivals.items(), key=lambda rival: -rival[1])
    shown = [(name, chance) for name, chance in rivals if chance >= LEAST_CHANCE and name not in claim.equivalent]
    return [f"{name} ({chance_words(chance)})" for name, chance in shown[:MOST_SAID]]


def equivalent_words(claim: Claim) -> list[str]:
    """``gyro.bias_step (0.4)``: what could as well be the cause, with its probability where it was weighed."""
    return [f"{name} ({chance_words(claim.rivals[name])})" if name in claim.rivals else name for name in claim.equivalent]


def noise_rows(e: Explanation) -> list[tuple[str, str, str]]:
    """(name, size ± sigma with its unit, what it says) of each component of noise; none where none was estimated."""
    if e.noise is None:
        return []
    return [(c["name"], f"{measured(c['size'], c['sigma'])} {c['unit']}", c["says"]) for c in e.noise.to_json()]
