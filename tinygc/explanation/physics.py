"""Fit named physics together with the linear model, as further calibration methods."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from session.io.errors import FitError
from tinygc.closure.build import with_still_bias
from tinygc.closure.problem import Problem, conditions
from tinygc.closure.residual import Batch, closure_angles
from tinygc.closure.runs import ClosureRun
from tinygc.effects import Effect, catalogue
from tinygc.estimation.options import FitOptions, MethodFit
from tinygc.estimation.physics import PhysicsFit
from tinygc.explanation import faulty_readings
from tinygc.explanation.claims import readable
from tinygc.explanation.data_repair import repair
from tinygc.explanation.decision import FOLD_STEPS, NOT_STATED, FitClosure, cleared, fold_rows, folds_of
from tinygc.explanation.engine import named_in
from tinygc.explanation.evidence import Evidence
from tinygc.explanation.truth_engine import without_wrong_moments
from tinygc.explanation.truth_names import TruthTwin, beside_clock, name_beside_truth
from tinygc.models.linear import LinearModel
from tinygc.models.nets import CalibrationNet
from tinygc.models.physics import CarriedNet, PhysicsModel
from tinygc.noise.candidates import candidates
from tinygc.noise.channels import in_gauge
from tinygc.noise.refit import Refit, over_shapes, refit
from tinygc.noise.twin import State, Twin
from tinygc.noise.whitening import Whitener


def effect_of(twin: Twin, name: str) -> Effect:
    """Return the effect with this id.  Raises FitError, in one line, for an effect that cannot be fitted to this session."""
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


# Named physics with a truth file: fitted to the closure between moments of truth alone, together with the truth's clock.

#: id in ``explain`` of what a fit leaves out before it starts
WRONG_MOMENTS = "reference.truth_jump"


def fit_beside_truth(problem: Problem, ids: tuple[str, ...] | None, seed: int, progress: Callable[[str], None]) -> PhysicsFit:
    """Fit with these effects, or with what ``explain`` names for a session with a truth file (None).  Raises FitError for an id that cannot
    be fitted."""
    sound, jumps, _ = without_wrong_moments(problem)
    twin = TruthTwin(sound)
    evidence, refused = Evidence(twin), False
    if ids is None:
        names = name_beside_truth(twin, evidence, seed, progress)
        effects, refused = names.named, names.naming.refused
    else:
        effects = tuple(_effect(twin, name) for name in ids)
    # An unnamed slow bias is not part of a model: it is noise here.
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


# Fit the physics that `explain` names, or the requested physics, together with the linear model.


def fit_physics(
    problem: Problem,
    ids: tuple[str, ...] | None,
    seed: int = 0,
    progress: Callable[[str], None] = lambda what: None,
    stated: FitClosure | None = None,
) -> PhysicsFit:
    """Fit with these effects, or with what `explain` names (None), given what ``fit`` states without them.  Raises FitError for an id that
    cannot be fitted."""
    if problem.session.truths is not None:
        return fit_beside_truth(problem, ids, seed, progress)
    refused = False
    if ids is None:
        closure = FitClosure.of(problem) if stated is None else stated
        mended, twin, decision, _ = named_in(problem, closure, seed, lambda what, done, of: progress(what))
        fit, whiten, refused = decision.fit, decision.whiten, decision.refused
        if decision.beyond:  # an unnamed shape is not part of a model
            fit = _stated(twin, whiten, refit(twin, whiten, [named.effect for named in decision.named], twin.start()))
    else:
        mended = repair(problem, progress)
        twin = Twin(mended.problem)
        evidence = Evidence(twin)
        asked = evidence.of(tuple(effect_of(twin, name) for name in ids), evidence.nothing)
        whiten, fit = asked.whiten, _stated(twin, asked.whiten, asked.fit)
    rate_claims = tuple(claim for claim in fit.state.claims if claim.effect.kind == "rate")
    model = PhysicsModel(fit.state.model, rate_claims, conditions(mended.problem))
    # The fitted effects of the accelerometer with their parameters and std, inflated where the residuals exceed the noise.
    widen, found = max(1.0, fit.chi_square / max(len(fit.r) - fit.J.shape[1], 1)), []
    for number, claim in enumerate(fit.state.claims):
        if claim.effect.kind == "force":
            _, parameters, std = readable(claim, widen * fit.theta_covariance(number))
            found.append({"id": claim.effect.id, "equation": claim.effect.equation, "parameters": parameters, "std": std})
    return PhysicsFit(model, mended.problem, twin, whiten, fit, tuple(mended.found), refused, of_force=tuple(found))


def _stated(twin: Twin, whiten: Whitener, fit: Refit) -> Refit:
    return over_shapes(twin, whiten, in_gauge(twin, whiten, fit))


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
    fitted: Problem,
    options: FitOptions,
    runs: Sequence[ClosureRun],
    progress: Callable[[str], None] = lambda what: None,
) -> PhysicsFit:
    """Fit the physics of the options, and the net after it if the net is among their methods; close both on the runs.  fitted: the problem
    that ``fit`` solves, whose source of the bias holds for the closure of the physics as well."""
    began = time.perf_counter()
    stated = FitClosure.of(fitted) if fitted.session.truths is None else NOT_STATED
    found = fit_physics(problem, None if options.physics == ("auto",) else options.physics, options.seed, progress, stated)
    from_stills = options.bias == "stills" or (options.bias == "auto" and stated.from_stills)
    seconds = time.perf_counter() - began
    twin, with_net = found.twin, "tinygc" in options.methods
    progress("physics, held out")
    shape = (len(twin.segments), twin.batch.angles)
    held_physics, held_net = np.zeros(shape), np.zeros(shape)
    effects = [claim.effect for claim in found.fit.state.claims]
    for held in folds_of(len(twin.segments), options.folds):
        part = refit(twin, found.whiten, effects, found.fit.state, rows=fold_rows(twin, found.whiten, held), max_steps=FOLD_STEPS)
        held_physics[held] = _closure(found, part.state, from_stills)[held]
        if with_net:
            claims = part.state.claims
            model = PhysicsModel(part.state.model, tuple(claim for claim in claims if claim.effect.kind == "rate"), found.model.known)
            batch = _without_effects(found, model)
            seen = np.ones(len(batch), dtype=bool)
            seen[held] = False
            net, _ = _train(batch.pick(seen), found.problem.floor.sigma[seen])
            held_net[held] = closure_angles(batch.pick(~seen), net)
    angles = _closure(found, found.fit.state, from_stills)
    fits = {PHYSICS: MethodFit(PHYSICS, found.model, angles, held_physics, seconds)}
    if with_net:
        batch = _without_effects(found, found.model)
        net, net_seconds = _train(batch, found.problem.floor.sigma)
        carried = CarriedNet(found.model, net)
        fits[NET] = MethodFit(NET, carried, closure_angles(batch, net), held_net, seconds + net_seconds)
    errors = []
    for run in runs:
        # Physics needs the whole log, not only the turn; with the effects known, the stills may give a better heading of the Earth rate.
        rates = {name: run.rates(fit.model) for name, fit in fits.items()}
        errors.append({name: run.with_earth(found.fit.state.earth_t, rate).errors_at(rate) for name, rate in rates.items()})
    return replace(found, methods=fits, run_errors=errors, lost_s=tuple(lost_in(run) for run in runs))


def _closure(found: PhysicsFit, state: State, from_stills: bool) -> np.ndarray:
    """(S, d) rad of each segment by a state, with the bias of each turn from its stills where ``fit`` takes it from them."""
    if not from_stills:
        return found.twin.residuals(state).closure
    level = with_still_bias(cleared(found.problem, found.twin, state))
    assert level.rest_rps is not None  # by ``with_still_bias``
    return closure_angles(level.batch, LinearModel(state.model.E, -state.model.E @ level.rest_rps))


def _without_effects(found: PhysicsFit, model: PhysicsModel) -> Batch:
    """The batch as the sensor would have measured it without the effects."""
    twin = found.twin
    began = [movement.t_s[0] for movement in twin.movements]
    rates = [model.equivalent_rate(log.samples, start) for log, start in zip(twin.seen.logs, began, strict=True)]
    return replace(twin.batch_at(found.fit.state), rate=twin.padded(rates))


def _train(batch: Batch, sigma: np.ndarray) -> tuple[CalibrationNet, float]:
    from tinygc.estimation.network import train_second_order

    began = time.perf_counter()
    net = train_second_order(batch, sigma).net
    return net, time.perf_counter() - began
