"""List the sessions of a folder, one line each: date, sensor, recordings, and the last results of ``fit`` and ``explain``.

Nothing is computed and no log is read, only session.toml, the names of the files, ``fit/fit.json`` and ``explain/explain.json``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from session.base import features
from session.base.errors import CalibrationError
from session.base.names import log_paths
from session.base.records import Count, Size
from session.base.results import Keys, Text, read_required
from session.base.texts import printable
from session.log.config import read_config
from tinygc.estimation.session_times import date_of
from tinygc.fitting.fit_file import read_fit

#: folders below the one that is listed: data/2026/session1
DEEPEST = 3
MOST_FOLDERS = 10_000
EXPLAINED = Keys({"schema": Text(("tinygc-explain/2",)), "verdict": Text()})


@dataclass(frozen=True)
class ListedSession:
    """One session folder.  date: of the recording, UTC, and date_from: ``port``, ``notes`` or ``file`` (a log's time); method: that of the
    model to use (None where there is none); held_out_deg, floor_deg: of it, or of least squares; verdict: of ``explain``; problem: why it
    cannot be read; units: number of sensors that are recorded together; an unknown part is None."""

    folder: Path
    date: str | None = None
    date_from: Annotated[str | None, Text(("port", "notes", "file"))] = None
    model: str | None = None
    serial: str | None = None
    logs: Count | None = None
    closures: Count | None = None
    segments: Count | None = None
    method: str | None = None
    held_out_deg: Size | None = None
    floor_deg: Size | None = None
    runs_deg: tuple[Size, ...] = field(default=())
    verdict: str | None = None
    problem: str | None = None
    units: Count | None = None


def list_sessions(folder: Path) -> list[ListedSession]:
    """List the sessions in a folder, or the folder itself, by name; one that cannot be read is listed with the reason."""
    return [_listed(each) for each in folders_of(folder)]


def folders_of(folder: Path, depth: int = 0) -> Iterator[Path]:
    """Yield the session folders in a folder, or the folder itself, by name; ``depth`` below the one that was given."""
    try:
        if (folder / "session.toml").exists() or (depth and any(folder.glob("log*.csv*"))):
            yield folder
            return
        inside = sorted(each for each in folder.iterdir() if not each.name.startswith(".") and each.is_dir() and not each.is_symlink())
    except OSError:  # an unreadable folder is skipped
        return
    for each in inside[:MOST_FOLDERS] if depth <= DEEPEST else ():
        yield from folders_of(each, depth + 1)


def _listed(folder: Path) -> ListedSession:
    known: dict[str, Any] = {}
    try:
        if (special := features.first("line of a list", folder)) is not None:
            return ListedSession(folder, **special, **_fitted(folder / "fit" / "fit.json"))
        config = read_config(folder / "session.toml")
        known |= {"model": config.sensor.model, "serial": config.sensor.serial or None}
        logs, closures = log_paths(folder, "log"), log_paths(folder, "closure")
        rests = log_paths(folder, "rest")
        known |= {"logs": len(logs) + len(rests), "closures": len(closures)}
        known["date"], known["date_from"] = date_of(folder, config, [*logs, *closures, *rests])
        if not (logs or rests):
            known["problem"] = "no log*.csv: nothing was recorded, or it lies elsewhere"
        known |= _fitted(folder / "fit" / "fit.json")
        if (path := folder / "explain" / "explain.json").exists():
            known["verdict"] = read_required(path, EXPLAINED, "explain again")["verdict"]
    except (CalibrationError, OSError) as error:
        known["problem"] = printable(str(error)).replace(f"{folder}/", "")
    return ListedSession(folder, **known)


def _fitted(path: Path) -> dict[str, Any]:
    if not path.exists():
        return {}
    fit = read_fit(path)
    method, methods = (fit.get("use") or {}).get("method"), fit.get("methods", {})
    shown = method if method in methods else "least_squares"
    held = methods.get(shown, {}).get("holdout", {}).get("tilt_rms_deg")
    listed = fit.get("closure_runs")
    runs = [run.get(shown) for run in listed if isinstance(run, dict)] if isinstance(listed, list) else []
    figures = [run.get("rmse_deg") for run in runs if isinstance(run, dict)]
    return {
        "segments": fit.get("segments", {}).get("used"),
        "method": method,
        "held_out_deg": held,
        "floor_deg": fit.get("noise", {}).get("closure_floor_rms_deg"),
        "runs_deg": tuple(figure for figure in figures if isinstance(figure, float) and math.isfinite(figure)),
    }
