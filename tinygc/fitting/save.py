"""A fit's models and figures as files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from session.common.version import VERSION
from session.files.results import write_whole
from session.files.writing import result_folder
from session.log.hashes import input_hashes
from tinygc import models
from tinygc.fitting import saved_fit
from tinygc.fitting.fit_json import to_json
from tinygc.fitting.result import FitResult


def save_models(result: FitResult, folder: Path | None = None) -> Path:
    """Write each method's model, and the figures, into a folder, the session's ``fit`` by default; returns that folder.

    Raises CalibrationError where the session has no folder and none is given, and StorageError for what cannot be written.
    """
    folder = folder or result.session.own_folder("fit")
    with result_folder(folder):
        for name, table in model_tables(result).items():
            write_whole(folder / f"model_{name}.json", table)
        made = saved_fit.made_from(result.options, input_hashes(result.session), result.methods)
        write_whole(folder / "fit.json", to_json(result))
        write_whole(folder / saved_fit.NAME, made)
    return folder


def model_tables(result: FitResult) -> dict[str, dict]:
    """Each method's model as ``tinygc-model/1``, with what it was made from and how well it is known."""
    made_from = {"session": result.session.name, "sha256": input_hashes(result.session), "version": VERSION}
    tables = {}
    for name, fit in result.methods.items():
        more: dict[str, Any] = {"method": name, **made_from}
        if fit is result.linear:
            more["covariance"] = result.covariance.tolist()
            if result.accelerometer_covariance is not None:
                more["accelerometer_covariance"] = result.accelerometer_covariance.tolist()
            more["unobserved"] = fit.notes.get("unobserved", [])
        if name == "physics" and result.physics is not None:
            from tinygc.fitting.physics.covariance import covariance_table, rate_covariance

            more |= covariance_table(result.physics.model.claims, rate_covariance(result.physics.fit))
        if result.bias_sigma_rps is not None:
            more["bias_sigma_rps"] = result.bias_sigma_rps.tolist()
        tables[name] = models.to_dict(fit.model, **more)
    return tables
