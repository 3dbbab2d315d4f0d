"""What is named beside a truth file: the catalogue's rate effects, the truth's clock and a wandering bias, weighed as for any recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from tinygc.effects import AppliedEffect, Effect
from tinygc.explanation.naming.candidates import candidates, selection_of
from tinygc.explanation.naming.evidence import PRIOR_ODDS, Evidence, Hypothesis
from tinygc.explanation.naming.naming import STAND_IN, NamedEffect, Naming
from tinygc.explanation.naming.search import exchanged, search
from tinygc.explanation.naming.unknown import NAMELESS
from tinygc.explanation.noise.components import WANDER
from tinygc.explanation.truth.truth_effects import OFFSET, common_delays, wander
from tinygc.explanation.truth.truth_explanation import TruthClaim
from tinygc.explanation.truth.truth_twin import TruthTwin
from tinygc.explanation.twin.common_delay import in_gauge
from tinygc.explanation.twin.refit import Refit, refit
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener
from tinygc.explanation.verdict.decision import NamingDecision, decided
from tinygc.explanation.verdict.proof import FOLD_STEPS, fold_rows, folds_of
from tinygc.models.linear import PARAMETERS
from tinygc.problem.problem import Problem

WANDER_S = 20.0  #: between knots: a shape, whose number of knots is priced by the evidence


@dataclass(frozen=True, eq=False)
class TruthNames:
    """claims, strongest first; refused: what would fit, at a size that no gyroscope has; the decision, with p-value, noise and what was
    considered; before and after: each segment's closure (S, 3) rad; held_out (S, 3) rad of each, of segments that the fit did not see;
    excess, chi-square per degree of freedom over what is stated, before and after; p_value of the detection; evidence: all that was
    weighed; fit: the last, with the clock beside what delays."""

    claims: list[TruthClaim]
    refused: list[TruthClaim]
    decision: NamingDecision
    angles: tuple[np.ndarray, np.ndarray]
    held_out: tuple[np.ndarray, np.ndarray]
    excess: tuple[float, float]
    p_value: float
    evidence: Evidence
    fit: Refit

    @property
    def named(self) -> tuple[Effect, ...]:
        """What has a name, of what the last fit holds."""
        return tuple(claim.effect for claim in self.decision.naming.fit.state.claims if not claim.effect.id.startswith(NAMELESS))


def name_beside_truth(problem: Problem, seed: int, progress: Callable[[str], None] = lambda what: None) -> TruthNames:
    """Weigh what can be tried; a name at a size that no gyroscope has is refused, and the rest weighed anew without it."""
    twin = TruthTwin(problem)
    slow, evidence = _slow_bias(twin), Evidence(twin)
    tried = [*(effect for effect in candidates(twin) if effect.kind == "rate"), OFFSET, slow]
    tried = [effect for effect in tried if np.isfinite(columns := evidence.columns(effect)).all() and columns.any()]
    first_p = selection_of(twin, evidence.nothing.whiten, evidence.nothing.fit, tried, seed).p_value(evidence.nothing.fit.r)
    refused: list[TruthClaim] = []
    while True:
        best = _best(evidence, tried, slow, progress)
        decision = _with_slow_bias(evidence, tried, slow, decided(evidence, best, first_p, len({effect.id for effect in tried})))
        claims = _claims(decision, decision.naming.fit)
        wrong = [claim for claim in claims if claim.implausible]
        if not wrong:
            break
        ids = frozenset(claim.effect.id for claim in wrong)
        refused += wrong
        tried = [effect for effect in tried if effect.id not in ids]
        evidence.forget(ids)
    first, last = decision.naming.first, beside_clock(twin, decision.whiten, decision.naming.fit)
    angles = twin.residuals(first.state).closure, twin.residuals(last.state).closure
    return TruthNames(
        _claims(decision, last),
        refused,
        decision,
        angles,
        (held_out(twin, decision.whiten, first), held_out(twin, decision.whiten, last)),
        (excess_of(problem, angles[0], 0), excess_of(problem, angles[1], sum(len(claim.theta) for claim in claims))),
        decision.p_value,
        evidence,
        last,
    )


def beside_clock(twin: Twin, whiten: Whitener, fit: Refit) -> Refit:
    """The fit with the truth's clock beside effects that delay, unless it was given: it has what all axes' delays share."""
    effects = [claim.effect for claim in fit.state.claims]
    if twin.clock_free and OFFSET not in effects and any(effect.id in common_delays() for effect in effects):
        fit = refit(twin, whiten, [OFFSET, *effects], fit.state)
    return in_gauge(twin, whiten, fit)


def _slow_bias(twin: TruthTwin) -> Effect:
    """A wander, which is no name: but what has none must not pass for one of the names."""
    duration, segments = float(twin.problem.began_s[-1]), len(twin.segments)
    return wander(np.linspace(0, duration, max(3, min(round(duration / WANDER_S) + 1, segments // 6))))


def _best(evidence: Evidence, tried: list[Effect], slow: Effect, progress: Callable[[str], None]) -> Hypothesis:
    """From nothing, and from a slow bias: names that stand for parts of one are found first, and it has no place beside them then."""
    evidence.will_try(tried)
    begins = [evidence.nothing, *([evidence.of((slow,), evidence.nothing)] if slow in tried else [])]
    best = exchanged(evidence, tried, min((search(evidence, tried, begin, progress=progress) for begin in begins), key=lambda h: h.score))
    if slow.id in best.ids:
        return best
    # Several names where one and a slow bias do nearly as well are too many: a wrong name is worse than none.
    instead = [h for h in evidence.exact if slow.id in h.ids and len(h.ids) <= len(best.ids) and h.score < best.score + STAND_IN]
    return min([*instead, best], key=lambda h: (len(h.ids - {slow.id}), h.score))


def _with_slow_bias(evidence: Evidence, tried: list[Effect], slow: Effect, decision: NamingDecision) -> NamingDecision:
    """A wander that nothing is known of beforehand, and that is more probable than none, is a finding: it is drawn and said as a slow bias,
    not left among the noise.  Names that a line between its knots makes idle go."""
    naming = decision.naming
    names = tuple(claim.effect for claim in naming.fit.state.claims)
    if evidence.twin.problem.instability.rps > 0 or slow not in tried or slow.id in {effect.id for effect in names}:
        return decision
    begin, steady = evidence.of(names, evidence.nothing), evidence.without(WANDER)
    odds = (steady.of(names, steady.nothing).score - begin.score) / 2 + np.log(PRIOR_ODDS)
    if odds < 0:
        return decision
    best = steady.of((*names, slow), begin)
    for effect in names:
        fewer = steady.of(tuple(other for other in best.effects if other is not effect), best)
        best = min(best, fewer, key=lambda h: h.score)
    kept, fit = {effect.id for effect in best.effects}, best.fit
    shape = _said(fit, slow, float(1 / (1 + np.exp(-odds))))
    first = refit(evidence.twin, best.whiten, [], evidence.twin.start())
    naming = Naming(first, naming.first_p, fit, [each for each in naming.named if each.effect.id in kept])
    p_value = min(decision.p_value, shape.p_value)
    return replace(decision, naming=naming, beyond=[shape], whiten=best.whiten, noise=best.noise, p_value=p_value)


def _said(fit: Refit, effect: Effect, probability: float) -> NamedEffect:
    number = [claim.effect.id for claim in fit.state.claims].index(effect.id)
    theta = fit.state.claims[number].theta
    gain = float(theta @ np.linalg.solve(fit.theta_covariance(number), theta))
    return NamedEffect(effect, float(stats.chi2.sf(gain, len(theta))), gain, probability)


def _claims(decision: NamingDecision, fit: Refit) -> list[TruthClaim]:
    """Of a decision, with the numbers of a fit with its names."""
    naming = decision.naming
    numbers = {claim.effect.id: number for number, claim in enumerate(fit.state.claims)}
    claims = [
        _claim(fit, numbers[each.effect.id], each, naming.first.chi_square)
        for each in sorted(naming.named + decision.beyond, key=lambda each: -each.gain)
    ]
    return [replace(c, equivalent=common_delays()) if c.effect.kind == "truth" else c for c in claims]


def _claim(fit: Refit, number: int, named: NamedEffect, chi_square: float) -> TruthClaim:
    claim, sigma = fit.state.claims[number], np.sqrt(np.diag(fit.theta_covariance(number)))
    share = float(np.clip(named.gain / chi_square, 0, 1))
    return TruthClaim(claim.effect, claim.theta, sigma, named.p_value, share, named.probability, named.rivals, named.equivalent)


def held_out(twin: TruthTwin, whiten: Whitener, fit: Refit) -> np.ndarray:
    """(S, 3) rad: closure of every tenth segment, in turn, by what all others tell."""
    effects = [_shrunk(claim) for claim in fit.state.claims]
    angles = np.zeros((len(twin.segments), 3))
    for held in folds_of(len(twin.segments)):
        part = refit(twin, whiten, effects, fit.state, rows=fold_rows(twin, whiten, held), max_steps=FOLD_STEPS)
        angles[held] = twin.residuals(part.state).closure[held]
    return angles


def _shrunk(claim: AppliedEffect) -> Effect:
    """A slow bias with the prior that its evidence was weighed with, the rms of its own parameters: its knots are no more certain."""
    if not claim.effect.id.startswith(NAMELESS):
        return claim.effect
    rms = float(np.sqrt(np.mean(claim.theta**2)))
    return replace(claim.effect, parameter=replace(claim.effect.parameter, plausible=rms))


def excess_of(problem: Problem, angles: np.ndarray, parameters: int) -> float:
    """Chi-square per degree of freedom over what is stated of gyro and truth, of closure angles (S, 3), beside the linear model's 12."""
    white = np.linalg.solve(np.linalg.cholesky(problem.floor.dense()), angles.ravel())
    return float(white @ white) / max(len(white) - PARAMETERS - parameters, 1)
