"""What a recording closes to, whatever ``check`` says of it: before and after its repair."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

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


@dataclass(frozen=True)
class RecordingClosure:
    """turns used; scale (3,): what least squares multiplies the rates by; tilt_deg: held out, by method; runs_deg: RMSE by closure run and
    method; why: the reason why there is none of it, or nothing."""

    turns: int = 0
    scale: tuple[float, ...] = ()
    tilt_deg: dict[str, float] = field(default_factory=dict)
    runs_deg: dict[str, dict[str, float]] = field(default_factory=dict)
    why: str = ""

    def to_json(self) -> dict:
        """Return ``closure.before`` and ``closure.after`` of ``tinygc-repair/1``."""
        return {
            "turns": self.turns,
            "scale": list(self.scale) or None,
            "holdout_tilt_rms_deg": self.tilt_deg or None,
            "runs": [{"file": file, "rmse_deg": errors} for file, errors in self.runs_deg.items()],
            "why": self.why,
        }


def closure_of(folder: Path) -> RecordingClosure:
    """Fit a session folder by least squares, and compare with the raw rates."""
    try:
        session, _ = with_own_accelerometer(read_session(folder))
        problem = build_problem(with_bridges(session))
        options = FitOptions(methods=METHODS)
        fits = {name: run_method(name, problem, options) for name in METHODS}
        runs = read_closure_runs(problem)
    except CalibrationError as error:
        return RecordingClosure(why=str(error).removeprefix(f"{folder}: "))
    return RecordingClosure(
        turns=len(problem.used),
        scale=tuple(np.linalg.norm(fits["least_squares"].linear.E, axis=0).tolist()),
        tilt_deg={name: closure_figures(fit.held_out)["tilt_rms_deg"] for name, fit in fits.items()},
        runs_deg={run.file: {name: run_figures(run.errors(fit.model))["rmse_deg"] for name, fit in fits.items()} for run in runs},
    )
