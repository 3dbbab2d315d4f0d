"""Fit named physics together with the linear model, as further calibration methods."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from session.base.errors import FitError
from session.base.progress import Reporter, no_report
from tinygc.closure.problem import Problem
from tinygc.closure.runs import ClosureRun
from tinygc.effects import Effect, catalogue
from tinygc.estimation.held_out import run_method
from tinygc.estimation.options import FitOptions, MethodFit
from tinygc.estimation.physics import PhysicsFit
from tinygc.explanation import faulty_readings
from tinygc.explanation.claims import readable
from tinygc.explanation.data_repair import repair
from tinygc.explanation.decision import FitClosure, Prover, leaves_more
from tinygc.explanation.engine import named_in, settled
from tinygc.explanation.evidence import Evidence
from tinygc.models.nets import CalibrationNet
from tinygc.models.physics import CarriedNet, PhysicsModel
from tinygc.noise.refit import candidates
from tinygc.noise.thinned import conditions
from tinygc.noise.twin import Twin, twin_of


def effect_of(twin: Twin, name: str) -> Effect:
    """Return the effect with this id.  Raises FitError, in one line, for an effect that cannot be fitted to this session."""
    known = {effect.id: effect for effect in candidates(twin)}
    if name not in catalogue():
        raise FitError(f"--physics: {name!r} is no effect; known are {', '.join(catalogue())}; another folder's: --effects DIR")
    if catalogue()[name].kind == "motion":
        raise FitError(f"--physics: {name} is motion that the readings miss: there is nothing to fit, and no model gives it back")
    if (reference := twin.problem.session.reference) is not None and catalogue()[name].kind != "rate":
        raise FitError(
            f"--physics: {name} cannot be fitted against a {reference.title}: it bends what stills show, and none is a reference there"
        )
    if name not in known:
        raise FitError(f"--physics: {name} cannot be fitted to this session (it needs what is not in the log, or is found without a fit)")
    if (scan := known[name].scan) is not None:
        raise FitError(f"--physics: {name} has a value ({scan.name}) that must be searched for; use --physics auto")
    return known[name]


# Fit the physics that `explain` names, or the requested physics, together with the linear model.


def fit_physics(
    problem: Problem,
    ids: tuple[str, ...] | None,
    seed: int = 0,
    progress: Reporter = no_report,
    stated: FitClosure | None = None,
) -> PhysicsFit:
    """Fit with these effects, or with what `explain` names (None), given what ``fit`` states without them.  Raises FitError for an id that
    cannot be fitted, and where what is left without the effects cannot be."""
    stated = FitClosure.of(problem) if stated is None else stated
    refused = False
    if ids is None:
        repaired, twin, decision, proof = named_in(problem, stated, seed, lambda what, done, of: progress(what))
        named = decision.named or decision.undersampled or repaired.found
        refused = leaves_more(twin, decision, proof) if named else decision.unnamed
    else:
        repaired = repair(problem, progress)
        twin = twin_of(repaired.problem)
        evidence = Evidence(twin)
        requested = evidence.of(tuple(effect_of(twin, name) for name in ids), evidence.nothing)
        proof = Prover(problem, twin, stated)(requested.whiten, settled(twin, requested.whiten, requested.fit))
    fit, left = proof.fit, proof.left
    if left.problem is None or left.fit is None:
        raise FitError(f"{problem.session.name}: without what is named, least squares does not converge; fit without --physics")
    rate_claims = tuple(claim for claim in fit.state.claims if claim.effect.kind == "rate")
    model = PhysicsModel(fit.state.model, rate_claims, conditions(repaired.problem))
    # The fitted effects of the accelerometer with their parameters and std, inflated where the residuals exceed the noise.
    found = []
    for number, claim in enumerate(fit.state.claims):
        if claim.effect.kind == "force":
            _, parameters, std = readable(claim, fit.widened * fit.theta_covariance(number))
            found.append({"id": claim.effect.id, "equation": claim.effect.equation, "parameters": parameters, "std": std})
    angles, unseen = left.fit.angles, proof.named
    return PhysicsFit(model, repaired.problem, left.problem, fit, angles, unseen, tuple(repaired.found), refused, of_force=tuple(found))


# Samples lost in a closure run.  A log's losses are repaired by its own closure; a run is never fitted, so its losses are not repaired.


def lost_in(run: ClosureRun) -> np.ndarray:
    """Moments (L,) in seconds of the run's file after which samples seem to be missing, between its two stills."""
    rows = faulty_readings.find_losses(faulty_readings.find_jumps(run.samples), run.samples.duration_s)
    inside = rows[(rows >= run.rows.start) & (rows < run.rows.stop - 1)]
    return run.samples.t_s[inside] - run.samples.t_s[0]


# ``fit --physics``: the named physics as further methods, validated on held-out segments and on the closure runs.

PHYSICS, NET = "physics", "tinygc_physics"


def physics_methods(
    problem: Problem,
    level: Problem,
    linear: MethodFit,
    options: FitOptions,
    runs: Sequence[ClosureRun],
    progress: Reporter = no_report,
) -> PhysicsFit:
    """Fit the physics of the options, and the net after it if the net is among their methods; close both on the runs.  level: the problem
    that ``fit`` solves; linear: its least squares."""
    began = time.perf_counter()
    ids = None if options.physics == ("auto",) else options.physics
    found = fit_physics(problem, ids, options.seed, progress, FitClosure(level, linear, options))
    fits = {PHYSICS: MethodFit(PHYSICS, found.model, found.angles, found.held_out, time.perf_counter() - began)}
    if "tinygc" in options.methods:
        progress("TinyGC-Net with physics")
        net = run_method("tinygc", found.left, options)
        assert isinstance(net.model, CalibrationNet)
        fits[NET] = MethodFit(NET, CarriedNet(found.model, net.model), net.angles, net.held_out, fits[PHYSICS].seconds + net.seconds)
    errors = []
    for run in runs:
        # Physics needs the whole log, not only the turn; with the effects known, the stills may give a better heading of the Earth rate.
        rates = {name: run.rates(fit.model) for name, fit in fits.items()}
        errors.append({name: run.with_earth(found.fit.state.earth_t, rate).errors_at(rate) for name, rate in rates.items()})
    return replace(found, methods=fits, run_errors=errors, lost_s=tuple(lost_in(run) for run in runs))
