"""What is done with calibrations: ``report``, ``export``, ``compare``, ``rebias`` and ``apply``."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from session.io.annexes import need
from session.io.dialects import Answers
from session.io.errors import CalibrationError, FormatError
from session.io.folder import Session
from session.io.logfile import Log, already_calibrated
from session.io.samples import Samples
from tinygc.deploy.apply import Applied, apply_model, model_of
from tinygc.deploy.calibration import Calibration
from tinygc.estimation.bias_of_day import Rebiased, rebias_session, rebias_to_json, rebiased_table, save_rebiased
from tinygc.estimation.choice import ClosureFigures, closure_figures
from tinygc.estimation.compare import DIFFERS_P, Comparison, Moved, calibrated_of, read_calibrated
from tinygc.estimation.compare import compare as compare_calibrated
from tinygc.estimation.compare import to_json as comparison_to_json
from tinygc.estimation.options import FitOptions
from tinygc.library.fits import Fit
from tinygc.library.interface import (
    Estimate,
    Listed,
    Named,
    Progress,
    Shown,
    answers_of,
    chosen,
    column_unit,
    is_path,
    nothing,
    public,
    session_or_folder,
)
from tinygc.library.reports import Exported, Report, exported, report_of
from tinygc.models.files import is_array_model, load_with_table
from tinygc.reporting.fit_text import rebias_report
from tinygc.reporting.tables import comparison_page, comparison_verdict_line
from tinygc.reporting.terminal import Group, Text

# ``tinygc.report`` and ``tinygc.export``: a calibration for people, and for other programs.


@public(FitOptions)
def report(
    session: Session | Fit | Path | str,
    path: Path | str | None = None,
    options: FitOptions | None = None,
    *,
    explain: bool = True,
    limit_deg: float | None = None,
    pdf: bool = False,
    progress: Progress | None = None,
    **choices: Any,
) -> Report:
    """Make the calibration report: one HTML file that needs nothing else.

    Parameters
    ----------
    session : Session, Fit, str or Path
        The recording, its folder, or its fit, which is not computed again.
    path : str or Path, optional
        The HTML file to write; without it ``save`` writes the report.
    options : FitOptions, optional
        Options of the fit, where none is given.
    explain : bool, optional
        Ask why recording and simulation differ.
    limit_deg : float, optional
        Pass only if the held-out tilt of the segments and each closure run's RMSE are at most this, degrees.
    pdf : bool, optional
        Print it as well, to a PDF beside it; needs Chromium.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.
    **choices
        Single fields of ``FitOptions``.

    Returns
    -------
    Report
        ``verdict``, ``html``, ``to_json()``, ``save(path)``.

    Raises
    ------
    CalibrationError
        For data that cannot be read or fitted, and for a wrong option; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> session = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).session
    >>> made = tinygc.report(session, explain=False, methods=("least_squares",))
    >>> made.verdict.word
    'NOT DECIDED'

    """
    if isinstance(session, Fit):
        if options is not None or choices:
            raise CalibrationError("report: the options are those of the fit that is given; leave them out, or give the session")
        return session.report(path, explain=explain, limit_deg=limit_deg, pdf=pdf, progress=progress)
    made = report_of(session_or_folder(session), chosen(FitOptions, options, choices), None, explain, limit_deg, progress)
    if path is not None:
        made.save(path, pdf=pdf)
    return made


@public()
def export(
    source: Fit | Path | str, to: str, folder: Path | str | None = None, *, model: str | None = None, anyway: bool = False
) -> Exported:
    """Make the files of a calibration for another program.

    Parameters
    ----------
    source : Fit, str or Path
        A fit, the folder of a fitted session, or an array's model file.
    to : str
        ``json``, ``kalibr``, ``ros``, ``xio``, ``px4``, ``ardupilot`` or ``c``.
    folder : str or Path, optional
        Where the files are written; without it ``save`` writes them.
    model : str, optional
        Method of the fit, or a model file; least squares by default.
    anyway : bool, optional
        Export a model that closes held-out segments worse than raw rates, too.

    Returns
    -------
    Exported
        ``files`` (text by name), ``remarks`` on what the format carries only in part, ``save(folder)``.

    Raises
    ------
    CalibrationError
        For a source without a fit, and for a model that the format cannot carry; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> session = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).session
    >>> list(tinygc.export(tinygc.fit(session, methods=("least_squares",)), "kalibr").files)
    ['imu.yaml', 'imu-intrinsics.yaml']

    """
    if isinstance(source, Fit):
        return source.export(to, folder, model=model, anyway=anyway)
    if not isinstance(source, str | os.PathLike):
        raise CalibrationError(f"source is of type {type(source).__name__}, expected a Fit, a session folder or an array's model file")
    made = exported(Path(source), to, model, anyway, lambda line: None)
    if folder is not None:
        made.save(folder)
    return made


# ``tinygc.compare``: do the calibrations of one sensor agree?


@dataclass(frozen=True, eq=False, repr=False)
class Compared(Shown):
    """Result of ``tinygc.compare``."""

    result: Comparison

    def __repr__(self) -> str:
        return f"<Compared {len(self.result.sessions)} sessions: {'agree' if self.agree else 'differ'}, p = {self.p_value:.2g}>"

    @property
    def p_value(self) -> float:
        """Probability of at least this difference where nothing has changed."""
        return self.result.verdict.p_value

    @property
    def agree(self) -> bool:
        """Whether they agree: p is at least 0.01."""
        return self.p_value >= DIFFERS_P

    @property
    def moved(self) -> Listed[Moved]:
        """What differs in one session from the rest, the largest first: ``session``, ``name``, ``by``, ``unit``, ``sigmas``."""
        return Listed(self.result.moved)

    @property
    def page(self) -> Group:
        """The command's output as a rich renderable."""
        return comparison_page(self.result)

    @property
    def verdict_line(self) -> Text:
        """Whether the calibrations agree, for rich."""
        return comparison_verdict_line(self.result)

    def to_json(self) -> dict:
        """``tinygc-compare/2`` (docs/formats.md)."""
        return comparison_to_json(self.result)


@public()
def compare(sessions: Sequence[Fit | Path | str], *, bias: bool = False) -> Compared:
    """Say whether the calibrations of several sessions of one sensor agree.

    Parameters
    ----------
    sessions : sequence of Fit, str or Path
        Two or more fits, or folders of fitted sessions.
    bias : bool, optional
        The bias counts, too: the sensor was never switched off in between.

    Returns
    -------
    Compared
        ``agree``, ``p_value``, ``moved``, ``summary()``, ``to_json()``; ``result`` holds everything.

    Raises
    ------
    CalibrationError
        For fewer than two sessions, for the same recording twice, and for a session without a fit.

    Examples
    --------
    >>> import tinygc
    >>> simulated = [tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=seed, unit_seed=1) for seed in (1, 2)]
    >>> tinygc.compare([tinygc.fit(each.session, methods=("least_squares",)) for each in simulated]).agree
    True

    """
    given: list[Any] = list(sessions) if isinstance(sessions, list | tuple) else [sessions]
    for each in given:
        if not isinstance(each, Fit) and not is_path(each):
            raise CalibrationError(f"sessions holds {each!r:.60}, expected a Fit or the path of a fitted session")
    if len(given) < 2:
        raise CalibrationError("compare needs two sessions or more")
    read = [calibrated_of(each.result, each.config) if isinstance(each, Fit) else read_calibrated(Path(each)) for each in given]
    return Compared(compare_calibrated(read, bias))


# ``tinygc.rebias``: the bias of the day.


@dataclass(frozen=True, eq=False, repr=False)
class Rebias(Shown):
    """Result of ``tinygc.rebias``."""

    result: Rebiased

    def __repr__(self) -> str:
        moved = ", ".join(f"{estimate.value:+.3g}" for estimate in self.change.values())
        return f"<Rebias from {self.result.source}: B moves by {moved} rad/s>"

    @cached_property
    def model(self) -> Calibration:
        """The stored calibration with the new bias."""
        return Calibration(self.result.model, 1 / self.result.problem.logs[0].samples.period_s, rebiased_table(self.result))

    @property
    def change(self) -> Named[Estimate]:
        """The change of B by axis, ``B_x`` …, in rad/s, with its sigma, NaN where the bias was given."""
        change, sigma = self.result.changes[self.result.source]
        sigmas = np.full(3, np.nan) if sigma is None else sigma
        axes = zip("xyz", change, sigmas, strict=True)
        return Named((f"B_{axis}", Estimate(f"B_{axis}", float(value), float(spread), "rad/s")) for axis, value, spread in axes)

    @property
    def closure(self) -> Named[ClosureFigures]:
        """Closure of the session's segments with the stored bias and with that of each source, degrees rms, as ``Fit.closure``."""
        return Named((name, closure_figures(angles)) for name, angles in self.result.angles.items())

    @property
    def page(self) -> Group:
        """The command's output as a rich renderable."""
        return rebias_report(self.result)

    def to_json(self) -> dict:
        """``tinygc-fit/2`` of a bias of the day (docs/formats.md)."""
        return rebias_to_json(self.result)

    def save(self, folder: Path | str | None = None) -> Path:
        """Write the model and its figures into a folder (``fit`` in the session's folder by default); returns it."""
        return save_rebiased(self.result, None if folder is None else Path(folder))


#: of a bias of the day
SOURCES = ("start", "gravity", "given")


@public()
def rebias(
    session: Session | Path | str,
    model: Calibration | Fit | Path | str,
    source: str = "start",
    *,
    bias_dps: Sequence[float] | None = None,
    use_earth: bool = True,
    exclude: Sequence[int] = (),
    progress: Progress | None = None,
) -> Rebias:
    """Take the bias of a stored calibration anew from another session: the bias of the day.

    Parameters
    ----------
    session : Session, str or Path
        The new recording, or its folder.
    model : Calibration, Fit, str or Path
        The stored calibration, or its file; of a fit, least squares.
    source : {"start", "gravity", "given"}, optional
        From the first still, from gravity over the run, or ``bias_dps``.
    bias_dps : sequence of float, optional
        What the sensor reads at rest, (3,) dps, for ``given``.
    use_earth : bool, optional
        Whether the Earth's rotation is subtracted.
    exclude : sequence of int, optional
        Numbers of segments to leave out of the closure.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.

    Returns
    -------
    Rebias
        ``model``, ``change`` of B, ``closure``, ``summary()``, ``save(folder)``, ``to_json()``.

    Raises
    ------
    CalibrationError
        For data that cannot be read, a session without the still that the source needs, and a wrong argument.

    Examples
    --------
    >>> import tinygc
    >>> first, second = (tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=s, unit_seed=1).session for s in (1, 2))
    >>> found = tinygc.rebias(second, tinygc.fit(first, methods=("least_squares",)))
    >>> found.change["B_x"].unit
    'rad/s'

    """
    if source not in SOURCES or (source == "given") != (bias_dps is not None):
        raise CalibrationError(f"source is {source!r}, expected start or gravity, or given with bias_dps=(x, y, z)")
    if bias_dps is not None and len(bias_dps) != 3:
        raise CalibrationError(f"bias_dps is {bias_dps!r:.60}, expected three numbers, dps")
    path, table = _stored(model)
    given = None if bias_dps is None else np.asarray(bias_dps, dtype=float)
    found = rebias_session(
        session_or_folder(session),
        path,
        source,
        given,
        table=table,
        use_earth=use_earth,
        exclude=tuple(exclude),
        progress=progress or nothing,
    )
    return Rebias(found)


def _stored(model: Any) -> tuple[Path, dict | None]:
    """Return the path of a stored model; of one in memory a name, and what its file would hold."""
    if isinstance(model, str | os.PathLike):
        return Path(model), None
    if isinstance(model, Fit):
        model = model.model
    if not isinstance(model, Calibration):
        raise CalibrationError(f"model is of type {type(model).__name__}, expected a Calibration, a Fit or a model file")
    table = model.to_json()
    return Path(f"model_{table.get('method', table['kind'])}.json"), table


# ``tinygc.apply``: a calibration on arrays, on a log, or from file to file.


@public(Answers)
def apply(
    model: Calibration | Fit | Path | str,
    data: Any,
    out: Path | str | None = None,
    *,
    acc: Any = None,
    temp: Any = None,
    unit: str = "rad/s",
    session: Path | str | None = None,
    which: str | None = None,
    progress: Progress | None = None,
    **choices: Any,
) -> Any:
    """Calibrate the rates and the specific force of a log.

    Parameters
    ----------
    model : Calibration, Fit, str or Path
        A calibration, a model file, or the folder of a session: the model that its fit recommends.
    data : array_like, Log, str or Path
        Measured rates (N, 3); a session's log; or a log file that ``replay`` reads, with ``out``.
    out : str or Path, optional
        The log to write, .csv or .csv.gz, of a log file.
    acc, temp : array_like, optional
        Beside rates: calibrated specific force (N, 3), m/s^2, and temperature (N,), degC, where the model needs them.
    unit : str, optional
        Of rates, in and out; of a log file the unit that is written.
    session : str or Path, optional
        Of a log file: where session.toml is (beside the log); its accelerometer's calibration then holds, not the model's.
    which : str, optional
        Of an array's folder with several logs: ``log0002``.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.
    **choices
        What a log file does not tell: ``sensor``, ``odr_hz``, ``gyro_fs_dps``, ``accel_fs_g``, ``time_unit``, ``columns``, ….

    Returns
    -------
    ndarray, Samples or Applied
        Rates (N, 3) of arrays; calibrated samples of a log; of a file what was written: ``out``, ``rows``, ``notes``.

    Raises
    ------
    CalibrationError
        For a model that cannot be read, and for data that do not suit it; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> session = tinygc.simulate(segments=12, closure_s=0.0, odr_hz=104.0, seed=1).session
    >>> result = tinygc.fit(session, methods=("least_squares",))
    >>> samples = tinygc.apply(result, session.logs[0])
    >>> bool((samples.gyro == tinygc.apply(result, session.logs[0].samples.gyro)).all())
    True

    """
    if isinstance(data, str | os.PathLike):
        return _apply_to_file(model, Path(data), out, unit, session, which, progress, answers_of(choices))
    if out is not None or session is not None or which is not None or choices:
        given = [name for name, value in {"out": out, "session": session, "which": which, **choices}.items() if value is not None]
        raise CalibrationError(f"apply: {', '.join(given)} goes with a log file, and data is a {type(data).__name__}; leave it out")
    calibration = _calibration(model)
    if not isinstance(data, Log):
        return calibration(data, acc, temp, unit=unit)
    if acc is not None or temp is not None or unit != "rad/s":
        raise CalibrationError("apply: acc, temp and unit go with rates; a log has its own, in SI")
    return _apply_to_log(calibration, data)


def _calibration(model: Any) -> Calibration:
    path, table = _stored(model)
    if isinstance(model, Fit):
        return model.model
    if isinstance(model, Calibration):
        return model
    stored, table = load_with_table(model_of(path))
    return Calibration(stored, None, table)


def _apply_to_log(calibration: Calibration, log: Log) -> Samples:
    """Return a log's samples with calibrated rates, and calibrated force where the model has the accelerometer's calibration."""
    if (done := already_calibrated(log.comments)) is not None:
        raise FormatError(f"{log.path.name} is calibrated already ({', '.join(sorted(done))}): give the log that it was made of")
    samples = log.samples
    if calibration.rate_hz is None and calibration.uses_rate:
        calibration = Calibration(calibration.model, 1 / samples.period_s, calibration.to_json())
    if "temp" in calibration.needs and samples.temp_c is None:
        raise CalibrationError(f"{log.path.name} lacks the temperature, which the model needs ({', '.join(calibration.effects)})")
    force = samples.accel[:] if calibration.accelerometer is None else calibration.accelerometer.correct(samples.accel[:])
    stream = calibration.stream()
    temp_c = None if samples.temp_c is None else samples.temp_c[:]
    omega = np.concatenate([stream.push(samples.gyro[:], force, temp_c), stream.flush()])
    return Samples(samples.t_ns, omega, force, temp_c)


def _apply_to_file(
    model: Any,
    log: Path,
    out: Path | str | None,
    unit: str,
    session: Path | str | None,
    which: str | None,
    progress: Progress | None,
    answers: Answers,
) -> Any:
    if out is None:
        raise CalibrationError(f"apply: {log} is a file; give out=, the log to write")
    path, table = _stored(model)
    path = path if table is not None else model_of(path)
    for source in (log, path):
        if source.exists() and Path(out).exists() and os.path.samefile(source, out):
            raise CalibrationError(f"{out}: is what is read, and nothing is written over it; give out another path")
    if table is None and is_array_model(path):
        return need("calibrations of arrays").apply(path, log, Path(out), answers, which, column_unit(unit), progress or nothing)
    if log.is_dir():
        raise CalibrationError(f"{log}: cannot be read (it is a folder, expected a log); an array's folder goes with an array's model")
    if which:
        raise CalibrationError("--which goes with an array's model and the array's folder")
    done: Applied = apply_model(
        path, log, Path(out), answers, None if session is None else Path(session), column_unit(unit), progress, table
    )
    return done
