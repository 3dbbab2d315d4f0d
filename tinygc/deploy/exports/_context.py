"""The context of a model: the session, the fit, the covariance, the noise figures, and their origin."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import isinf
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.names import log_paths
from session.base.progress import Reporter, no_report
from session.base.records import json_text
from session.base.results import read_json, read_json_text
from session.base.texts import command_line, printable, significant
from session.base.units import DEG_PER_HOUR, MG
from session.detect.accelerometer import BIASES, PARAMETERS, SCALES
from session.log.config import Accelerometer, Config, Protocol, Sensor, Site, read_config
from session.log.folder import file_key, input_hashes, sha256_of
from session.log.logfile import read_log
from tinygc import models
from tinygc.deploy import ExportError, ExportOptions
from tinygc.deploy.calibration import effects_of_session_time
from tinygc.estimation.accelerometer import AccelerometerFit
from tinygc.estimation.choice import worse_in_table
from tinygc.estimation.spread import ACCELEROMETER, ZERO
from tinygc.fitting.fit_file import model_tables, read_evaluated, to_json
from tinygc.fitting.results import AT_END, FitResult
from tinygc.fitting.unit_state import spread_of
from tinygc.models.linear import BIAS
from tinygc.models.model import Model, accelerometer_of
from tinygc.noise import figures
from tinygc.noise.figures import Inflation, NoiseFigures

#: the default method
PREFERRED = "least_squares"
LONGEST_NAME = 80
#: what gives noise figures: a file, a folder that holds one, or the record
NoiseSource = Path | NoiseFigures | None
#: relative difference of two data rates above which they are two settings of the sensor
SAME_RATE = 0.05


@dataclass(frozen=True, eq=False)
class Context:
    """session: its name; method: of the fit; config: ``session.toml``; table: the model file as JSON; fit: ``fit.json`` or empty;
    hashes: SHA-256 of the model file, session.toml and every log, by file name; remark: function that shows a line to the operator;
    temperatures: function that gives those of each calibration log, degC, None of a log without; noise: figures of the unit at rest;
    inflation: the one of ``noise`` that the densities are to have; rate_known: whether the data rate of the sensor is, or a guess.  Of
    noise without a model, method is None."""

    session: str
    method: str | None
    config: Config
    table: dict
    fit: dict
    hashes: dict[str, str]
    remark: Reporter = no_report
    temperatures: Callable[[], list[np.ndarray | None]] = list
    noise: NoiseFigures | None = None
    inflation: Inflation | None = None
    rate_known: bool = True

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
        own = self.covariance
        if own is None or "bias_sigma_rps" not in self.table:
            return None
        found = own.copy()
        found[BIAS, BIAS] += spread_of(None, self.table).at(ZERO).two_draws
        return found

    @property
    def accelerometer(self) -> Accelerometer:
        """The accelerometer calibration of the fit, from the model's file, else session.toml's.  Source ``none``: not calibrated."""
        own = accelerometer_of(self.table)
        return self.config.accelerometer if own is None else own

    @property
    def accelerometer_any_session(self) -> np.ndarray | None:
        """(9,) SI: one sigma of the triad's numbers in any other session; None where it was given."""
        joint = self.table.get("joint_covariance")
        if joint is None or self.accelerometer.source == "none":
            return None
        own = np.asarray(joint["matrix"], dtype=float)[:PARAMETERS, :PARAMETERS]
        return AccelerometerFit("fit", self.accelerometer, own, between=spread_of(None, self.table).at(ACCELEROMETER)).any_session

    @property
    def accelerometer_words(self) -> str:
        """Origin of the accelerometer calibration, and its numbers that kept their initial values because they were not observed."""
        words = {
            "given": "as it was given",
            "prior": "the given one, sharpened by the session's stills and turns",
            "stills": "from the session's own stills and turns",
            "none": "not calibrated: as measured",
        }[self.accelerometer.source]
        if self.accelerometer_any_session is not None:
            spread = self.accelerometer_any_session
            scale, zero = (significant(spread[which].max() / si, 2) for which, si in ((SCALES, 1e-6), (BIASES, MG)))
            words = f"{words}; in any other session its scale is within ± {scale} ppm and its bias within ± {zero} mg (one sigma)"
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
        seen = [values for values in self.temperatures() if values is not None]
        return (float(min(map(np.min, seen))), float(max(map(np.max, seen)))) if seen else None


def read_context(
    folder: Path,
    options: ExportOptions,
    remark: Reporter,
) -> tuple[Model | None, Context]:
    """Return ``(model, Context)`` of a fitted session, of a folder with noise figures alone, or of a file of noise figures; model: None
    where there are only figures.

    Its model is one of the fit's by its method, or a file's; the default is least squares.  Its noise: those next to the model by default.
    Raises ExportError where there is neither fit nor figures, for figures of another sensor, and for a refused model; FormatError for
    files that cannot be read.
    """
    method, noise, inflation = options.model, options.noise, options.inflation
    if _holds_noise_alone(folder):
        if method is not None or noise is not None:
            raise ExportError(f"{folder} holds noise figures alone: --model and --noise go with a session folder")
        return None, _context_of_noise(folder, inflation, remark)
    config = read_config(folder / "session.toml")
    home = folder / "fit" / figures.FILE
    source = home if noise is None and home.exists() else noise
    if source is not None and method is None and not any((folder / "fit").glob("model_*.json")):
        hashes = {"session.toml": sha256_of(folder / "session.toml")}
        context = Context(printable(folder.resolve().name), None, config, {}, {}, hashes, remark)
        return None, _with_noise(context, source, inflation)
    path = _model_path(folder, method)
    there = {name for name in ("physics", f"physics{AT_END}") if (folder / "fit" / f"model_{name}.json").exists()}
    _remark_on_physics(there if method is None else set(), remark)
    model, table = models.load_with_table(path)
    _refuse_session_time(model, path)
    logs = log_paths(folder, "log")
    hashes = {file_key(source): sha256_of(source) for source in [path, folder / "session.toml", *logs, *log_paths(folder, "closure")]}
    name: str = table.get("session") or printable(folder.resolve().name)
    named: str = table.get("method") or path.stem.removeprefix("model_")
    tested = named.removesuffix(AT_END)
    of_fit = path.parent / "fit.json"
    fit = read_evaluated(of_fit, f"run `{command_line('fit', folder)}` again", tested) if of_fit.exists() else {}
    _refuse_worse(path.name, fit, tested, remark, options.anyway)
    context = Context(
        name, named, config, table, fit, hashes, remark, lambda: [read_log(log, config.sensor).samples.temp_c for log in logs]
    )
    return model, _with_noise(context, source, inflation)


def context_of_fit(
    result: FitResult,
    options: ExportOptions,
    remark: Reporter,
) -> tuple[Model, Context]:
    """Return the same of a fit that need not lie in a folder; model: one of its own, least squares by default; noise: none by default.

    Raises ExportError for a model that was not fitted, and as ``read_context``.
    """
    tables = model_tables(result)
    name = options.model or PREFERRED
    if name not in tables:
        raise ExportError(f"{name} was not fitted; the fit has {', '.join(tables)}")
    _remark_on_physics(set(tables) if options.model is None else set(), remark, 'model="{}"')
    path = Path(f"model_{name}.json")
    model = models.from_dict(tables[name], path.name)
    _refuse_session_time(model, path, 'model="{}"')
    fit = read_json_text(json_text(to_json(result)), "fit.json")  # as the file has it: null for what is no number
    _refuse_worse(path.name, fit, name.removesuffix(AT_END), remark, options.anyway, "anyway=True")
    session = result.session
    text = json_text(tables[name]) + "\n"  # as ``save_models`` writes it
    hashes = {path.name: hashlib.sha256(text.encode()).hexdigest(), **input_hashes(session)}
    temperatures = [log.samples.temp_c for log in session.logs]
    context = Context(session.name, name, session.config, tables[name], fit, hashes, remark, lambda: temperatures)
    return model, _with_noise(context, options.noise, options.inflation)


# Noise figures: from a file, a folder or a record; those of another sensor are refused.


def _holds_noise_alone(source: Path) -> bool:
    """Whether the source of an export is a file of noise figures, or a folder with one and without ``session.toml``."""
    if not source.is_file():
        return not (source / "session.toml").exists() and _noise_file(source) is not None
    try:
        table = read_json(source)
    except (FormatError, OSError):
        return False
    return isinstance(table, dict) and str(table.get("schema")).startswith(NoiseFigures.schema.partition("/")[0])


def _noise_file(source: Path) -> Path | None:
    """The file of noise figures in a folder or in its ``fit``; a file is itself; None where there is none."""
    if source.is_file():
        return source
    return next((path for path in (source / "fit" / figures.FILE, source / figures.FILE) if path.exists()), None)


def _context_of_noise(source: Path, inflation: str | None, remark: Reporter) -> Context:
    """Context of noise figures without a session: sensor, serial and data rate are those of the file."""
    path = _noise_file(source) or source
    found = figures.read_figures(path)
    sensor = Sensor(found.sensor, found.serial, found.rate_hz, float("nan"), float("nan"))
    config = Config(sensor, Accelerometer(source="none"), Site(), Protocol())
    context = Context(printable(path.resolve().name), None, config, {}, {}, {}, remark, rate_known=found.rate_known)
    return _with_noise(context, path, inflation)


def _with_noise(context: Context, source: NoiseSource, inflation: str | None) -> Context:
    """Return the context with noise figures.  Raises ExportError for those of another sensor, and for a motion that they do not have."""
    if source is None:
        if inflation is not None:
            raise ExportError(f"--inflation {inflation}: its factors stand in {figures.FILE}, and there is none; measure the noise at rest")
        return context
    hashes = context.hashes
    if isinstance(source, NoiseFigures):
        found, where = source, "the noise figures"
    else:
        path = _noise_file(source)
        if path is None:
            raise ExportError(f"{source}: no {figures.FILE} there; measure it at rest, or give the file itself")
        found, where, hashes = figures.read_figures(path), str(path), hashes | {file_key(path): sha256_of(path)}
    sensor = context.config.sensor
    for what, theirs, ours in (("sensor", found.sensor, sensor.model), ("serial number", found.serial, sensor.serial)):
        if theirs.strip() and ours.strip() and theirs.strip().casefold() != ours.strip().casefold():
            raise ExportError(f"{where}: noise of {what} {theirs}, but the session's is {ours}; give that of this unit with --noise")
    if found.rate_known and abs(found.rate_hz - sensor.odr_hz) > SAME_RATE * sensor.odr_hz:
        context.remark(
            f"the noise was recorded at {found.rate_hz:.4g} Hz, the session at {sensor.odr_hz:.4g} Hz: another filter may shape it"
        )
    motions = {each.motion: each for each in found.inflations}
    begun = [motion for motion in motions if inflation and motion.startswith(inflation)]
    if len(begun) == 1:  # its first words are enough
        inflation = begun[0]
    if inflation is not None and inflation not in motions:
        known = f"there are {', '.join(motions)}" if motions else "it has none"
        raise ExportError(f"{where}: no inflation for motion {inflation}; {known}")
    if inflation is not None and not found.gyro.is_described:
        raise ExportError(
            f"{where}: the terms do not describe the gyroscope at rest, to which the factors for {inflation} are; record again away from "
            "what shakes or warms it, or export without --inflation"
        )
    return replace(context, noise=found, inflation=motions.get(inflation) if inflation is not None else None, hashes=hashes)


# A model that may leave.


def _remark_on_physics(there: set[str], remark: Reporter, option: str = "--model {}") -> None:
    """Remark which model with physics the fit has, where no model was requested; there: names of its models; option: that takes one."""
    if "physics" in there:
        ended = AT_END if f"physics{AT_END}" in there else ""
        remark(f"least squares is exported; the fit holds physics as well: {option.format(f'physics{ended}')}")


def _refuse_session_time(model: Model, path: Path, option: str = "--model {}") -> None:
    if bygone := effects_of_session_time(model):
        raise ExportError(
            f"{path.name} corrects {', '.join(bygone)}, which follows the time of its own session and holds nowhere else; "
            f"give {option.format(path.stem.removeprefix('model_') + AT_END)}, which fit saves next to it"
        )


def _refuse_worse(name: str, fit: dict, tested: str, remark: Reporter, anyway: bool, option: str = "--anyway") -> None:
    """Raise ExportError for a model that closes held-out segments worse than raw rates, or remark it; option: to force it."""
    if worse := worse_in_table(fit, tested):
        by = "by no number that fit.json knows" if isinf(worse[0]) else f"with {worse[0]:.4g} deg"
        words = f"{name} closes held-out segments {by}, worse than the raw rates with {worse[1]:.4g} deg"
        if not anyway:
            raise ExportError(f"{words}: a device is better off without it; record more turns, or insist with {option}")
        remark(f"{words}; exported because of {option}")


def _model_path(folder: Path, method: str | None) -> Path:
    if method is not None and (method.endswith(".json") or "/" in method):
        return Path(method)
    there = {path.stem.removeprefix("model_"): path for path in sorted((folder / "fit").glob("model_*.json"))}
    if not there:
        raise ExportError(f"{folder / 'fit'}: no model; run `{command_line('fit', folder)}` first, or give --model FILE")
    wanted = method or (PREFERRED if len(there) > 1 else next(iter(there)))
    if wanted not in there:
        raise ExportError(f"{folder / 'fit'}: no model_{wanted}.json; there are {', '.join(there)}")
    return there[wanted]
