"""``tinygc.apply``: a calibration on arrays, on a log, or from file to file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from session.base import features
from session.base.errors import CalibrationError
from session.base.names import log_paths
from session.base.options import records, refuse_with
from session.base.progress import Progress, no_report
from session.log.logfile import Log, refuse_calibrated
from session.log.samples import Samples
from tinygc.deploy import LogSession
from tinygc.deploy.apply import Applied, apply_model, model_of
from tinygc.deploy.calibration import Calibration
from tinygc.library.arguments import column_unit, is_fit, public
from tinygc.library.sources import session_of_table
from tinygc.library.tables import is_table
from tinygc.models.files import load_with_table

#: what features add to it
FURTHER = tuple(features.each("options of apply"))


@public(LogSession, *FURTHER)
def apply(
    model: Any,
    data: Any,
    out: Path | str | None = None,
    *,
    acc: Any = None,
    temp: Any = None,
    unit: str = "rad/s",
    progress: Progress | None = None,
    **choices: Any,
) -> Any:
    """Calibrate the rates and the specific force of a log.

    Parameters
    ----------
    model : Calibration, Fit, str or Path
        A calibration, a model file, or the folder of a session: the model that its fit recommends.
    data : array_like, Log, str or Path
        Measured rates (N, 3); a session's log; a table, as ``read_log`` reads it; or, with ``out``, a standard
        log's file, or the folder of a session with one log.
    out : str or Path, optional
        The log to write, .csv or .csv.gz, of a log file.
    acc, temp : array_like, optional
        With the rates: calibrated specific force (N, 3), m/s^2, and temperature (N,), degC, where the model needs them.
    unit : str, optional
        Of rates, in and out; of a log file the unit that is written.
    progress : callable, optional
        Called with the current step's description, the number of steps done and the number of all steps.

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
        return _apply_to_file(model, Path(data), out, unit, progress, choices)
    if named := [name for name, value in {"out": out, **choices}.items() if value is not None]:
        raise CalibrationError(f"apply: {', '.join(named)} goes with a log file, and data is a {type(data).__name__}; leave it out")
    calibration = _calibration(model)
    if is_table(data):
        data = session_of_table(data).logs[0]
    if not isinstance(data, Log):
        return calibration(data, acc, temp, unit=unit)
    if acc is not None or temp is not None or unit != "rad/s":
        raise CalibrationError("apply: acc, temp and unit go with rates; a log has its own, in SI")
    return _apply_to_log(calibration, data)


def _calibration(model: Any) -> Calibration:
    if is_fit(model):
        return model.model
    if isinstance(model, Calibration):
        return model
    path, _ = stored_model(model)
    stored, table = load_with_table(model_of(path))
    return Calibration(stored, None, table)


def _apply_to_log(calibration: Calibration, log: Log) -> Samples:
    """Return a log's samples with calibrated rates, and calibrated force where the model has the accelerometer's calibration."""
    refuse_calibrated(log.comments, log.path.name)
    samples = log.samples
    if calibration.rate_hz is None and calibration.uses_rate:
        calibration = Calibration(calibration.model, 1 / samples.period_s, calibration.to_json())
    if "temp" in calibration.needs and samples.temp_c is None:
        raise CalibrationError(f"{log.path.name} has no temperature, which the model needs ({', '.join(calibration.effects)})")
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
    progress: Progress | None,
    choices: dict[str, Any],
) -> Any:
    if out is None:
        raise CalibrationError(f"apply: {log} is a file; give out=, the log to write")
    path, table = stored_model(model)
    path = path if table is not None else model_of(path)
    logs = log_paths(log, "log") if log.is_dir() else [log]
    for source in (*logs, path):
        if source.exists() and Path(out).exists() and os.path.samefile(source, out):
            raise CalibrationError(f"{out}: is what is read, and nothing is written over it; give out another path")
    place, *further = records(choices, LogSession, *FURTHER)
    how: dict[str, Any] = {"unit": column_unit(unit), "session": place.session, "further": further, "progress": progress or no_report}
    if table is None and (fused := features.first("use of a model", path, log, Path(out), **how)) is not None:
        return fused
    if len(logs) != 1:
        names = ", ".join(each.name for each in logs)
        raise CalibrationError(f"{log}: {f'give one of its logs: {names}' if logs else 'a folder without log*.csv; give a log'}")
    refuse_with(f"{path.name}, the model of one sensor", {}, further)
    done: Applied = apply_model(path, logs[0], Path(out), place.session, how["unit"], progress, table)
    return done


def stored_model(model: Any) -> tuple[Path, dict | None]:
    """Return the path of a stored model; of a calibration or a fit in memory a name, and what its file would hold."""
    if isinstance(model, str | os.PathLike):
        return Path(model), None
    if is_fit(model):
        model = model.model
    if not isinstance(model, Calibration):
        raise CalibrationError(f"model is of type {type(model).__name__}, expected a Calibration, a Fit or a model file")
    table = model.to_json()
    return Path(f"model_{table.get('method', table['kind'])}.json"), table
