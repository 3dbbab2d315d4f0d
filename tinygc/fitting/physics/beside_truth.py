"""Named physics where the reference is a truth file: fitted to the closure between moments of truth alone, the truth's clock beside it."""

from __future__ import annotations

from collections.abc import Callable

from session.common.errors import FitError
from tinygc.effects import Effect
from tinygc.explanation.naming.evidence import Evidence
from tinygc.explanation.truth.names import beside_clock, name_beside_truth
from tinygc.explanation.truth.truth_twin import TruthTwin
from tinygc.explanation.truth.wrong_moments import without_wrong_moments
from tinygc.explanation.twin.twin import Twin
from tinygc.fitting.physics.physics_fit import PhysicsFit, effect_of
from tinygc.models.physics import PhysicsModel
from tinygc.problem.conditions import conditions
from tinygc.problem.problem import Problem

#: what a fit has left out before, as ``explain`` calls it
WRONG_MOMENTS = "reference.truth_jump"


def fit_beside_truth(problem: Problem, ids: tuple[str, ...] | None, seed: int, progress: Callable[[str], None]) -> PhysicsFit:
    """Fit with these effects, or with what ``explain`` names beside the truth (None).  Raises FitError for an id that cannot be fitted."""
    sound, jumps, _ = without_wrong_moments(problem)
    refused = False
    if ids is None:
        names = name_beside_truth(sound, seed, progress)
        evidence, effects, refused = names.evidence, names.named, names.decision.refused
    else:
        evidence = Evidence(TruthTwin(sound))
        effects = tuple(_effect(evidence.twin, name) for name in ids)
    twin = evidence.twin
    # What wanders without a name is no part of a model: it is noise here.
    weighed = evidence.of(effects, evidence.nothing)
    fit = beside_clock(twin, weighed.whiten, weighed.fit)
    rate_claims = tuple(claim for claim in fit.state.claims if claim.effect.kind == "rate")
    model = PhysicsModel(fit.state.model, rate_claims, conditions(sound))
    return PhysicsFit(model, sound, twin, weighed.whiten, fit, (WRONG_MOMENTS,) if jumps else (), refused)


def _effect(twin: Twin, name: str) -> Effect:
    effect = effect_of(twin, name)
    if effect.kind != "rate":
        raise FitError(f"--physics: {name} cannot be fitted beside a truth file: it bends what stills show, and none is a reference there")
    return effect
