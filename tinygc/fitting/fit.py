"""``calibrate.py fit``: from a session folder to models, closure figures and a report."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from session.base import features
from session.base.errors import CalibrationError, DataError, FitError, SegmentError
from session.base.progress import Progress, no_report
from session.detect.check_references import with_own_accelerometer
from session.detect.check_samples import with_bridges
from session.log.folder import Session, read_session
from tinygc.closure.build import build_problem
from tinygc.closure.least_squares import GaussianPrior, PriorOf, PriorUse
from tinygc.closure.prepared import Prepared, prepare
from tinygc.closure.problem import Problem
from tinygc.closure.runs import read_closure_runs
from tinygc.estimation.bias import BiasChoice, choose
from tinygc.estimation.choice import RAW, against_raw, closure_figures, run_figures
from tinygc.estimation.held_out import run_method
from tinygc.estimation.options import CHOSEN, FitOptions, MethodFit
from tinygc.estimation.spread import Spread
from tinygc.estimation.stated_noise import StatedNoise, stated_noise, stated_uncertainty
from tinygc.estimation.systematic import systematic_of
from tinygc.fitting.results import FitResult
from tinygc.fitting.unit_state import spread_of, spread_over
from tinygc.noise.measured import measured_noise


class GivenPrior(Protocol):
    """What least squares knows of the unit beforehand; methods: those that are fitted where none are requested."""

    methods: tuple[str, ...]

    def prior(self, start: np.ndarray) -> GaussianPrior:
        """Return the prior of the parameters; start (12,): the centre of numbers that it does not know."""

    @property
    def spread(self) -> Spread:
        """How far the unit's 21 numbers move between sessions."""

    def fit(self, problem: Problem, options: FitOptions, noise: StatedNoise | None) -> tuple[BiasChoice, Problem, MethodFit, PriorUse]:
        """Return the choice of the bias, the problem with it and with the prior, its least squares, and the use of the prior."""


if TYPE_CHECKING:
    from tinygc.estimation.physics import FitPhysics


def prepared_for(session: Session | Path, options: FitOptions, progress: Progress, prior: PriorOf | None = None) -> Prepared:
    """Prepare a session, or a session folder, as the options of a fit have it; prior: of the unit.  Raises the errors of ``prepare``."""
    if not isinstance(session, Session):
        session = read_session(session, lambda name: progress(f"reading {name}", 0, 1))
    return prepare(
        session.on_clock(options.clock),
        use_earth=options.earth,
        exclude=options.exclude,
        accelerometer=options.accelerometer,
        prior=prior,
        at_rest=measured_noise(options.noise),
        progress=lambda what: progress(what, 0, 1),
    )


def fit_session(
    session: Session | Path,
    options: FitOptions,
    progress: Progress = no_report,
    prepared: Prepared | None = None,
    physics: FitPhysics | None = None,
) -> FitResult:
    """Fit a calibration to a session, or to a session folder.

    progress: callback with the current task and its progress; prepared: the session, if it is prepared already; physics: fits the effects
    that ``options.physics`` names, and is required for that.
    Raises FormatError for other sessions of the unit that cannot be read, and the errors of ``prepare``, of ``read_closure_runs`` and of
    the methods.
    """
    if prepared is not None:
        session = prepared.session
    elif not isinstance(session, Session):
        session = read_session(session, lambda name: progress(f"reading {name}", 0, 1))
    given: GivenPrior | None = features.first("prior of a fit", options, session.config.sensor.model)
    if given is not None and options.methods == CHOSEN:
        options = replace(options, methods=given.methods)
    between = spread_over(options.history, session) if options.history else None
    spread = spread_of(session.config, between=between, lot=None if given is None else given.spread)
    prepared = prepared or prepared_for(session, options, progress, None if given is None else given.prior)
    problem = prepared.problem
    runs = read_closure_runs(problem)
    noise, use = None, None
    if given is None:
        progress("bias", 0, 1)
        bias_from, level, linear = choose(problem, options)
    else:
        progress("noise", 0, 1)
        noise = stated_noise(problem)
        progress("prior", 0, 1)
        bias_from, level, linear, use = given.fit(problem, options, noise)
    fits, not_run = _run_methods(problem, level, options, linear, progress)
    errors = [{name: run.errors(fit.model) for name, fit in fits.items()} for run in runs]
    linear = fits.get("least_squares") or linear
    named = None
    if options.physics is not None:
        if physics is None:
            raise ValueError("options.physics is fitted by a function that is given as physics")
        # `explain` compares a given calibration with reference.accelerometer.
        whole = prepared.as_given().problem if options.accelerometer == "auto" else problem
        named = physics(whole, level, linear, options, runs, lambda what: progress(what, 0, 1))
        fits |= named.methods
        errors = [error | more for error, more in zip(errors, named.run_errors, strict=True)]
    model = linear.linear
    if given is None:
        progress("noise", 0, 1)
        noise = stated_noise(problem)
    stated = stated_uncertainty(problem, level, model, noise, use)
    systematic = None if noise is None else systematic_of(level, model, noise, stated["widened"])
    return FitResult(
        problem=problem.changed(batch=level.batch, rest_rps=level.rest_rps),
        options=options,
        methods=fits,
        runs=runs,
        run_errors=errors,
        physics=named,
        linear=linear,
        allowed=systematic,
        spread=spread,
        noise=noise,
        bias_from=bias_from,
        warnings=prepared.warnings,
        not_run=not_run,
        against_raw=against_raw(problem, options, fits),
        prior=use,
        **stated,
    )


def _run_methods(
    problem: Problem, level: Problem, options: FitOptions, linear: MethodFit, progress: Progress
) -> tuple[dict[str, MethodFit], dict[str, str]]:
    """Return the methods by name, and why others cannot run on this session, by name.

    level: the problem with the selected bias, which all methods are fitted to; linear: its least squares.  Raises the error of the last
    one where none can run.
    """
    known = {"least_squares": linear}
    fits: dict[str, MethodFit] = {}
    not_run: dict[str, str] = {}
    for name in options.methods:
        own = problem if name in RAW else level
        try:
            fits[name] = known.get(name) or run_method(name, own, options, partial(progress, name.replace("_", " ")), fits)
        except (DataError, FitError, SegmentError) as error:  # of the session; files and options concern them all
            not_run[name] = str(error)
            if len(not_run) == len(options.methods):
                raise
    return fits, not_run


# What a recording closes to, whatever ``check`` finds in it: before and after its repair.

#: measured rates less the first still's mean show the recording as it is; least squares shows what a calibration leaves
SHOWN_BY = ("raw_bias_removed", "least_squares")


def closure_of(folder: Path) -> dict[str, Any]:
    """Fit a session folder by least squares, and compare with the raw rates: ``closure.before`` and ``closure.after`` of
    ``tinygc-repair/1``.

    turns used; scale (3): what least squares multiplies the rates by; tilt held out, by method; runs: RMSE of each closure run by method;
    why: the reason why there is none of it, or nothing.
    """
    found: dict[str, Any] = {"turns": 0, "scale": None, "holdout_tilt_rms_deg": None, "runs": [], "why": ""}
    try:
        session, _ = with_own_accelerometer(read_session(folder))
        problem = build_problem(with_bridges(session))
        options = FitOptions(methods=SHOWN_BY)
        fits = {name: run_method(name, problem, options) for name in SHOWN_BY}
        runs = read_closure_runs(problem)
    except CalibrationError as error:
        return found | {"why": str(error).removeprefix(f"{folder}: ")}
    return found | {
        "turns": len(problem.used),
        "scale": np.linalg.norm(fits["least_squares"].linear.E, axis=0).tolist(),
        "holdout_tilt_rms_deg": {name: closure_figures(fit.held_out)["tilt_rms_deg"] for name, fit in fits.items()},
        "runs": [
            {"file": run.file, "rmse_deg": {name: run_figures(run.errors(fit.model))["rmse_deg"] for name, fit in fits.items()}}
            for run in runs
        ],
    }
