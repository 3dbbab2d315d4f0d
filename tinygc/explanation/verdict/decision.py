"""Detect, name, refuse: what a recording shows, in the one way in which `explain` says it and `fit --physics auto` takes it over."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats

from tinygc.effects import Effect
from tinygc.explanation.naming.candidates import candidates, selection_of
from tinygc.explanation.naming.evidence import Evidence, Hypothesis
from tinygc.explanation.naming.naming import STAND_IN, NamedEffect, Naming, probabilities, rivals_of
from tinygc.explanation.naming.search import exchanged, guesses, search
from tinygc.explanation.naming.selection import FAMILY_WISE
from tinygc.explanation.naming.unknown import NAMELESS, slow_candidates, unknown_candidates
from tinygc.explanation.noise.session_noise import SessionNoise
from tinygc.explanation.twin.layout import claim_slice
from tinygc.explanation.twin.refit import Refit, refit
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.part_of_a_curve import part_of_a_curve
from tinygc.explanation.verdict.proof import held_out, linear_held_out, tilt_rms
from tinygc.explanation.verdict.undersampled import undersampled_claim
from tinygc.explanation.verdict.veto import borne_out

#: a name is said if it, with what could stand in for it, is more probable than not
SAID = 0.5
#: -2 log evidence within which one shape alone is worth weighing instead of all names: a second one may add to it
INSTEAD = 60.0
#: false alarms of noise that is no sensor's: a fifth of what the shapes are allowed (benchmarks/null_sessions.py)
UNUSUAL_P = 0.01
MOST_FINDINGS = 2  #: shapes without a name beside the names: that a page holds


@dataclass(frozen=True, eq=False)
class NamingDecision:
    """naming: the names that are kept, with the fit; beyond: shapes without a name; considered: names that were weighed and are not
    borne out, with their probability; whiten and noise: the covariance of all that; undersampled: the claim about the turns' own noise;
    unusual: whether the rest of that noise is no sensor's; p_value of the detection; before (S, d) rad: the linear model's held-out
    angles, where anything is kept."""

    naming: Naming
    beyond: list[NamedEffect]
    considered: dict[str, float]
    whiten: Whitener
    noise: SessionNoise
    p_value: float
    undersampled: list[Claim]
    unusual: bool
    before: np.ndarray | None = None

    @property
    def refused(self) -> bool:
        """There is a mismatch, and no name for it."""
        return not self.naming.named and not self.undersampled and (self.p_value <= FAMILY_WISE or self.unusual)


def decide(
    twin: Twin,
    seed: int,
    progress: Callable[[str], None] = lambda what: None,
    begin: tuple[Effect, ...] = (),
    odds: Mapping[str, float] | None = None,
) -> NamingDecision:
    """Weigh the catalogue's effects against each other, against shapes without a name, and against nothing.

    begin: effects that a part of the recording has asked for already, where the search may begin; odds: of those that a lot has, by id.
    """
    evidence, tried = Evidence(twin, odds), candidates(twin)
    progress("detecting")
    first_p = selection_of(twin, evidence.nothing.whiten, evidence.nothing.fit, tried, seed).p_value(evidence.nothing.fit.r)
    start = min(evidence.nothing, evidence.of(begin, evidence.nothing), key=lambda h: h.score)
    best = search(evidence, tried, start, progress=progress)
    progress("lookalikes")
    best = exchanged(evidence, tried, best)
    progress("beyond the catalogue")
    best = _beyond(evidence, tried, best, first_p)
    return decided(evidence, best, first_p, len({effect.id for effect in tried}))


def _beyond(evidence: Evidence, tried: list[Effect], best: Hypothesis, first_p: float) -> Hypothesis:
    """Shapes without a name, beside the names and in their place; the lines among them, of which there are hundreds, only where something
    is left that nothing else takes up."""
    shapes = slow_candidates(evidence.twin)
    ahead = search(evidence, shapes, best, most=MOST_FINDINGS)
    if best.effects and any(g.score < ahead.score + INSTEAD for g in guesses(evidence, shapes, evidence.nothing)[:1]):
        ahead = min(ahead, search(evidence, shapes, evidence.nothing, most=MOST_FINDINGS), key=lambda h: h.score)
    if ahead.noise.unusual or (not ahead.effects and first_p < FAMILY_WISE):
        ahead = search(evidence, unknown_candidates(evidence.twin), ahead, most=1)
    if any(effect.id.startswith(NAMELESS) for effect in ahead.effects):
        # A name that stood for a part of what the shape describes may go, another come.
        ahead = exchanged(evidence, tried, search(evidence, tried, exchanged(evidence, tried, ahead), most=MOST_FINDINGS))
    return ahead


def decided(evidence: Evidence, best: Hypothesis, first_p: float, tests: int) -> NamingDecision:
    """What of the best hypothesis is said."""
    twin, weighed = evidence.twin, evidence.weighed
    chance = probabilities(weighed)
    named = [_named(evidence, best, number, chance, tests) for number in range(len(best.effects))]
    kept = [
        n
        for number, n in enumerate(named)
        if n.probability + sum(n.rivals[name] for name in n.equivalent) >= SAID
        and borne_out(evidence, best, number)
        and not part_of_a_curve(evidence, best, number)
    ]
    fit = best.fit if len(kept) == len(best.effects) else _refitted(twin, best, kept)
    before = linear_held_out(twin.problem, twin, best.whiten) if kept and twin.stills else None
    if before is not None:
        kept, fit = _no_worse(twin, best, kept, fit, tilt_rms(before))
    if not kept:  # all is judged against the noise that there is without any of them
        best, fit, before = evidence.nothing, evidence.nothing.fit, None
    names = [n for n in kept if not n.effect.id.startswith(NAMELESS)]
    ids = {n.effect.id for n in kept}
    # What is vetoed may fit the segments that were seen: it is no more probable than not.
    considered = {name: min(p, SAID) for name, p in chance.items() if name and name not in ids and not name.startswith(NAMELESS)}
    first = refit(twin, best.whiten, [], twin.start())
    r, J = best.whiten.back(fit.r), best.whiten.back(fit.J) * evidence.prior(fit)
    noise = best.noise.estimated(best.whiten, r, J, best.noise.s, with_sigma=True)
    undersampled = undersampled_claim(twin, best.whiten, fit, noise)
    p_value = min([first_p, *(n.p_value for n in kept), *(claim.p_value for claim in undersampled)])
    unusual = noise.unusual_p(best.whiten, r, J) < UNUSUAL_P
    naming = Naming(first, first_p, fit, sorted(names, key=lambda n: -n.gain))
    beyond = [n for n in kept if n not in names]
    return NamingDecision(naming, beyond, considered, best.whiten, noise, p_value, undersampled, unusual, before)


def _refitted(twin: Twin, best: Hypothesis, kept: list[NamedEffect]) -> Refit:
    return refit(twin, best.whiten, [n.effect for n in kept], best.fit.state)


def _no_worse(twin: Twin, best: Hypothesis, kept: list[NamedEffect], fit: Refit, before: float) -> tuple[list[NamedEffect], Refit]:
    """What closes the segments that the fit never saw no worse than the linear model does, ``before`` rad; what takes up
    least goes first."""
    # What lives in the stills alone is judged there.
    while turning := [n for n in kept if "turn" in n.effect.seen_in]:
        if tilt_rms(held_out(twin, best.whiten, fit)) <= before:
            break
        kept = [n for n in kept if n is not min(turning, key=lambda n: n.gain)]
        fit = _refitted(twin, best, kept)
    return kept, fit


def _named(evidence: Evidence, best: Hypothesis, number: int, chance: dict[str, float], tests: int) -> NamedEffect:
    effect = best.effects[number]
    gain = _wald(best.fit, number)
    freedom = effect.parameter.size + (effect.scan is not None)
    p_value = min(1.0, tests * float(stats.chi2.sf(gain, freedom)))
    rivals = rivals_of(evidence.weighed, best, effect)
    return NamedEffect(
        effect,
        p_value,
        gain,
        chance[effect.id],
        tuple(name for name, worse in rivals.items() if worse < STAND_IN),
        {name: chance[name] for name in rivals},
    )


def _wald(fit: Refit, number: int) -> float:
    """Chi-square of a claim's parameters against none."""
    part = claim_slice(fit.state.claims, number)
    theta = fit.state.claims[number].theta
    return float(theta @ np.linalg.solve(fit.covariance[part, part], theta))
