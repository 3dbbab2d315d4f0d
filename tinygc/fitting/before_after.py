"""What a recording closes to, whatever ``check`` says of it: before and after its repair."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import CalibrationError
from session.detect.check_references import with_own_accelerometer
from session.detect.check_samples import with_bridges
from session.log.folder import read_session
from tinygc.closure.build import build_problem
from tinygc.closure.runs import read_closure_runs
from tinygc.estimation.choice import closure_figures, run_figures
from tinygc.estimation.held_out import run_method
from tinygc.estimation.options import FitOptions

#: measured rates less the first still's mean show the recording as it is; least squares shows what a calibration leaves
METHODS = ("raw_bias_removed", "least_squares")


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
        options = FitOptions(methods=METHODS)
        fits = {name: run_method(name, problem, options) for name in METHODS}
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
