"""``calibrate.py fit``: from a session folder to models, closure figures and a report."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from session.checks.findings import Finding
from session.common.errors import SegmentError
from session.common.units import DEG, G
from session.common.version import VERSION
from session.files.results import write_whole
from session.files.writing import result_folder
from session.log.folder import Session
from session.log.hashes import input_hashes
from tinygc import models
from tinygc.closure.residual import closure_angles
from tinygc.closure.uncertainty import GoodnessOfFit, goodness, parameter_covariance
from tinygc.fit import saved_fit
from tinygc.methods.method_fit import MethodFit
from tinygc.methods.options import FitOptions
from tinygc.methods.run import run_method
from tinygc.problem.closure_run import ClosureRun, read_closure_runs
from tinygc.problem.prepared import Prepared, prepare
from tinygc.problem.problem import Problem

if TYPE_CHECKING:
    from tinygc.fit.physics.fit_physics import PhysicsFit

SCHEMA = "tinygc-fit/1"


@dataclass(frozen=True, eq=False)
class FitResult:
    """Everything a fit found.

    methods by name; runs with errors_rad by file and method; covariance (12, 12) of least squares' parameters, already scaled by
    ``goodness.excess``; other_choice: least squares with the opposite choice of still rates; first_order_rad: the largest error of
    the paper's integrator on these segments; warnings of the first look; physics that was fitted as well, or None; reused: methods that
    were not fitted again, but taken from what had been saved; lost_s: with physics, moments in each run after which samples seem to be
    missing; bias_sigma_rps (3,): spread of the logs' biases, where each had its own.
    """

    problem: Problem
    options: FitOptions
    methods: dict[str, MethodFit]
    runs: list[ClosureRun]
    run_errors: list[dict[str, np.ndarray]]
    goodness: GoodnessOfFit
    linear: MethodFit
    covariance: np.ndarray
    other_choice: MethodFit
    first_order_rad: float
    warnings: list[Finding]
    physics: PhysicsFit | None = None
    reused: tuple[str, ...] = ()
    bias_sigma_rps: np.ndarray | None = None
    lost_s: tuple[np.ndarray, ...] = ()

    @property
    def session(self) -> Session:
        return self.problem.session


def fit_session(
    folder: Path,
    options: FitOptions,
    progress: Callable[[str, int, int], None] = lambda what, done, of: None,
    saved: Path | None = None,
    prepared: Prepared | None = None,
) -> FitResult:
    """Run the main job.  ``progress`` is told what is being done, and how far it is; saved: a folder of ``save_models`` whose methods are
    taken as they are where they were made from the same files with the same options; prepared: the session, where somebody has it already.

    Raises the errors of ``prepare``, of ``read_closure_runs`` and of the methods.
    """
    if prepared is None:
        prepared = prepare(folder, use_earth=options.earth, exclude=options.exclude, progress=lambda what: progress(what, 0, 1))
    session, problem = prepared.session, prepared.problem
    if options.still_rates and not len(problem.still_rates.rate):
        raise SegmentError(f"{folder}: no still to take a rate from; fit without --still-rates")
    runs, spread, floor = read_closure_runs(problem), None, problem.floor
    if options.bias_per_log:
        from tinygc.fit.bias.days import levelled

        problem, spread = levelled(problem)
    known = {} if saved is None else saved_fit.saved_methods(saved, problem, options, input_hashes(session))
    fits: dict[str, MethodFit] = {}
    for name in options.methods:
        told = lambda done, of, name=name: progress(name.replace("_", " "), done, of)  # noqa: E731
        fits[name] = known.get(name) or run_method(name, problem, options, told, fits)
    if options.conditions:
        from tinygc.methods.network.conditions import METHOD, run_conditions

        words = "tinygc with " + " and ".join(options.conditions)
        fits[METHOD] = run_conditions(problem, options, options.conditions, lambda done, of: progress(words, done, of))
    errors = [{name: run.errors(fit.model, options.integrator) for name, fit in fits.items()} for run in runs]
    linear = fits.get("least_squares") or run_method("least_squares", problem, options)
    physics, lost = None, ()
    if options.physics is not None:
        from tinygc.fit.physics.lost_in_runs import lost_in
        from tinygc.fit.physics.run import physics_methods
        from tinygc.fit.physics.run import run_errors as physics_errors

        ids = None if options.physics == ("auto",) else options.physics
        physics, more = physics_methods(problem, options, ids, lambda what: progress(what, 0, 1))
        fits |= more
        lost = tuple(lost_in(run) for run in runs)
        errors = [
            error | {name: physics_errors(run, fit, physics) for name, fit in more.items()} for run, error in zip(runs, errors, strict=True)
        ]
    found = goodness(problem.batch, problem.floor, linear.model, problem.middle_s)
    rates = problem.still_rates if options.still_rates else None
    covariance = found.excess * parameter_covariance(problem.batch, problem.floor, linear.model, problem.earth, rates, problem.middle_s)
    other = run_method("least_squares", problem, replace(options, still_rates=not options.still_rates))
    exact, first_order = (closure_angles(problem.batch, linear.model, name) for name in ("exact", "first-order"))
    return FitResult(
        problem=replace(problem, floor=floor),  # several days' weights are no noise
        options=options,
        methods=fits,
        runs=runs,
        run_errors=errors,
        physics=physics,
        lost_s=lost,
        goodness=found,
        linear=linear,
        covariance=covariance,
        other_choice=other,
        warnings=prepared.warnings,
        bias_sigma_rps=spread,
        reused=tuple(name for name in options.methods if name in known),
        first_order_rad=float(np.linalg.norm(first_order - exact, axis=1).max()),
    )


def closure_figures(angles: np.ndarray) -> dict[str, float | None]:
    """FORMATS' four figures of error angles (S, 2 or 3) rad, in degrees."""
    rms = np.sqrt(np.mean(angles**2, axis=0)) / DEG
    return {
        "tilt_rms_deg": float(np.hypot(rms[0], rms[1])),
        "roll_rms_deg": float(rms[0]),
        "pitch_rms_deg": float(rms[1]),
        "yaw_rms_deg": float(rms[2]) if angles.shape[1] == 3 else None,
    }


def run_figures(errors: np.ndarray) -> dict[str, float]:
    """FORMATS' figures of one closure run, from roll, pitch, yaw errors (3,) rad."""
    roll, pitch, yaw = (float(error) / DEG for error in errors)
    return {"roll_deg": roll, "pitch_deg": pitch, "yaw_deg": yaw, "rmse_deg": float(np.sqrt(np.mean(errors**2))) / DEG}


def to_json(result: FitResult) -> dict:
    """``tinygc-fit/1`` (FORMATS); what goes beyond it is added beside its keys."""
    problem = result.problem
    rejected = [segment for segment in problem.segments if not segment.accepted]
    earth = problem.earth
    return {
        "schema": SCHEMA,
        "session": result.session.name,
        "stills": len(problem.stills),
        "segments": {
            "found": len(problem.segments),
            "used": len(problem.used),
            "rejected": [{"segment": segment.number, "why": segment.problem} for segment in rejected],
            "notes": [{"segment": s.number, "note": s.note} for s in problem.segments if s.accepted and s.note],
        },
        "noise": {
            "gyro_dps_rthz": (problem.noise.gyro / DEG).tolist(),
            "accel_g_rthz": (problem.noise.accel / G).tolist(),
            "closure_floor_rms_deg": problem.floor.tilt_rms / DEG,
            **({} if result.physics is None else {"closure_floor_mended_rms_deg": result.physics.problem.floor.tilt_rms / DEG}),
        },
        "goodness": vars(result.goodness),
        "unobserved": result.linear.notes.get("unobserved", []),
        "earth": {
            "source": earth.source,
            "heading_deg": None if earth.heading_rad is None or earth.source == "unknown" else earth.heading_rad / DEG,
            "heading_sigma_deg": earth.heading_sigma_rad / DEG if earth.source == "estimated" else None,
        },
        "methods": {
            name: {
                "parameters": fit.parameters,
                "seconds": round(fit.seconds, 3),
                "train": closure_figures(fit.angles),
                "holdout": closure_figures(fit.held_out),
                **({"denoiser": fit.notes["denoiser"]} if "denoiser" in fit.notes else {}),
            }
            for name, fit in result.methods.items()
        },
        "closure_runs": [
            {
                "file": run.file,
                "duration_s": run.duration_s,
                "floor_rmse_deg": float(np.sqrt(np.mean(run.floor_rad**2))) / DEG,
                "earth": run.earth.source,
                **({} if result.physics is None else {"lost_at_s": np.round(result.lost_s[number], 3).tolist()}),
                **{name: run_figures(error) for name, error in errors.items()},
            }
            for number, (run, errors) in enumerate(zip(result.runs, result.run_errors, strict=True))
        ],
        "still_rates": {"used": result.options.still_rates, "other_choice_holdout": closure_figures(result.other_choice.held_out)},
        "options": {
            "seed": result.options.seed,
            "folds": min(result.options.folds, len(problem.used)),
            "integrator": result.options.integrator,
            "optimizer": result.options.optimizer,
            "loss": result.options.loss,
            "variant": result.options.variant,
            "parts": result.options.parts,
            "conditions": list(result.options.conditions),
            "bias_per_log": result.options.bias_per_log,
        },
        "version": VERSION,
    }


def save_models(result: FitResult, folder: Path | None = None) -> Path:
    """Write each method's model, and the figures, into a folder, the session's ``fit`` by default; returns that folder."""
    folder = folder or result.session.folder / "fit"
    hashes = input_hashes(result.session)
    with result_folder(folder):
        for name, fit in result.methods.items():
            more = {"method": name, "session": result.session.name, "sha256": hashes, "version": VERSION}
            if fit is result.linear:
                more["covariance"] = result.covariance.tolist()
                more["unobserved"] = fit.notes.get("unobserved", [])
            if name == "physics":
                from tinygc.fit.physics.covariance import covariance_table, rate_covariance

                more |= covariance_table(result.physics.model.claims, rate_covariance(result.physics.fit))
            if result.bias_sigma_rps is not None:
                more["bias_sigma_rps"] = result.bias_sigma_rps.tolist()
            write_whole(folder / f"model_{name}.json", models.to_dict(fit.model, **more))
        made = saved_fit.made_from(result.options, hashes, result.methods)
        write_whole(folder / "fit.json", to_json(result))
        write_whole(folder / saved_fit.NAME, made)
    return folder
