"""Fit the physics that `explain` names, or that was asked for, together with the linear model."""

from __future__ import annotations

from collections.abc import Callable

from tinygc.explanation.mends.mending import mend
from tinygc.explanation.naming.evidence import Evidence
from tinygc.explanation.twin.common_delay import in_gauge
from tinygc.explanation.twin.refit import refit
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.verdict.decision import decide
from tinygc.fitting.physics.beside_truth import fit_beside_truth
from tinygc.fitting.physics.physics_fit import PhysicsFit, effect_of
from tinygc.models.physics import PhysicsModel
from tinygc.problem.conditions import conditions
from tinygc.problem.problem import Problem


def fit_physics(
    problem: Problem, ids: tuple[str, ...] | None, seed: int = 0, progress: Callable[[str], None] = lambda what: None
) -> PhysicsFit:
    """Fit with these effects, or with what `explain` would name (None).  Raises FitError for an id that cannot be fitted."""
    if problem.session.truths is not None:
        return fit_beside_truth(problem, ids, seed, progress)
    mended = mend(problem, progress)
    twin = Twin(mended.problem)
    refused = False
    if ids is None:
        decision = decide(twin, seed, progress, mended.reference)
        fit, whiten, refused = decision.naming.fit, decision.whiten, decision.refused
        if decision.beyond:  # what has no name is no part of a model
            fit = refit(twin, whiten, [named.effect for named in decision.naming.named], twin.start())
    else:
        evidence = Evidence(twin)
        asked = evidence.of(tuple(effect_of(twin, name) for name in ids), evidence.nothing)
        fit, whiten = asked.fit, asked.whiten
    fit = in_gauge(twin, whiten, fit)
    rate_claims = tuple(claim for claim in fit.state.claims if claim.effect.kind == "rate")
    model = PhysicsModel(fit.state.model, rate_claims, conditions(mended.problem))
    return PhysicsFit(model, mended.problem, twin, whiten, fit, tuple(mended.found), refused)
