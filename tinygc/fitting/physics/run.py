"""``fit --physics``: the named physics as methods beside the others, closed on segments they never saw and on the closure runs."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from tinygc.closure.residual import Batch, closure_angles
from tinygc.effects.applied_effect import AppliedEffect
from tinygc.explanation.twin.refit import refit
from tinygc.explanation.verdict.proof import FOLD_STEPS, fold_rows, folds_of
from tinygc.fitting.physics.fit_physics import PhysicsFit, fit_physics
from tinygc.methods.method_fit import MethodFit
from tinygc.methods.options import FitOptions
from tinygc.models.calibration_net import CalibrationNet
from tinygc.models.physics import CarriedNet, PhysicsModel
from tinygc.problem.closure_run import ClosureRun
from tinygc.problem.problem import Problem

PHYSICS, NET = "physics", "tinygc_physics"


def physics_methods(
    problem: Problem, options: FitOptions, ids: tuple[str, ...] | None, progress: Callable[[str], None] = lambda what: None
) -> tuple[PhysicsFit, dict[str, MethodFit]]:
    """Fit the physics (None: what naming finds), and the net behind it if the net is among the methods."""
    began = time.perf_counter()
    found = fit_physics(problem, ids, options.seed, progress)
    seconds = time.perf_counter() - began
    twin, with_net = found.twin, "tinygc" in options.methods
    progress("physics, held out")
    shape = (len(twin.segments), twin.batch.angles)
    held_physics, held_net = np.zeros(shape), np.zeros(shape)
    effects = [claim.effect for claim in found.fit.state.claims]
    for held in folds_of(len(twin.segments), options.folds):
        part = refit(twin, found.whiten, effects, found.fit.state, rows=fold_rows(twin, found.whiten, held), max_steps=FOLD_STEPS)
        held_physics[held] = twin.residuals(part.state).closure[held]
        if with_net:
            model = PhysicsModel(part.state.model, _rate_claims(part.state.claims), found.model.known)
            batch = _without_effects(found, model)
            seen = np.ones(len(batch), dtype=bool)
            seen[held] = False
            net, _ = _train(batch.pick(seen), found.problem.floor.sigma[seen])
            held_net[held] = closure_angles(batch.pick(~seen), net)
    angles = twin.residuals(found.fit.state).closure
    fits = {PHYSICS: MethodFit(PHYSICS, found.model, angles, held_physics, seconds)}
    if with_net:
        batch = _without_effects(found, found.model)
        net, net_seconds = _train(batch, found.problem.floor.sigma)
        carried = CarriedNet(found.model, net)
        fits[NET] = MethodFit(NET, carried, closure_angles(batch, net), held_net, seconds + net_seconds)
    return found, fits


def run_errors(run: ClosureRun, fit: MethodFit, found: PhysicsFit) -> np.ndarray:
    """Roll, pitch, yaw error (3,) rad of a closure run.

    Physics needs the whole log, not only the turn; and with the effects known, the stills may show the Earth's heading better.
    """
    rate = run.rates(fit.model)
    return run.with_earth(found.fit.state.earth_t, rate).errors_at(rate)


def _rate_claims(claims: Iterable[AppliedEffect]) -> tuple[AppliedEffect, ...]:
    return tuple(claim for claim in claims if claim.effect.kind == "rate")


def _without_effects(found: PhysicsFit, model: PhysicsModel) -> Batch:
    """The batch as the sensor would have measured it without the effects."""
    twin = found.twin
    began = [movement.t_s[0] for movement in twin.movements]
    rates = [model.equivalent_rate(log.samples, start) for log, start in zip(twin.seen.logs, began, strict=True)]
    return replace(twin.batch_at(found.fit.state), rate=twin.padded(rates))


def _train(batch: Batch, sigma: np.ndarray) -> tuple[CalibrationNet, float]:
    from tinygc.methods.network.training import train_second_order

    began = time.perf_counter()
    net = train_second_order(batch, sigma).net
    assert isinstance(net, CalibrationNet)  # the kind that training begins with
    return net, time.perf_counter() - began
