"""A fit's models and figures as files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from session.common.version import VERSION
from session.files.results import write_whole
from session.files.writing import result_folder
from session.log.hashes import file_key, input_hashes
from tinygc import models
from tinygc.fitting import saved_fit
from tinygc.fitting.accelerometer import JOINT_NAMES
from tinygc.fitting.fit_json import to_json
from tinygc.fitting.result import AT_END, PHYSICS, FitResult
from tinygc.models.accelerometer import accelerometer_table, sensor_table
from tinygc.problem.problem import Problem


def save_models(result: FitResult, folder: Path | None = None) -> Path:
    """Write each method's model, and the figures, into a folder, the session's ``fit`` by default; returns that folder.

    Raises CalibrationError where the session has no folder and none is given, and StorageError for what cannot be written.
    """
    folder = folder or result.session.own_folder("fit")
    with result_folder(folder):
        tables = model_tables(result)
        for name, table in tables.items():
            write_whole(folder / f"model_{name}.json", table)
            if name + AT_END not in tables:  # of a fit before this one, whose physics followed time
                (folder / f"model_{name}{AT_END}.json").unlink(missing_ok=True)
        made = saved_fit.made_from(result.options, input_hashes(result.session), result.methods)
        write_whole(folder / "fit.json", to_json(result))
        write_whole(folder / saved_fit.NAME, made)
    return folder


def model_tables(result: FitResult) -> dict[str, dict]:
    """Each method's model as ``tinygc-model/1``, with what it was made from and how well it is known.

    Where one follows its session's time, there is a second for any time, NAME_at_end, as of the session's end.
    """
    # What looks at specific force, and whoever wants it calibrated, needs it beside the rates.
    made_from = {
        "session": result.session.name,
        "sha256": input_hashes(result.session),
        "version": VERSION,
        "sensor": sensor_table(result.session.config.sensor),
    }
    tables = {}
    for name, fit in result.methods.items():
        # What is fitted with physics may rest on another calibration of the accelerometer than what is fitted without.
        problem = result.physics.problem if result.physics is not None and name in PHYSICS else result.problem
        made_from["accelerometer"] = accelerometer_table(problem.session.config.accelerometer)
        more: dict[str, Any] = {"method": name, **made_from}
        if fit is result.linear:
            if result.lot is not None:
                more["lot"] = {key: result.lot.to_json()[key] for key in ("file", "hash", "used", "belongs_probability")}
            more["covariance"] = result.covariance.tolist()
            if result.accelerometer_covariance is not None:
                more["accelerometer_covariance"] = result.accelerometer_covariance.tolist()
            if result.joint_covariance is not None and result.joint_shared is not None:
                more["joint_covariance"] = {
                    "parameters": list(JOINT_NAMES),
                    "matrix": result.joint_covariance.tolist(),
                    "shared": result.joint_shared.tolist(),
                }
            more["unobserved"] = fit.notes.get("unobserved", [])
        ended: dict[str, Any] = {"method": name + AT_END, **made_from}
        if name == "physics" and result.physics is not None:
            from tinygc.fitting.physics.covariance import covariance_at_end, covariance_table, rate_covariance

            covariance = rate_covariance(result.physics.fit)
            more |= covariance_table(result.physics.model.claims, covariance)
            ended |= covariance_at_end(result.physics.model, covariance)
        if result.bias_sigma_rps is not None:
            more["bias_sigma_rps"] = result.bias_sigma_rps.tolist()
        if fit.model.session_s is not None and result.physics is not None:
            more["began_s"] = _began_s(result.physics.problem)
            tables[name + AT_END] = models.to_dict(fit.model.at_end(), **ended)
        tables[name] = models.to_dict(fit.model, **more)
    return tables


def _began_s(problem: Problem) -> dict[str, float]:
    """Of each log, s of the session at which it begins."""
    return {file_key(log.path): float(moment) for log, moment in zip(problem.session.logs, problem.began_s[:-1], strict=True)}
