"""A calibration over temperature: from folders with rest logs, and sessions at several temperatures, to one model."""

from __future__ import annotations

from pathlib import Path

from session.common.errors import FormatError
from session.log.config import read_config
from session.log.folder import log_paths
from session.log.hashes import sha256_of
from tinygc.library.fit import Progress
from tinygc.temperature.axis_fit import ORDERS
from tinygc.temperature.rest_fit import fit_rests, read_rests
from tinygc.temperature.thermal_fit import ThermalFit, of_rests_alone


def fit_temperature(folder: Path | str, *, most_order: int = ORDERS[-1], progress: Progress = lambda what, done, of: None) -> ThermalFit:
    """Of a folder with rest logs.  Raises CalibrationError, in one line, for what cannot be read or fitted."""
    folder = Path(folder)
    config = read_config(folder / "session.toml")
    paths = log_paths(folder, "rest")
    if not paths:
        raise FormatError(f"{folder}: no rest log; expected rest*.csv or rest*.csv.gz beside session.toml")
    read = read_rests(paths, config.sensor, progress)
    rests = fit_rests(read, tuple(range(most_order + 1)), progress=progress)
    hashes = {path.name: sha256_of(path) for path in (folder / "session.toml", *paths)}
    return of_rests_alone(folder.resolve().name, rests, hashes)
