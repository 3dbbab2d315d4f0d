"""From folders with rest logs, and sessions at several temperatures, to one model over temperature."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from session.base.errors import FitError, FormatError
from session.base.names import log_paths
from session.base.progress import Progress, no_report
from session.base.texts import printable
from session.log.config import read_config
from session.log.folder import file_key, input_hashes, read_session, refuse_same, sha256_of
from session.log.rests import read_rest
from tinygc.features.temperature.feature import ThermalOptions
from tinygc.features.temperature.rest_fit import RestFit, fit_rests
from tinygc.features.temperature.sessions_fit import ThermalFit, join, of_rests_alone, point_of
from tinygc.library.arguments import public


@public(ThermalOptions)
def fit_temperature(folders: Path | str | Sequence[Path | str], *, progress: Progress | None = None, **choices: Any) -> ThermalFit:
    """Fit a calibration over temperature to rest logs and sessions with turns of one sensor.

    Parameters
    ----------
    folders : str, Path or sequence of them
        Folders of rest logs and sessions of one sensor.
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
        For data that cannot be read or fitted; its message is one line.

    Examples
    --------
    >>> import tinygc
    >>> thermal = tinygc.fit_temperature(["data/rests", "data/session1"])  # doctest: +SKIP
    >>> thermal.model(raw, temp=celsius)  # (N, 3) rad/s from (N, 3) rad/s and (N,) degC  # doctest: +SKIP

    """
    progress, most_order = progress or no_report, ThermalOptions(**choices).most_order
    paths = [Path(folder) for folder in ([folders] if isinstance(folders, Path | str) else folders)]
    sensors = [read_config(folder / "session.toml").sensor for folder in paths]
    for folder, sensor in zip(paths[1:], sensors[1:], strict=True):
        for what in ("model", "serial", "gyro_fs_dps"):
            mine, first = getattr(sensor, what), getattr(sensors[0], what)
            if mine != first:
                raise FitError(f"{folder}: sensor.{what} is {mine!r}, and {paths[0]} has {first!r}; join sessions of one sensor")
    sensor = sensors[0]
    rest_paths = [path for folder in paths for path in log_paths(folder, "rest")]
    turning = [folder for folder in paths if log_paths(folder, "log")]
    if not rest_paths and not turning:
        raise FormatError(f"{paths[0]}: neither a rest log nor a log; expected rest*.csv or log*.csv next to session.toml")
    refuse_same([*rest_paths, *(path for folder in turning for path in log_paths(folder, "log"))])
    begins = {path: "" if len(paths) == 1 else f"{printable(path.parent.resolve().name)}/" for path in rest_paths}
    hashes = {f"{begins[path]}{file_key(path)}": sha256_of(path) for path in rest_paths}
    name = printable(paths[0].resolve().name)
    rests: RestFit | None = None
    alone: ThermalFit | None = None
    if rest_paths:
        logs = []
        for number, path in enumerate(rest_paths):
            progress(path.name, number, len(rest_paths))
            logs.append(read_rest(path, sensor))
        rests = fit_rests(logs, tuple(range(most_order + 1)), progress)
        alone = of_rests_alone(name, rests, {"session.toml": sha256_of(paths[0] / "session.toml")} | hashes)
        if not turning:
            return alone
    points = []
    for folder in turning:
        session = read_session(folder)
        prefix = f"{session.name}/" if len(paths) > 1 else ""
        hashes |= {f"{prefix}{file}": digest for file, digest in input_hashes(session).items()}
        points.append(point_of(session, None if alone is None else alone.model, progress))
    sessions = join(points, rests, most_order)
    return ThermalFit(name, sessions.model, sessions.covariance, rests, sessions, hashes)
