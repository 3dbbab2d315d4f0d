"""Fit the physics that `explain` names, or that was asked for, together with the linear model."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from session.common.errors import FitError
from tinygc.effects import Effect, catalogue
from tinygc.explanation.mends.mending import mend
from tinygc.explanation.naming.candidates import candidates
from tinygc.explanation.naming.evidence import Evidence
from tinygc.explanation.twin.common_delay import in_gauge
from tinygc.explanation.twin.refit import Refit, refit
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener
from tinygc.explanation.verdict.decision import decide
from tinygc.models.physics import PhysicsModel
from tinygc.problem.conditions import conditions
from tinygc.problem.problem import Problem


@dataclass(frozen=True, eq=False)
class PhysicsFit:
    """model; problem it was fitted to (mended); twin, whitener and refit behind it; mended: ids of what was mended before; refused: there
    is a mismatch, and no name for it."""

    model: PhysicsModel
    problem: Problem
    twin: Twin
    whiten: Whitener
    fit: Refit
    mended: tuple[str, ...]
    refused: bool = False


def fit_physics(
    problem: Problem, ids: tuple[str, ...] | None, seed: int = 0, progress: Callable[[str], None] = lambda what: None
) -> PhysicsFit:
    """Fit with these effects, or with what `explain` would name (None).  Raises FitError for an id that cannot be fitted."""
    if problem.session.truths is not None:
        raise FitError(
            f"{problem.session.name}: --physics is fitted to stills and turns; the reference here is a truth file: "
            "`calibrate.py explain` says what it shows"
        )
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
        asked = evidence.of(tuple(_effect(twin, name) for name in ids), evidence.nothing)
        fit, whiten = asked.fit, asked.whiten
    fit = in_gauge(twin, whiten, fit)
    rate_claims = tuple(claim for claim in fit.state.claims if claim.effect.kind == "rate")
    model = PhysicsModel(fit.state.model, rate_claims, conditions(mended.problem))
    return PhysicsFit(model, mended.problem, twin, whiten, fit, tuple(mended.found), refused)


def _effect(twin: Twin, name: str) -> Effect:
    known = {effect.id: effect for effect in candidates(twin)}
    if name not in catalogue():
        raise FitError(f"--physics: {name!r} is no effect; known are {', '.join(catalogue())}; another folder's: --effects DIR")
    if catalogue()[name].kind == "motion":
        raise FitError(f"--physics: {name} is motion that the readings miss: there is nothing to fit, and no model gives it back")
    if name not in known:
        raise FitError(f"--physics: {name} cannot be fitted to this session (it needs what the log lacks, or is found without a fit)")
    if (scan := known[name].scan) is not None:
        raise FitError(f"--physics: {name} has a value ({scan.name}) that must be searched for; use --physics auto")
    return known[name]
