"""``tinygc.check``, ``tinygc.fit`` and ``tinygc.simulate``: each takes a session and returns a result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from functools import cached_property, wraps
from inspect import signature
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, ParamSpec, TypeVar

import numpy as np

from session.detect.accelerometer import NAMES as ACCELEROMETER_NAMES
from session.detect.accelerometer import PARAMETERS
from session.detect.findings import Finding, worst
from session.detect.first_look import check_folder, check_session
from session.detect.stills import SessionStills
from session.io.annexes import need
from session.io.config import Accelerometer, Protocol, Site
from session.io.errors import CalibrationError, DataError, FitError
from session.io.folder import Session
from session.io.names import is_array
from session.io.units import DEG, G
from tinygc.closure.prepared import first_look_at_fit
from tinygc.effects import Effect, Movement, effect_of
from tinygc.effects.movement import vibration
from tinygc.estimation.accelerometer import AccelerometerFit
from tinygc.estimation.choice import ClosureFigures, closure_figures, run_figures
from tinygc.estimation.fit import fit_session
from tinygc.estimation.options import FitOptions
from tinygc.estimation.results import FitResult, model_tables, save_models, to_json
from tinygc.estimation.verdict import Acceptance
from tinygc.models.linear import NAMES
from tinygc.reporting.fit_screen import verdict_text
from tinygc.reporting.fit_text import fit_report
from tinygc.reporting.terminal import Group, as_html, as_text
from tinygc.simulation.options import BIAS_DIGITS, MATRIX_DIGITS, SimulationOptions
from tinygc.simulation.simulator import Distort, RegisterLog, Simulation, plan_of, simulate_session
from tinygc.simulation.write import stopped_turns, truth_table, write_simulation

if TYPE_CHECKING:
    from tinygc.deploy.calibration import Calibration


# Options and arguments of the public functions.

#: progress callback: current step's description, steps done, steps in all
Progress = Callable[[str, int, int], None]
P = ParamSpec("P")
R = TypeVar("R")
Options = TypeVar("Options", FitOptions, SimulationOptions)


def public(options: type | None = None) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Decorate a public function: an unknown keyword raises a CalibrationError that names the right one.

    options: a class whose fields are keywords of the function as well.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        parameters = [each.name for each in signature(function).parameters.values() if each.kind is not each.VAR_KEYWORD]
        known = [*parameters, *([] if options is None else (each.name for each in fields(options)))]

        @wraps(function)
        def call(*args: P.args, **keywords: P.kwargs) -> R:
            for name in keywords:
                if name not in known:
                    near = get_close_matches(name, known, 1, 0.5)
                    hint = f"did you mean {near[0]}?" if near else f"expected some of {', '.join(known)}"
                    raise CalibrationError(f"{function.__name__}: no option {name!r}; {hint}")
            if keywords.get("progress") is not None and not callable(keywords["progress"]):
                raise CalibrationError(f"progress is {keywords['progress']!r}, expected a function of three arguments: what, done, of")
            try:
                signature(function).bind(*args, **keywords)
            except TypeError as error:
                raise CalibrationError(f"{function.__name__}: {error}; it takes {', '.join(parameters)}") from None
            return function(*args, **keywords)

        return call

    return decorate


def session_or_folder(session: Any) -> Session | Path:
    """Return a session, or the path of its folder; CalibrationError for anything else."""
    if isinstance(session, Session):
        return session
    if isinstance(session, str | PathLike):
        return Path(session)
    raise CalibrationError(f"session is of type {type(session).__name__}, expected a tinygc.Session or the path of its folder")


def nothing(what: str, done: int, of: int) -> None:
    """Ignore progress; the default callback."""


def chosen(kind: type[Options], options: Options | None, choices: dict[str, Any]) -> Options:
    """Return options of a kind with single fields replaced; CalibrationError if ``options`` are of another kind."""
    if options is not None and not isinstance(options, kind):
        raise CalibrationError(f"options is of type {type(options).__name__}, expected tinygc.{kind.__name__}")
    return replace(kind() if options is None else options, **choices)


# ``tinygc.check``: the first look at a session, or at a folder whose logs may be unreadable.


@public()
def check(session: Any) -> list[Finding]:
    """Check a recording before a fit: rates, scales, stills, turns, gaps, the accelerometer.

    Parameters
    ----------
    session : Session, ArraySession, str or Path
        The recording, or its folder.

    Returns
    -------
    list of Finding
        In the order of the checks: ``level`` (ok, note, warning, error), ``where``, ``what``, ``says``, ``do``.  In a folder, a log
        that cannot be read is an error among the findings.  For an array, ``where`` begins with the unit's number.

    Raises
    ------
    CalibrationError
        If ``session`` is not a recording.

    Examples
    --------
    >>> import tinygc
    >>> findings = tinygc.check(tinygc.simulate(segments=12, odr_hz=104.0, seed=1).session)
    >>> any(finding.level == "error" for finding in findings)
    False

    """
    if isinstance(session, Session):
        found = SessionStills(session)
        findings = check_session(session, found)
        return findings if worst(findings) == "error" else findings + first_look_at_fit(session, found)
    if isinstance(session, str | PathLike):
        folder = Path(session)
        if not is_array(folder):
            return check_folder(folder, first_look_at_fit)
        read_array = need("recordings of arrays").read_array
        try:
            session = read_array(folder)
        except CalibrationError as error:
            return [Finding("error", folder.name, "reading", str(error))]
    elif not hasattr(session, "units"):
        session_or_folder(session)
    return need("checks of arrays").check_array(session, first_look_at_fit)


# ``tinygc.fit``: fit calibrations to a session and report their closure.


@dataclass(frozen=True)
class Estimate:
    """One fitted number."""

    #: ``E_xy``, ``B_x``, ``bias_x``, …
    name: str
    #: in ``unit``
    value: float
    #: one standard deviation, in ``unit``
    sigma: float
    #: SI unit; ``1`` if unitless
    unit: str

    def __repr__(self) -> str:
        return f"<{self.name} = {self.value:.6g} ± {self.sigma:.2g}{'' if self.unit == '1' else f' {self.unit}'}>"


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """What ``tinygc.fit`` returns: parameters with their sigmas, closure of each method, models."""

    #: complete result of the fit, in SI
    result: FitResult

    def __repr__(self) -> str:
        tilt = self.closure["least_squares" if "least_squares" in self.result.methods else next(iter(self.result.methods))]
        return (
            f"<Fit of {self.session.name}: {', '.join(self.result.methods)}; "
            f"{len(self.result.problem.used)} segments, held out {tilt['tilt_rms_deg']:.4f}°>"
        )

    @property
    def session(self) -> Session:
        """The fitted session."""
        return self.result.session

    @cached_property
    def parameters(self) -> dict[str, Estimate]:
        """The 12 least-squares parameters of omega = E m + B by name: ``E_xx`` … ``E_zz`` (unitless), ``B_x`` … ``B_z`` in rad/s."""
        values, sigmas = self.result.linear.model.vector, np.sqrt(np.diag(self.result.covariance))  # type: ignore[attr-defined]
        return {
            name: Estimate(name, float(value), float(sigma), "1" if name.startswith("E") else "rad/s")
            for name, value, sigma in zip(NAMES, values, sigmas, strict=True)
        }

    @property
    def accelerometer(self) -> AccelerometerFit:
        """The accelerometer that gives the references: ``mode`` (given, fit, prior), ``calibration``, ``unobserved``, ``p_value``,
        ``spread_mps2``."""
        return self.result.accelerometer

    @cached_property
    def accelerometer_parameters(self) -> dict[str, Estimate]:
        """The accelerometer's nine numbers of f = M (measured - b) in its own triad: ``scale_x`` … (M's diagonal less 1),
        ``nonorthogonality_xy``, ``_xz``, ``_yz`` (above it), both unitless, and ``bias_x`` … in m/s^2.

        A sigma is NaN if the calibration was taken as given.  The session does not observe those named in ``accelerometer.unobserved``.
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
        """Covariance (12, 12) of ``parameters``, in their order and units."""
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
        return Group(verdict_text(self.verdict()), fit_report(self.result))

    def summary(self) -> str:
        """What ``fit --verbose`` prints: verdict, closure by method, closure runs, parameters with their sigmas, remarks."""
        return as_text(self.page)

    def _repr_html_(self) -> str:
        return as_html(self.page)

    def to_json(self, limit_deg: float | None = None) -> dict:
        """``tinygc-fit/2`` (docs/formats.md); limit_deg: of the verdict."""
        return to_json(self.result, limit_deg)

    def save(self, folder: Path | str | None = None, limit_deg: float | None = None) -> Path:
        """Write each method's model and the figures into a folder (``fit`` in the session's folder by default); returns it."""
        return save_models(self.result, None if folder is None else Path(folder), limit_deg)


@public(FitOptions)
def fit(session: Session | Path | str, options: FitOptions | None = None, *, progress: Progress | None = None, **choices: Any) -> Fit:
    """Fit the calibration ``omega = E m + B`` of a session, and the other methods that are chosen.

    Parameters
    ----------
    session : Session, str or Path
        The recording, or its folder.  Rates are in rad/s, specific force in m/s^2, both (N, 3) in body axes forward, right, down.
    options : FitOptions, optional
        Options that decide the fit's numbers.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.
    **choices
        Single fields of ``FitOptions``: ``methods=("least_squares",)``, ``still_rates=True``, ``physics=("auto",)``.

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
        return Fit(fit_session(where, options, progress or nothing))
    from tinygc.explanation.physics import physics_methods

    return Fit(fit_session(where, options, progress or nothing, physics=physics_methods))


@public()
def fit_temperature(folders: Path | str | Sequence[Path | str], *, most_order: int = 5, progress: Progress | None = None) -> Any:
    """Fit a calibration over temperature to rest logs and sessions with turns of one sensor.

    Parameters
    ----------
    folders : str, Path or sequence of them
        Folders of rest logs and sessions of one sensor.
    most_order : int, optional
        Highest order of the polynomials over temperature, 0 to 5.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.

    Returns
    -------
    ThermalFit
        ``model``, ``covariance``, ``names``, ``values``, ``sigma``.  Rest logs alone give the zero rate over temperature; E is then the
        identity.

    Raises
    ------
    CalibrationError
        For data that cannot be read or fitted, and if the temperature annex was removed; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> thermal = tinygc.fit_temperature(["data/rests", "data/session1"])  # doctest: +SKIP
    >>> thermal.model(raw, temp=celsius)  # (N, 3) rad/s from (N, 3) rad/s and (N,) degC  # doctest: +SKIP

    """
    annex = need("calibrations over temperature")
    return annex.fit_temperature(folders, most_order=most_order, progress=progress or nothing)


@public()
def fit_turns(session: Session | Path | str, *, progress: Progress | None = None) -> Any:
    """Fit a gyroscope alone, without an accelerometer, to turns of known angle.

    Parameters
    ----------
    session : Session, str or Path
        A session with ``reference = "turns"``, or its folder, which holds ``turns.csv``.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.

    Returns
    -------
    TurnFit
        ``scales`` of each axis and sense that was turned, ``asymmetry``, ``bias``, ``model``, ``angles`` of the turns, ``estimate`` with
        the table's play and the turns that are lost; ``summary()``, ``to_json()``, ``save()``.

    Raises
    ------
    CalibrationError
        For data that cannot be read or fitted, and if the annex was removed; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> turned = tinygc.fit_turns("phone")  # doctest: +SKIP
    >>> turned.scales[0].value, turned.scales[0].sigma  # doctest: +SKIP

    """
    return need("known turns of a gyroscope alone").fit_turns(session_or_folder(session), progress=progress or nothing)


# ``tinygc.simulate``: simulate a session and its truth; other commands read it like a recorded one.


@dataclass(frozen=True, eq=False, repr=False)
class Simulated:
    """Result of ``tinygc.simulate``: a session with its truth."""

    #: ``tinygc-truth/1`` (docs/formats.md)
    truth: dict
    #: options, movement, unit and registers
    simulation: Simulation

    @cached_property
    def session(self) -> Session:
        """The session, as a recorder would have written it."""
        return _session(self.simulation)

    def __repr__(self) -> str:
        hidden = ", ".join(self.truth["effects"]) or "nothing"
        return f"<Simulated {len(self.simulation.plan.turns)} turns, seed {self.simulation.options.seed}; hides {hidden}>"

    def save(self, folder: Path | str, force: bool = False) -> Path:
        """Write a session folder with truth.json; returns the folder.  FormatError if the folder holds something else."""
        return write_simulation(self.simulation, Path(folder), force, self.truth["effects"])


@public(SimulationOptions)
def simulate(
    options: SimulationOptions | None = None, *, effects: Mapping[str, Mapping[str, Any]] | None = None, **choices: Any
) -> Simulated:
    """Simulate a session; the same arguments give the same registers.

    Parameters
    ----------
    options : SimulationOptions, optional
        Sensor, unit, bench and movement.
    effects : mapping, optional
        Effects hidden in the gyroscope: id -> parameters by their JSON names and units
        (``{"gyro.g_sensitivity": {"matrix_dps_per_g": [[…], […], […]]}}``).
    **choices
        Single fields of ``SimulationOptions``: ``segments=12``, ``odr_hz=416.0``, ``seed=3``.

    Returns
    -------
    Simulated
        ``session`` and ``truth``; ``save(folder)`` writes both.

    Raises
    ------
    CalibrationError
        For invalid options, and for an effect that does not add to the rate.

    Examples
    --------
    >>> import tinygc
    >>> simulated = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1)
    >>> simulated
    <Simulated 12 turns, seed 1; hides nothing>
    >>> simulated.session.logs[0].samples.gyro.shape[1]
    3

    """
    settings = chosen(SimulationOptions, options, choices)
    hidden = {name: dict(parameters) for name, parameters in (effects or {}).items()}
    plan = plan_of(settings)
    simulation = simulate_session(settings, _distort(hidden, settings, plan.log_s), plan=plan)
    return Simulated(truth_table(simulation, hidden), simulation)


def _distort(hidden: dict[str, dict], options: SimulationOptions, duration_s: float) -> Distort | None:
    """Compose all hidden effects into one function, applied one after the other."""
    effects = [_with_theta(name, parameters) for name, parameters in hidden.items()]
    if not effects:
        return None

    def distort(t_s: np.ndarray, rate: np.ndarray, force: np.ndarray, temp_c: np.ndarray) -> np.ndarray:
        dt_s, force_g, full_scale = float(t_s[1] - t_s[0]), force / G, options.gyro_fs_dps * DEG
        for effect, theta in effects:
            shaken = vibration(force_g, dt_s)
            movement = Movement(t_s, dt_s, rate, force_g, temp_c, shaken, duration_s, full_scale, options.temperature_start_c)
            rate = effect.distort(movement, theta)
        return rate

    return distort


def _with_theta(name: str, parameters: dict) -> tuple[Effect, np.ndarray]:
    effect = effect_of(name)
    if effect.kind != "rate":
        raise DataError(f"{name} does not add to the rate; simulate hides only effects that do")
    wanted = [effect.parameter.name, *([] if effect.scan is None else [effect.scan.name])]
    if set(parameters) != set(wanted):
        raise DataError(f"{name}: parameters are {', '.join(parameters) or 'none'}, expected {' and '.join(wanted)}")
    theta = _numbers(name, effect.parameter.name, parameters) * effect.parameter.si
    if theta.shape != effect.parameter.shape or not np.isfinite(theta).all():
        raise DataError(f"{name}: {effect.parameter.name} has shape {theta.shape}, expected {effect.parameter.shape} of finite numbers")
    if effect.scan is not None:
        value = _numbers(name, effect.scan.name, parameters)
        if value.shape or not np.isfinite(value):
            raise DataError(f"{name}: {effect.scan.name} has shape {value.shape}, expected a finite number")
        effect = effect.at(float(value) * effect.scan.si)
    return effect, theta.ravel()


def _numbers(name: str, of: str, parameters: dict) -> np.ndarray:
    try:
        return np.asarray(parameters[of], dtype=float)
    except (TypeError, ValueError):
        raise DataError(f"{name}: {of} is {parameters[of]!r:.60}, expected numbers") from None


def _session(simulation: Simulation) -> Session:
    """Build the session that a reader would get from its files."""
    options, unit = simulation.options, simulation.unit

    def arrays(recording: RegisterLog) -> tuple[np.ndarray, ...]:
        units = options.register_units
        temp_c = units.temperature_c(recording.temp)
        arrays = (recording.t_us * 1e-6, recording.gyro * units.gyro_rps, recording.accel * units.accel_mps2)
        return arrays if temp_c is None else (*arrays, temp_c)

    session = Session.from_arrays(
        *arrays(simulation.log),
        closures=[] if simulation.closure is None else [arrays(simulation.closure)],
        name=f"simulated-{options.seed}",
        model=options.sensor,
        serial=f"SIM-{options.unit_drawn_from}",
        gyro_fs_dps=options.gyro_fs_dps,
        accel_fs_g=options.accel_fs_g,
        accelerometer=Accelerometer(np.round(unit.accel_matrix, MATRIX_DIGITS), np.round(unit.accel_bias, BIAS_DIGITS)),
        site=Site(options.latitude_deg, options.gravity_mps2, unit.heading_deg if options.with_heading else None),
        protocol=Protocol(still_s=options.still_s, segment_s=2 * options.still_s + options.turn_s),
    )
    turns = stopped_turns(simulation.plan, options)
    return replace(session, config=replace(session.config, sensor=replace(session.config.sensor, odr_hz=options.odr_hz)), turns=turns)
