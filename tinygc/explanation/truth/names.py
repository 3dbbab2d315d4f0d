"""What is named beside a truth file: the catalogue's rate effects, the truth's clock and a wandering bias, weighed as for any recording."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tinygc.effects import Effect
from tinygc.explanation.naming.candidates import candidates, selection_of
from tinygc.explanation.naming.evidence import Evidence, Hypothesis
from tinygc.explanation.naming.naming import NamedEffect
from tinygc.explanation.naming.search import exchanged, search
from tinygc.explanation.truth.truth_effects import OFFSET, wander
from tinygc.explanation.truth.truth_explanation import TruthClaim
from tinygc.explanation.truth.truth_twin import TruthTwin
from tinygc.explanation.twin.refit import Refit, refit
from tinygc.explanation.verdict.decision import NamingDecision, decided
from tinygc.explanation.verdict.proof import FOLD_STEPS, fold_rows, folds_of
from tinygc.models.linear import PARAMETERS
from tinygc.problem.problem import Problem

WANDER_S = 20.0  #: between knots: a shape, whose number of knots is priced by the evidence
MOST_REFUSED = 4  #: of work: each costs a search


@dataclass(frozen=True, eq=False)
class TruthNames:
    """claims, strongest first; refused: what would fit, at a size that no gyroscope has; the decision, with p-value, noise and what was
    considered; before and after: each segment's closure (S, 3) rad; held_out (S, 3) rad of each, of segments that the fit did not see;
    excess, chi-square per degree of freedom over what is stated, before and after."""

    claims: list[TruthClaim]
    refused: list[TruthClaim]
    decision: NamingDecision
    angles: tuple[np.ndarray, np.ndarray]
    held_out: tuple[np.ndarray, np.ndarray]
    excess: tuple[float, float]


def name_beside_truth(problem: Problem, seed: int, progress: Callable[[str], None] = lambda what: None) -> TruthNames:
    """Weigh what can be tried; a name at a size that no gyroscope has is refused, and the rest weighed anew without it."""
    twin = TruthTwin(problem)
    evidence, tried = Evidence(twin), _tried(twin)
    tried = [effect for effect in tried if np.isfinite(columns := evidence.columns(effect)).all() and columns.any()]
    first_p = selection_of(twin, evidence.nothing.whiten, evidence.nothing.fit, tried, seed).p_value(evidence.nothing.fit.r)
    refused: list[TruthClaim] = []
    while True:
        best = exchanged(evidence, tried, search(evidence, tried, evidence.nothing, progress=progress))
        decision = decided(evidence, best, first_p, len({effect.id for effect in tried}))
        claims = _claims(decision)
        wrong = [claim for claim in claims if claim.implausible][: MOST_REFUSED - len(refused)]
        if not wrong:
            break
        ids = frozenset(claim.effect.id for claim in wrong)
        refused += wrong
        tried = [effect for effect in tried if effect.id not in ids]
        evidence.forget(ids)
    first, last = _linear(twin, best), decision.naming.fit
    angles = twin.residuals(first.state).closure, twin.residuals(last.state).closure
    return TruthNames(
        claims,
        refused,
        decision,
        angles,
        (held_out(twin, best, first), held_out(twin, best, last)),
        (_excess(problem, angles[0], 0), _excess(problem, angles[1], sum(len(claim.theta) for claim in claims))),
    )


def _tried(twin: TruthTwin) -> list[Effect]:
    """What bends a rate; the truth's clock; and a wander, which is no name: but what has none must not pass for one of the names."""
    duration, segments = float(twin.problem.began_s[-1]), len(twin.segments)
    knots = np.linspace(0, duration, max(3, min(round(duration / WANDER_S) + 1, segments // 6)))
    return [*(effect for effect in candidates(twin) if effect.kind == "rate"), OFFSET, wander(knots)]


def _claims(decision: NamingDecision) -> list[TruthClaim]:
    fit, naming = decision.naming.fit, decision.naming
    numbers = {claim.effect.id: number for number, claim in enumerate(fit.state.claims)}
    return [
        _claim(fit, numbers[each.effect.id], each, naming.first.chi_square)
        for each in sorted(naming.named + decision.beyond, key=lambda each: -each.gain)
    ]


def _claim(fit: Refit, number: int, named: NamedEffect, chi_square: float) -> TruthClaim:
    claim, sigma = fit.state.claims[number], np.sqrt(np.diag(fit.theta_covariance(number)))
    share = float(np.clip(named.gain / chi_square, 0, 1))
    return TruthClaim(claim.effect, claim.theta, sigma, named.p_value, share, named.probability, named.rivals, named.equivalent)


def _linear(twin: TruthTwin, best: Hypothesis) -> Refit:
    return refit(twin, best.whiten, [], twin.start())


def held_out(twin: TruthTwin, best: Hypothesis, fit: Refit) -> np.ndarray:
    """(S, 3) rad: closure of every tenth segment, in turn, by what all others tell."""
    effects = [claim.effect for claim in fit.state.claims]
    angles = np.zeros((len(twin.segments), 3))
    for held in folds_of(len(twin.segments)):
        part = refit(twin, best.whiten, effects, fit.state, rows=fold_rows(twin, best.whiten, held), max_steps=FOLD_STEPS)
        angles[held] = twin.residuals(part.state, part.rates).closure[held]
    return angles


def _excess(problem: Problem, angles: np.ndarray, parameters: int) -> float:
    """Chi-square per degree of freedom over what is stated of gyro and truth, of closure angles (S, 3), beside the linear model's 12."""
    white = np.linalg.solve(np.linalg.cholesky(problem.floor.dense()), angles.ravel())
    return float(white @ white) / max(len(white) - PARAMETERS - parameters, 1)
