"""The context of a model: the session, the fit, the covariance, and their origin."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from math import isinf
from pathlib import Path

import numpy as np

from session.io.config import Accelerometer, Config, read_config
from session.io.folder import file_key, sha256_of
from session.io.logfile import read_log
from session.io.names import log_paths
from session.io.texts import command_line, printable
from session.io.units import DEG, DEG_PER_HOUR, G
from tinygc import models
from tinygc.deploy import ExportError
from tinygc.deploy.calibration import effects_of_session_time
from tinygc.estimation import bias_of_day
from tinygc.estimation.choice import worse_in_table
from tinygc.estimation.repeatability import BiasRepeatability
from tinygc.estimation.results import AT_END, read_judged
from tinygc.models.model import Model, accelerometer_of

#: the default method
PREFERRED = "least_squares"
#: the only method of a folder of rest logs
ONLY = "thermal"
LONGEST_NAME = 80


@dataclass(frozen=True, eq=False)
class Context:
    """session: its name; method: of the fit; config: ``session.toml``; table: the model file as JSON; fit: ``fit.json`` or empty;
    hashes: SHA-256 of the model file, session.toml and every log, by file name; say: function that shows a line to the operator;
    logs: paths of the calibration logs."""

    session: str
    method: str
    config: Config
    table: dict
    fit: dict
    hashes: dict[str, str]
    say: Callable[[str], None] = field(default=lambda line: None)
    logs: tuple[Path, ...] = ()

    @property
    def stem(self) -> str:
        """The session's name as a file name, short enough for any file system."""
        return re.sub(r"[^A-Za-z0-9]+", "_", self.session).strip("_")[:LONGEST_NAME] or "session"

    @property
    def covariance(self) -> np.ndarray | None:
        """(12, 12) of E row by row, then B in rad/s; for physics also of the effects' theta; None where the method has no covariance."""
        table = self.table.get("covariance")
        return None if table is None else np.asarray(table, dtype=float)

    @property
    def any_session_covariance(self) -> np.ndarray | None:
        """``covariance`` with the spread of the bias between sessions; None where that spread or the covariance is not known."""
        own, spread = self.covariance, self.table.get("bias_sigma_rps")
        if own is None or spread is None:
            return None
        return BiasRepeatability(np.asarray(spread, dtype=float), "").any_session(own)

    @property
    def accelerometer(self) -> Accelerometer:
        """The accelerometer calibration of the fit, from the model's file, else session.toml's.  Source ``none``: not calibrated."""
        own = accelerometer_of(self.table)
        return self.config.accelerometer if own is None else own

    @property
    def accelerometer_words(self) -> str:
        """Origin of the accelerometer calibration, and its numbers that kept their initial values because they were not observed."""
        words = {
            "given": "as it was given",
            "prior": "the given one, sharpened by the session's stills and turns",
            "stills": "from the session's own stills and turns",
            "none": "nobody has calibrated it: as measured",
        }[self.accelerometer.source]
        if self.accelerometer_unobserved:
            words = f"{words}; not observed: {', '.join(self.accelerometer_unobserved)}"
        return f"{words}; not in this format: {', '.join(self.effects_of_force)}" if self.effects_of_force else words

    @property
    def effects_of_force(self) -> tuple[str, ...]:
        """Ids of the accelerometer's effects that the fit found: no format has them."""
        known = self.fit.get("accelerometer") or {}
        drift = ["accelerometer.zero_drift"] if (known.get("zero_drift") or {}).get("significant") else []
        return tuple(dict.fromkeys([*drift, *(each["id"] for each in known.get("effects") or ())]))

    @property
    def accelerometer_unobserved(self) -> tuple[str, ...]:
        """Names of the accelerometer's numbers that kept their initial values because the session does not observe them."""
        return tuple((self.fit.get("accelerometer") or {}).get("unobserved") or ())

    @property
    def gyro_noise(self) -> np.ndarray | None:
        """(3,) rad/s/sqrt(Hz), one-sided white density measured in the stills."""
        found = self.fit.get("noise", {}).get("gyro_dps_rthz")
        return None if found is None else np.multiply(found, DEG)

    @property
    def accel_noise(self) -> np.ndarray | None:
        """(3,) m/s^2/sqrt(Hz), one-sided white density measured in the stills."""
        found = self.fit.get("noise", {}).get("accel_g_rthz")
        return None if found is None else np.multiply(found, G)

    @property
    def gyro_instability(self) -> tuple[float, str] | None:
        """Bias instability, rad/s, and its source: session.toml, else the fit's estimate, else typical of the sensor model."""
        noise, sensor = self.fit.get("noise", {}), self.config.sensor
        if sensor.gyro_bias_instability_dph is not None:
            return sensor.gyro_bias_instability_dph * DEG_PER_HOUR, "given in session.toml"
        if (found := noise.get("gyro_bias_instability_dph")) is not None:
            return found * DEG_PER_HOUR, str(noise.get("gyro_bias_instability_source"))
        typical = sensor.typical("gyro_bias_instability_dph")
        return typical and (typical[1] * DEG_PER_HOUR, f"typical of {typical[0]}")

    def temperature_c(self) -> tuple[float, float] | None:
        """Lowest and highest temperature of the calibration logs, degC; None where they record none.  Reads the logs."""
        read = [read_log(path, self.config.sensor).samples.temp_c for path in self.logs]
        seen = [values for values in read if values is not None]
        return (float(min(map(np.min, seen))), float(max(map(np.max, seen)))) if seen else None


def read_context(
    folder: Path, method: str | None = None, say: Callable[[str], None] = lambda line: None, *, anyway: bool = False
) -> tuple[Model, Context]:
    """Return ``(model, Context)`` of a fitted session.

    ``method`` names one of the fit's models, or is a model file; the default is least squares.  anyway: report, instead of refusing, a
    model that closes held-out segments worse than the raw rates do.
    Raises ExportError where there is no fit, and for a refused model; FormatError for files that cannot be read.
    """
    config = read_config(folder / "session.toml")
    path = _model_path(folder, method)
    if method is None and (folder / "fit" / "model_physics.json").exists():
        ended = "_at_end" if (folder / "fit" / "model_physics_at_end.json").exists() else ""
        say(f"least squares is exported; the fit holds physics as well: --model physics{ended}")
    model, table = models.load_with_table(path)
    if bygone := effects_of_session_time(model):
        raise ExportError(
            f"{path.name} undoes {', '.join(bygone)}, which follows the time of its own session and holds nowhere else; "
            f"give --model {path.stem.removeprefix('model_')}_at_end, which fit saves beside it"
        )
    sources = [path, folder / "session.toml", *log_paths(folder, "log"), *log_paths(folder, "closure")]
    hashes = {file_key(source): sha256_of(source) for source in sources}
    name: str = table.get("session") or printable(folder.resolve().name)
    named: str = table.get("method") or path.stem.removeprefix("model_")
    judged = named.removesuffix(AT_END)
    fit = _fit_beside(path, judged, f"run `{command_line('fit', folder)}` again")
    if worse := worse_in_table(fit, judged):
        by = "by no number that fit.json knows" if isinf(worse[0]) else f"with {worse[0]:.4g} deg"
        words = f"{path.name} closes held-out segments {by}, worse than the raw rates with {worse[1]:.4g} deg"
        if not anyway:
            raise ExportError(f"{words}: a device is better off without it; record more turns, or insist with --anyway")
        say(f"{words}; exported because of --anyway")
    return model, Context(name, named, config, table, fit, hashes, say, tuple(log_paths(folder, "log")))


def _model_path(folder: Path, method: str | None) -> Path:
    if method is not None and (method.endswith(".json") or "/" in method):
        return Path(method)
    there = {path.stem.removeprefix("model_"): path for path in sorted((folder / "fit").glob("model_*.json"))}
    if not there:
        raise ExportError(f"{folder / 'fit'}: no model; run `{command_line('fit', folder)}` first, or give --model FILE")
    wanted = method or (ONLY if set(there) == {ONLY} else PREFERRED)
    if wanted not in there:
        raise ExportError(f"{folder / 'fit'}: no model_{wanted}.json; there are {', '.join(there)}")
    return there[wanted]


def _fit_beside(path: Path, method: str, again: str) -> dict:
    """Return the fit of a model: ``rebiased.json`` for one with a re-estimated bias, else ``fit.json``; empty where missing."""
    names = (bias_of_day.FIGURES, "fit.json") if path.name == bias_of_day.MODEL else ("fit.json",)
    beside = next((path.parent / name for name in names if (path.parent / name).exists()), None)
    return {} if beside is None else read_judged(beside, again, method, rebiased=beside.name == bias_of_day.FIGURES)
