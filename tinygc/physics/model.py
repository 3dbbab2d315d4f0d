"""The model goes on: a calibration that undoes the physics that `explain` named, or that was asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from session.errors import FitError
from session.samples import Samples
from tinygc.effects import catalogue
from tinygc.effects._effect import Effect
from tinygc.explain.decision import decide
from tinygc.explain.gauge import in_gauge
from tinygc.explain.mending import mend
from tinygc.explain.movement import Conditions, conditions, movement_of
from tinygc.explain.naming import candidates
from tinygc.explain.refit import Refit, refit
from tinygc.explain.twin import Claim, Twin
from tinygc.explain.whitening import Whitener
from tinygc.linear import LinearModel
from tinygc.problem import Problem


@dataclass(frozen=True, eq=False)
class PhysicsModel:
    """omega = (effects undone)(E m + B): linear model, claims in the order in which they are undone, and what they refer to."""

    linear: LinearModel
    claims: tuple[Claim, ...]
    known: Conditions

    @property
    def parameters(self) -> int:
        return 12 + sum(len(claim.theta) for claim in self.claims)

    @property
    def ids(self) -> tuple[str, ...]:
        return tuple(claim.effect.id for claim in self.claims)

    def calibrate(self, samples: Samples, began_s: float = 0.0) -> np.ndarray:
        """True rates (N, 3) rad/s of one log; samples with the pre-calibrated force; began_s of the session when it began."""
        rate = self.linear(samples.gyro)
        movement = movement_of(samples, rate, self.known, began_s)
        for claim in self.claims:
            rate = claim.effect.correct(rate, movement.with_rate(rate), claim.theta)
        return rate

    def equivalent_rate(self, samples: Samples, began_s: float = 0.0) -> np.ndarray:
        """The rates (N, 3) that the sensor would have measured without the effects: what a network can be trained on."""
        return (self.calibrate(samples, began_s) - self.linear.B) @ np.linalg.inv(self.linear.E).T


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
    mended = mend(problem, progress)
    twin = Twin(mended.problem)
    whiten = Whitener(twin)
    refused = False
    if ids is None:
        decision = decide(mended, twin, whiten, seed, progress)
        fit, refused = decision.naming.fit, decision.refused
    else:
        fit = refit(twin, whiten, [_effect(twin, name) for name in ids], twin.start())
    fit = in_gauge(twin, whiten, fit)
    rate_claims = tuple(claim for claim in fit.state.claims if claim.effect.kind == "rate")
    model = PhysicsModel(fit.state.model, rate_claims, conditions(mended.problem))
    return PhysicsFit(model, mended.problem, twin, whiten, fit, tuple(mended.found), refused)


def _effect(twin: Twin, name: str) -> Effect:
    known = {effect.id: effect for effect in candidates(twin)}
    if name not in catalogue():
        raise FitError(f"--physics: {name!r} is no effect; known are {', '.join(catalogue())}")
    if name not in known:
        raise FitError(f"--physics: {name} cannot be fitted to this session (it needs what the log lacks, or is found without a fit)")
    if known[name].shape:
        raise FitError(f"--physics: {name} has a time that must be searched for; use --physics auto")
    return known[name]
