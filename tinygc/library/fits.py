"""``tinygc.fit``: the calibrations of a session, and what can be made of them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, partial
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from session.base.errors import FitError
from session.base.numeric import sigmas_in
from session.base.progress import Progress, no_report
from session.log.config import Config, read_config
from session.log.folder import Session
from tinygc.deploy import ExportOptions
from tinygc.estimation.accelerometer import AccelerometerFit
from tinygc.estimation.choice import ClosureFigures, closure_figures, run_figures
from tinygc.estimation.options import FitOptions
from tinygc.fitting.fit import fit_session
from tinygc.fitting.fit_file import model_tables, save_models, to_json
from tinygc.fitting.results import FitResult
from tinygc.library.arguments import chosen, public
from tinygc.library.records import Estimate, Named, Shown, accelerometer_estimates
from tinygc.library.sources import session_or_folder
from tinygc.models.linear import NAMES
from tinygc.reporting import ReportOptions
from tinygc.reporting.fit_screen import verdict_lines
from tinygc.reporting.fit_text import fit_report, sensor_errors
from tinygc.reporting.terminal import Group
from tinygc.verdict.acceptance import Acceptance

if TYPE_CHECKING:
    from tinygc.deploy.calibration import Calibration
    from tinygc.library.reports import Exported, Report
    from tinygc.reporting.drawing import Picture

#: the terms that a fit prints
SENSOR_ERRORS = ("scale factor error", "misalignment", "bias")

# ``tinygc.fit``: fit calibrations to a session and report their closure.


@dataclass(frozen=True, eq=False, repr=False)
class Fit(Shown):
    """What ``tinygc.fit`` returns: parameters with their sigmas, closure of each method, models; its report and exports."""

    #: complete result of the fit, in SI
    result: FitResult
    #: the session that was fitted, or its folder
    source: Session | Path

    def __repr__(self) -> str:
        tilt = self.closure["least_squares" if "least_squares" in self.result.methods else next(iter(self.result.methods))]
        return (
            f"<Fit of {self.session.name}: {', '.join(self.result.methods)}; "
            f"{len(self.result.problem.used)} segments, held out {tilt['tilt_rms_deg']:.4f}°>"
        )

    @property
    def session(self) -> Session:
        """The fitted session, with the accelerometer's calibration of the fit."""
        return self.result.session

    @property
    def config(self) -> Config:
        """The configuration of the session as it was given to the fit."""
        return self.source.config if isinstance(self.source, Session) else read_config(self.source / "session.toml")

    @cached_property
    def parameters(self) -> Named[Estimate]:
        """The 12 least-squares parameters of omega = E m + B by name: ``E_xx`` … ``E_zz`` (unitless), ``B_x`` … ``B_z`` in rad/s."""
        values, sigmas = self.result.linear.linear.vector, sigmas_in(self.result.covariance)
        return Named(
            (name, Estimate(name, float(value), float(sigma), "1" if name.startswith("E") else "rad/s"))
            for name, value, sigma in zip(NAMES, values, sigmas, strict=True)
        )

    @cached_property
    def sensor_errors(self) -> Named[Estimate]:
        """Errors of the sensor, as ``fit`` prints it: ``scale_factor_error_x`` … in ppm, ``misalignment_x_to_y`` … in mrad, ``bias_x`` …
        in dps; NaN where the session does not observe it."""
        found = [quantity for quantity in sensor_errors(self.result) if quantity.word in SENSOR_ERRORS]
        named = ((quantity.name.replace(" ", "_"), quantity) for quantity in found)
        return Named(
            (name, Estimate(name, q.value, q.sigma, q.unit) if q.observed else Estimate(name, nan, nan, q.unit)) for name, q in named
        )

    @property
    def accelerometer(self) -> AccelerometerFit:
        """The accelerometer that gives the references: ``mode`` (given, fit, prior), ``calibration``, ``unobserved``, ``p_value``,
        ``spread_mps2``."""
        return self.result.accelerometer

    @cached_property
    def accelerometer_parameters(self) -> Named[Estimate]:
        """The accelerometer's nine numbers of f = M (measured - b) in its own triad: ``scale_x`` … (M's diagonal less 1),
        ``nonorthogonality_xy``, ``_xz``, ``_yz`` (above it), both unitless, and ``bias_x`` … in m/s^2.

        A sigma is NaN if the calibration was taken as given.  The session does not observe those named in ``accelerometer.unobserved``.
        """
        return Named(accelerometer_estimates(self.accelerometer))

    @property
    def covariance(self) -> np.ndarray:
        """Covariance (12, 12) of ``parameters``, in their order and units."""
        return self.result.covariance

    @cached_property
    def closure(self) -> Named[ClosureFigures]:
        """Held-out closure by method, degrees rms: ``tilt_rms_deg``, ``roll_rms_deg``, ``pitch_rms_deg``, ``yaw_rms_deg`` (or None)."""
        return Named((name, closure_figures(fit.held_out)) for name, fit in self.result.methods.items())

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
        """The least-squares calibration.  Raises FitError if that method was not requested."""
        if "least_squares" not in self.models:
            raise FitError(f"least_squares was not fitted; take one of models: {', '.join(self.models)}")
        return self.models["least_squares"]

    def verdict(self, limit_deg: float | None = None) -> Acceptance:
        """PASS, NOT DECIDED or FAIL (``word``), with its ``headline``, ``rule``, ``reasons`` and ``doubts``."""
        return self.result.verdict(limit_deg)

    @property
    def page(self) -> Group:
        """What ``fit --verbose`` prints, as a rich renderable."""
        return Group(*verdict_lines(self.verdict(), reasons=True), fit_report(self.result))

    def to_frame(self) -> Any:
        """The parameters as a pandas DataFrame, a row for each.  Raises CalibrationError where pandas is not installed."""
        return self.parameters.to_frame()

    @public()
    def plot(self, path: Path | str | None = None) -> Picture:
        """Draw the closure of each segment, raw and calibrated, and the sensor errors with their sigmas; path: an SVG to write."""
        from tinygc.reporting.drawing import saved
        from tinygc.reporting.pictures.fit import picture_of_fit

        return saved(picture_of_fit(self.result, SENSOR_ERRORS, sensor_errors(self.result)), path)

    @public(ReportOptions)
    def report(self, path: Path | str | None = None, *, progress: Progress | None = None, **choices: Any) -> Report:
        """Make the calibration report, and write it as one HTML file if a path is given; as ``tinygc.report`` of this fit."""
        from tinygc.library.reports import report_of  # with the search for effects, which a plain fit does not need

        return report_of(self.source, self.result.options, self.result, path, ReportOptions(**choices), progress)

    @public(ExportOptions)
    def export(self, to: str, folder: Path | str | None = None, **choices: Any) -> Exported:
        """Make the files of a calibration for another program, and write them if a folder is given; as ``tinygc.export`` of this fit."""
        from tinygc.deploy.exports._context import context_of_fit
        from tinygc.library.reports import exported

        return exported(to, folder, choices, partial(context_of_fit, self.result))

    def to_json(self, limit_deg: float | None = None) -> dict:
        """``tinygc-fit/2`` (docs/formats.md); limit_deg: of the verdict."""
        return to_json(self.result, limit_deg)

    @public()
    def save(self, folder: Path | str | None = None, limit_deg: float | None = None) -> Path:
        """Write each method's model and the figures into a folder (``fit`` in the session's folder by default); returns it."""
        return save_models(self.result, None if folder is None else Path(folder), limit_deg)


@public(FitOptions)
def fit(session: Session | Path | str, options: FitOptions | None = None, *, progress: Progress | None = None, **choices: Any) -> Fit:
    """Fit the calibration ``omega = E m + B`` of a session, and the other methods that are chosen.

    Parameters
    ----------
    session : Session, table, str or Path
        The recording, or its folder.  Rates are in rad/s, specific force in m/s^2, both (N, 3) in body axes forward, right, down.
    options : FitOptions, optional
        Options that decide the fit's numbers.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.

    Returns
    -------
    Fit
        ``parameters`` (E without unit, B in rad/s), ``covariance`` (12, 12), ``closure`` in degrees, ``models``.

    Raises
    ------
    CalibrationError
        For data that cannot be read or fitted, and for a wrong option; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> simulated = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1)
    >>> result = tinygc.fit(simulated.session, methods=("least_squares",))
    >>> result.parameters["B_x"].unit
    'rad/s'
    >>> abs(result.parameters["E_xx"].value - simulated.truth["E"][0][0]) < 5 * result.parameters["E_xx"].sigma
    True

    """
    where, options = session_or_folder(session), chosen(FitOptions, options, choices)
    if options.physics is None:
        return Fit(fit_session(where, options, progress or no_report), where)
    from tinygc.explanation.physics import physics_methods

    return Fit(fit_session(where, options, progress or no_report, physics=physics_methods), where)
