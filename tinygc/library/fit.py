"""``tinygc.fit``: the main job, from a session to calibrations and how well they close."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group

from session.accelerometer.parameters import NAMES as ACCELEROMETER_NAMES
from session.accelerometer.parameters import PARAMETERS
from session.common.errors import FitError
from session.log.folder import Session
from tinygc.fitting.accelerometer import AccelerometerFit
from tinygc.fitting.figures import ClosureFigures, closure_figures, run_figures
from tinygc.fitting.fit_json import to_json
from tinygc.fitting.result import FitResult
from tinygc.fitting.save import model_tables, save_models
from tinygc.fitting.session import fit_session
from tinygc.library.text import as_html, as_text
from tinygc.methods.options import FitOptions
from tinygc.models.linear import NAMES
from tinygc.report.fit_text import fit_report

if TYPE_CHECKING:
    from tinygc.deploy.calibration import Calibration

#: told what is being done, and how many steps of how many are done
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Estimate:
    """One fitted number: its name, value and one sigma, in ``unit`` (SI; ``1`` where it has none)."""

    name: str
    value: float
    sigma: float
    unit: str

    def __repr__(self) -> str:
        return f"<{self.name} = {self.value:.6g} ± {self.sigma:.2g}{'' if self.unit == '1' else f' {self.unit}'}>"


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """What ``tinygc.fit`` gives; ``result`` holds everything that was found, in SI."""

    result: FitResult

    def __repr__(self) -> str:
        tilt = self.closure["least_squares" if "least_squares" in self.result.methods else next(iter(self.result.methods))]
        return (
            f"<Fit of {self.session.name}: {', '.join(self.result.methods)}; "
            f"{len(self.result.problem.used)} segments, held out {tilt['tilt_rms_deg']:.4f}°>"
        )

    @property
    def session(self) -> Session:
        """What was fitted."""
        return self.result.session

    @cached_property
    def parameters(self) -> dict[str, Estimate]:
        """Least squares' 12 parameters of omega = E m + B by name: ``E_xx`` … ``E_zz`` (of no unit), ``B_x``, ``B_y``, ``B_z`` in rad/s."""
        values, sigmas = self.result.linear.model.vector, np.sqrt(np.diag(self.result.covariance))  # type: ignore[attr-defined]
        return {
            name: Estimate(name, float(value), float(sigma), "1" if name.startswith("E") else "rad/s")
            for name, value, sigma in zip(NAMES, values, sigmas, strict=True)
        }

    @property
    def accelerometer(self) -> AccelerometerFit:
        """That the references rest on: ``mode`` (given, fit, prior), ``calibration``, ``unobserved``, ``p_value``, ``spread_mps2``."""
        return self.result.accelerometer

    @cached_property
    def accelerometer_parameters(self) -> dict[str, Estimate]:
        """The accelerometer's nine numbers of f = M (measured - b) in its own triad: ``scale_x`` … (M's diagonal less 1),
        ``nonorthogonality_xy``, ``_xz``, ``_yz`` (above it), both of no unit, and ``bias_x`` … in m/s^2.

        A sigma is NaN where the calibration was taken as given.  Names of ``accelerometer.unobserved`` were not told by the session.
        """
        found = self.accelerometer
        sigmas = np.full(PARAMETERS, np.nan) if found.sigmas is None else found.sigmas
        names = [name.replace(" ", "_") for name in ACCELEROMETER_NAMES]
        return {
            name: Estimate(name, float(value), float(sigma), "m/s^2" if name.startswith("bias") else "1")
            for name, value, sigma in zip(names, found.values, sigmas, strict=True)
        }

    @property
    def covariance(self) -> np.ndarray:
        """(12, 12) of ``parameters``, in their order and units."""
        return self.result.covariance

    @cached_property
    def closure(self) -> dict[str, ClosureFigures]:
        """Held-out closure by method, degrees rms: ``tilt_rms_deg``, ``roll_rms_deg``, ``pitch_rms_deg``, ``yaw_rms_deg`` (or None)."""
        return {name: closure_figures(fit.held_out) for name, fit in self.result.methods.items()}

    @cached_property
    def closure_runs(self) -> dict[str, dict[str, dict[str, float]]]:
        """Error at the return of each closure run, by file and method, degrees: ``roll_deg``, ``pitch_deg``, ``yaw_deg``, ``rmse_deg``."""
        pairs = zip(self.result.runs, self.result.run_errors, strict=True)
        return {run.file: {name: run_figures(error) for name, error in errors.items()} for run, errors in pairs}

    @cached_property
    def models(self) -> dict[str, Calibration]:
        """The calibration of each method, ready for use."""
        from tinygc.deploy.calibration import Calibration

        rate_hz = 1 / self.result.problem.logs[0].samples.period_s
        tables = model_tables(self.result)
        return {name: Calibration(fit.model, rate_hz, tables[name]) for name, fit in self.result.methods.items()}

    @property
    def model(self) -> Calibration:
        """Least squares' calibration.  Raises FitError where that method was not among those asked for."""
        if "least_squares" not in self.models:
            raise FitError(f"least_squares was not fitted; take one of models: {', '.join(self.models)}")
        return self.models["least_squares"]

    @property
    def page(self) -> Group:
        """What the command prints, for rich."""
        return fit_report(self.result)

    def summary(self) -> str:
        """The same as plain text: closure by method, closure runs, parameters with their sigmas, and what to know about them."""
        return as_text(self.page)

    def _repr_html_(self) -> str:
        return as_html(self.page)

    def to_json(self) -> dict:
        """``tinygc-fit/1`` (docs/formats.md)."""
        return to_json(self.result)

    def save(self, folder: Path | str | None = None) -> Path:
        """Write each method's model, and the figures, into a folder (``fit`` in the session's); returns it."""
        return save_models(self.result, None if folder is None else Path(folder))


def fit(
    session: Session | Path | str,
    options: FitOptions | None = None,
    *,
    progress: Progress = lambda what, done, of: None,
    **choices: Any,
) -> Fit:
    """Fit the calibration of a session, or of a session folder, by all methods that are asked for.

    options, or single ones of them by name (``methods=("least_squares",)``, ``still_rates=True``, ``physics=("auto",)``): see
    ``FitOptions``; progress is told what is being done.  Raises CalibrationError, in one line, for what cannot be read or fitted.
    """
    where = session if isinstance(session, Session) else Path(session)
    return Fit(fit_session(where, replace(options or FitOptions(), **choices), progress))
