"""A fit's models and figures as files."""

from __future__ import annotations

from pathlib import Path

import tinygc
from session.common.files import write_whole
from session.common.writing import result_folder
from session.log.hashes import input_hashes
from tinygc import models
from tinygc.fit import saved_fit
from tinygc.fit.fit_json import to_json
from tinygc.fit.result import FitResult


def save_models(result: FitResult, folder: Path | None = None) -> Path:
    """Write each method's model, and the figures, into a folder, the session's ``fit`` by default; returns that folder."""
    folder = folder or result.session.folder / "fit"
    hashes = input_hashes(result.session)
    with result_folder(folder):
        for name, fit in result.methods.items():
            more = {"method": name, "session": result.session.name, "sha256": hashes, "version": tinygc.__version__}
            if fit is result.linear:
                more["covariance"] = result.covariance.tolist()
                more["unobserved"] = fit.notes.get("unobserved", [])
            if name == "physics" and result.physics is not None:
                from tinygc.fit.physics.covariance import covariance_table, rate_covariance

                more |= covariance_table(result.physics.model.claims, rate_covariance(result.physics.fit))
            if result.bias_sigma_rps is not None:
                more["bias_sigma_rps"] = result.bias_sigma_rps.tolist()
            write_whole(folder / f"model_{name}.json", models.to_dict(fit.model, **more))
        made = saved_fit.made_from(result.options, hashes, result.methods)
        write_whole(folder / "fit.json", to_json(result))
        write_whole(folder / saved_fit.NAME, made)
    return folder
