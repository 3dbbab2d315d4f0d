"""A fit as files: ``fit.json`` (``tinygc-fit/2``), which other commands read, and its models."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from session import VERSION
from session.base.errors import FormatError
from session.base.files import result_folder
from session.base.numeric import rms_of
from session.base.records import in_unit, plain, table_of, write_whole
from session.base.results import Array, Flag, Keys, ListOf, MapOf, Maybe, Number, Shape, Text, read_required, require
from session.base.units import DEG, G
from session.log.folder import file_key, input_hashes
from tinygc import models
from tinygc.closure.problem import Problem
from tinygc.estimation.accelerometer import JOINT_NAMES
from tinygc.estimation.choice import closure_figures, run_figures
from tinygc.estimation.options import METHODS
from tinygc.estimation.physics import rate_covariance
from tinygc.estimation.spread import ACCELEROMETER, ZERO
from tinygc.fitting.results import AT_END, PHYSICS, FitResult
from tinygc.models.linear import BIAS
from tinygc.models.model import accelerometer_table, sensor_table

SCHEMA = "tinygc-fit/2"


def to_json(result: FitResult, limit_deg: float | None = None) -> dict:
    """Return the result as ``tinygc-fit/2`` (docs/formats.md); limit_deg: of the verdict."""
    problem = result.problem
    earth = problem.earth
    return plain(
        {
            "schema": SCHEMA,
            "session": result.session.name,
            "stills": len(problem.stills),
            "nominal_rate": None if result.nominal_rate is None else asdict(result.nominal_rate),
            "segments": segments_table(problem) | {"variance_inflation": problem.widened},
            "rests_not_used": [
                {"log": log, "at_s": round(rest.start_s, 3), "duration_s": round(rest.duration_s, 3), "cause": rest.cause, "why": rest.why}
                for log, rest in problem.unused_rests
            ],
            "noise": {
                "gyro_dps_rthz": problem.noise.gyro / DEG,
                "accel_g_rthz": problem.noise.accel / G,
                **problem.instability.to_json(),
                **({} if problem.at_rest is None else {"at_rest": problem.at_rest}),
                "closure_floor_rms_deg": problem.floor.tilt_rms / DEG,
                "closure_all_rms_deg": None if result.noise is None else result.noise.tilt_rms / DEG,
                "components": [] if result.noise is None else result.noise.to_json(),
                **({} if result.physics is None else {"closure_floor_repaired_rms_deg": result.physics.problem.floor.tilt_rms / DEG}),
            },
            "accelerometer": {**result.accelerometer.to_json(), "effects": [] if result.physics is None else result.physics.of_force},
            "goodness": vars(result.goodness),
            "bias_any_session": result.spread.at(ZERO).to_json(np.diag(result.covariance)[BIAS]),
            "systematic": None if result.allowed is None else result.allowed.to_json(),
            "sources": result.sources,
            "bias_from": result.bias_from.to_json(),
            **({} if result.prior is None else result.prior.to_json()),
            "known_turns": known_turns_json(result),
            "truth": None if result.session.reference is None else result.session.reference.table,
            "unobserved": result.linear.unobserved,
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
            "not_run": [{"method": name, "why": why} for name, why in result.not_run.items()],
            "use": {**table_of(result.use), "model": result.file_to_use},
            "against_raw": result.against_raw,
            "verdict": result.verdict(limit_deg).to_json(),
            "closure_runs": [
                {
                    "file": run.file,
                    "duration_s": run.duration_s,
                    "floor_rmse_deg": rms_of(run.floor_rad) / DEG,
                    "earth": run.earth.source,
                    **({} if result.physics is None else {"lost_at_s": np.round(result.physics.lost_s[number], 3)}),
                    **{name: run_figures(error) for name, error in errors.items()},
                }
                for number, (run, errors) in enumerate(zip(result.runs, result.run_errors, strict=True))
            ],
            "options": {
                "seed": result.options.seed,
                "folds": min(result.options.folds, len(problem.used)),
                "bias": result.options.bias,
                "accelerometer": result.options.accelerometer,
                "clock": result.options.clock,
            },
            "version": VERSION,
        }
    )


def segments_table(problem: Problem) -> dict:
    """Return which segments there are, why one is not used, and the stills between them that a person changed."""
    return {
        "found": len(problem.segments),
        "used": len(problem.used),
        "rejected": [{"segment": each.number, "why": each.problem} for each in problem.segments if not each.accepted],
        "notes": [{"segment": each.number, "note": each.note} for each in problem.segments if each.accepted and each.note],
        "stills_by_hand": problem.session.config.still,
    }


# A fit's errors on turns whose angle is known beforehand.


def known_turns_json(result: FitResult) -> list[dict]:
    """Return ``known_turns`` of ``tinygc-fit/2``: every row of turns.csv; errors of least squares, predicted less stated."""
    problem, found = result.problem, []
    row = {segment.number: i for i, segment in enumerate(problem.used)}
    for turn in problem.known_turns:
        i = row.get(turn.segment.number) if turn.problem is None and turn.segment is not None else None
        error, held_out = (None, None) if i is None else (result.linear.angles[i, 2], result.linear.held_out[i, 2])
        found.append(
            {
                "turn": turn.known.turn,
                "log": turn.known.log,
                "segment": None if turn.segment is None else turn.segment.number,
                "axis": turn.known.axis,
                "angle_deg": turn.known.angle_rad / DEG,
                "sigma_deg": turn.known.sigma_rad / DEG,
                "gyro_deg": None if turn.reads is None else turn.along_rad / DEG,
                "used": i is not None,
                "why_not": turn.problem,
                **in_unit(DEG, error_deg=error, holdout_error_deg=held_out),
            }
        )
    return found


def known_turns_words(result: FitResult) -> str:
    """Summarise them in one line for the terminal; empty where no turn has a known angle."""
    turns = known_turns_json(result)
    if not turns:
        return ""
    used = [turn for turn in turns if turn["used"]]
    unused = f"; {len(turns) - len(used)} of {len(turns)} not used" if len(used) < len(turns) else ""
    if not used:
        where = "turns=" if result.session.in_memory else "turns.csv"
        return f"{where}: none of {len(turns)} turns of known angle is used, see the first look"
    each = ", ".join(f"{t['segment']} ({t['angle_deg']:g}° ± {t['sigma_deg']:g}°, left {t['error_deg']:+.3f}°)" for t in used)
    return f"turns of known angle: segment{'s' * (len(used) != 1)} {each}{unused}"


# ``fit.json`` as ``export`` and ``compare`` read it; keys that are not used are not checked.

#: dps and g per root Hz: a thousandth of any sensor's range
_DENSITY = Array((3,), Number(0, 1e3))
_TILT_DEG = Maybe(Number(0, 1e4))
_NOISE: dict[str, Shape] = {
    "gyro_dps_rthz": _DENSITY,
    "accel_g_rthz": _DENSITY,
    "gyro_bias_instability_dph": Maybe(Number(0, 1e9)),
    "gyro_bias_instability_source": Maybe(Text()),
    "closure_floor_rms_deg": _TILT_DEG,
}
_ACCELEROMETER: dict[str, Shape] = {
    "mode": Text(("given", "fit", "prior")),
    "unobserved": Maybe(ListOf(Text())),
    "zero_drift": Maybe(Keys(may={"significant": Flag()})),
    "effects": Maybe(ListOf(Keys({"id": Text()}))),
}
FILE_SHAPE = Keys(
    {"schema": Text((SCHEMA,))},
    {
        "session": Text(),
        "segments": Keys(may={"used": Number(0, whole=True)}),
        "noise": Keys(may=_NOISE),
        "accelerometer": Maybe(Keys(may=_ACCELEROMETER)),
        "goodness": Maybe(Keys({"p_value": Number(0, 1)})),
        "methods": MapOf(Keys(may={"holdout": Keys(may={"tilt_rms_deg": _TILT_DEG})})),
        "against_raw": Maybe(Keys(may={"tilt_rms_deg": _TILT_DEG})),
        "verdict": Maybe(Keys(may={"answer": Text(), "headline": Text()})),
        "use": Maybe(Keys(may={"method": Maybe(Text()), "model": Maybe(Text()), "why": Maybe(Text())})),
    },
)

#: figures that the export of a model requires: its held-out closure, the number of turns, and the sensor's noise
EVALUATED = Keys(
    {
        "session": Text(),
        "segments": Keys({"used": Number(0, whole=True)}),
        "noise": Keys({"gyro_dps_rthz": _DENSITY, "accel_g_rthz": _DENSITY}),
        "methods": MapOf(Keys({"holdout": Keys({"tilt_rms_deg": _TILT_DEG})})),
        "against_raw": Keys({"tilt_rms_deg": _TILT_DEG}),
    }
)


def read_evaluated(path: Path, do: str, method: str) -> dict:
    """Read the figures of a fit that decide whether its model of that method may be exported.  A method that ``fit`` does not have, for
    another program's model, may be absent.  Raises FormatError as ``read_fit``."""
    fit = read_fit(path, do)
    require(fit, EVALUATED, str(path), do)
    if method in METHODS and method not in fit["methods"]:
        raise FormatError(f"{path}: methods.{method} is missing, expected how well that model closes held-out turns; {do}")
    return fit


def read_fit(path: Path, do: str = "fit again") -> dict:
    """Read the figures of a fit.  Raises FormatError with the key, what was expected there, and ``do``."""
    return read_required(path, FILE_SHAPE, do)


# The files of a fit, and its models.


def save_models(result: FitResult, folder: Path | None = None, limit_deg: float | None = None) -> Path:
    """Write each method's model, and the figures, into a folder, the session's ``fit`` by default; returns that folder.

    limit_deg: of the verdict.  Raises CalibrationError where the session has no folder and none is given, and StorageError for what
    cannot be written.
    """
    folder = folder or result.session.own_folder("fit")
    with result_folder(folder):
        tables = model_tables(result)
        for name, table in tables.items():
            write_whole(folder / f"model_{name}.json", table)
            if name + AT_END not in tables:  # from an earlier fit, whose physics followed time
                (folder / f"model_{name}{AT_END}.json").unlink(missing_ok=True)
        write_whole(folder / "fit.json", to_json(result, limit_deg))
    return folder


def model_tables(result: FitResult) -> dict[str, dict]:
    """Return each method's model as ``tinygc-model/1``, with its inputs and its uncertainty.

    Where one follows its session's time, there is a second for any time, NAME_at_end, as of the session's end.
    """
    # Models that use specific force, and users of calibrated force, need it in addition to the rates.
    made_from: dict[str, Any] = {
        "session": result.session.name,
        "sha256": input_hashes(result.session),
        "version": VERSION,
        "clock": result.options.clock,
        "sensor": sensor_table(result.session.config.sensor),
    }
    if (temperature_c := result.session.temperature_c) is not None:
        made_from["temperature_c"] = temperature_c
    tables = {}
    for name, fit in result.methods.items():
        # Models with physics may depend on another calibration of the accelerometer than those without.
        problem = result.physics.problem if result.physics is not None and name in PHYSICS else result.problem
        made_from["accelerometer"] = accelerometer_table(problem.session.config.accelerometer)
        more: dict[str, Any] = {"method": name, **made_from}
        if fit is result.linear:
            more |= {} if result.prior is None else result.prior.of_model()
            more["covariance"] = result.covariance
            if result.accelerometer_covariance is not None:
                more["accelerometer_covariance"] = result.accelerometer_covariance
            if result.joint_covariance is not None and result.joint_shared is not None:
                more["joint_covariance"] = {
                    "parameters": JOINT_NAMES,
                    "matrix": result.joint_covariance,
                    "shared": result.joint_shared,
                }
            more["unobserved"] = fit.unobserved
        ended: dict[str, Any] = {"method": name + AT_END, **made_from}
        if name == "physics" and result.physics is not None:
            from tinygc.estimation.physics import covariance_at_end, covariance_table

            covariance = rate_covariance(result.physics.fit, result.session.clock)
            more |= covariance_table(result.physics.model.claims, covariance)
            ended |= covariance_at_end(result.physics.model, covariance)
        for key, which in (("bias_sigma_rps", ZERO), ("accelerometer_spread", ACCELEROMETER)):
            if not (spread := result.spread.at(which)).is_usual:
                more[key] = spread.sigma
        if fit.model.session_s is not None and result.physics is not None:
            problem = result.physics.problem  # s of the session at which each log begins
            more["began_s"] = {
                file_key(log.path): float(moment) for log, moment in zip(problem.session.logs, problem.began_s[:-1], strict=True)
            }
            tables[name + AT_END] = models.to_dict(fit.model.at_end(), **ended)
        tables[name] = models.to_dict(fit.model, **more)
    return tables
