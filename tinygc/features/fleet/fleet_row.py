"""A row of the fleet's table, its key, and how a session is checked, fitted and explained into it, in whatever process."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from session import VERSION
from session.base.errors import CalibrationError, FormatError
from session.base.numeric import sigmas_in
from session.base.records import json_text
from session.base.texts import printable, unicode_text
from session.base.units import DEG
from session.detect.accelerometer import NAMES as TRIAD
from session.detect.check_stills import check_rests
from session.detect.findings import Finding, worst
from session.detect.first_look import check_folder
from session.log.config import Config, read_config
from session.log.folder import Session, file_key, read_session, sha256_of
from tinygc.closure.prepared import Prepared, first_look_at_fit
from tinygc.effects import using
from tinygc.estimation.choice import closure_figures, run_figures
from tinygc.estimation.options import FitOptions
from tinygc.estimation.session_times import date_of
from tinygc.explanation.engine import explain_session
from tinygc.features.fleet.lot import NAMES
from tinygc.features.fleet.work import STEPS, Run
from tinygc.fitting.fit import fit_session, prepared_for
from tinygc.fitting.results import FitResult
from tinygc.models import linear
from tinygc.noise.figures import FILE as NOISE

# Lists and tables in one cell of a fleet's table: JSON on one line.


def cell_of(table: list | dict) -> str:
    """Return JSON as ``session.base.results`` writes it, on one line, with sorted keys."""
    return json.dumps(json.loads(json_text(table)), separators=(",", ":"), ensure_ascii=False, sort_keys=True)


def cell_content(cell: str) -> Any:
    """Return the parsed cell.  Raises ValueError for invalid JSON, which another program must have written."""
    try:
        return json.loads(cell)
    except RecursionError:
        raise ValueError("nested too deeply") from None


# Options of a fleet that affect its numbers. They are part of every key, so that results of other options are computed separately.


@dataclass(frozen=True)
class FleetOptions(Run):
    """With effects: folders with further effects, and effects_sha256: of all files in them."""

    effects: tuple[str, ...] = ()
    effects_sha256: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "steps", tuple(step for step in STEPS if step in self.steps))
        if self.effects and not self.effects_sha256:
            object.__setattr__(self, "effects_sha256", effects_hash(self.effects))

    @property
    def of_fit(self) -> FitOptions:
        """Return the options of a fit by least squares, without training."""
        return FitOptions(methods=("least_squares",), seed=self.seed, earth=self.earth, accelerometer=self.accelerometer)

    @property
    def text(self) -> str:
        """Return all options that affect numbers, in one line, as used in the key; the location of the effect folders is not included."""
        table = {name: getattr(self, name) for name in ("steps", "seed", "earth", "accelerometer")}
        return json.dumps(table | {"effects": self.effects_sha256}, sort_keys=True)


def effects_hash(folders: tuple[str, ...]) -> str:
    """Return the SHA-256 over the Python files of folders with effects and of their subfolders, by name and content."""
    digest = hashlib.sha256()
    for folder in folders:
        for path in sorted(Path(folder).rglob("*.py")):
            name = unicode_text(path.relative_to(folder).as_posix())
            digest.update(f"{name}\0{sha256_of(path)}\n".encode())
    return digest.hexdigest()


# Key of a result: SHA-256 over all its inputs. It does not depend on the folder's location.

#: names of a session's input files, on any system, without truth.json, raw.bin and outputs of commands
INPUTS = re.compile(r"session\.toml|raw\.times|attitudes\.csv|turns\.csv|(log|closure|rest|truth).*\.csv(\.gz)?", re.IGNORECASE | re.DOTALL)
#: version of the key's format
KEY = "fleet key 1"


def key_of(folder: Path, options: FleetOptions) -> str:
    """Return the hexadecimal key: of the format of keys, the tool's version, the options, and name and SHA-256 of each input, by name.

    Raises FormatError for a folder or a file that cannot be read, whose inputs are therefore unknown.
    """
    digest = hashlib.sha256(f"{KEY}\n{VERSION}\n{options.text}\n".encode())
    for path in input_paths(folder):
        digest.update(f"{file_key(path)}\0{sha256_of(path)}\n".encode())
    if (noise := folder / "fit" / NOISE).is_file():
        digest.update(f"fit/{NOISE}\0{sha256_of(noise)}\n".encode())
    return digest.hexdigest()


def input_paths(folder: Path) -> list[Path]:
    """Return the input files by name.  Raises FormatError where the folder cannot be read, or holds none."""
    try:
        names = sorted(name for name in os.listdir(folder) if INPUTS.fullmatch(name))
    except OSError as error:
        raise FormatError(f"{folder}: {error.strerror}; expected a session folder") from None
    except ValueError:  # a list may contain arbitrary bytes
        raise FormatError(f"{folder}: is no name of a folder; expected a session folder") from None
    if not names:
        raise FormatError(f"{folder}: holds neither session.toml nor a log; expected a session folder")
    return [folder / name for name in names]


# A row of the table: the result of one session. Names of numbers in displayed units include the unit; values and sigmas are SI.

#: status of a row: completed; a step failed; its process died, twice
DONE, FAILED, DIED = "done", "failed", "died"
TEXT, INTEGER, REAL, BLOB = "TEXT", "INTEGER", "REAL", "BLOB"
#: SQL name -> type, in addition to the key and the 42 columns of parameters (docs/formats.md, table of a fleet)
FIGURES = {
    "status": TEXT,
    "step": TEXT,
    "error": TEXT,
    "model": TEXT,
    "serial": TEXT,
    "recorded": TEXT,
    "operator": TEXT,
    "station": TEXT,
    "first_look": TEXT,
    "segments": INTEGER,
    "held_out_deg": REAL,
    "floor_deg": REAL,
    "run_rmse_deg": REAL,
    "use": TEXT,
    "answer": TEXT,
    "answer_within": TEXT,
    "verdict": TEXT,
    "p_value": REAL,
}
#: long columns, at the end of a row, so that a query of a number need not read past them
LONG = {"effects": TEXT, "findings": TEXT, "covariance": BLOB}
#: column names of parameters, and of their sigmas
VALUES = NAMES
SIGMAS = tuple(f"sigma_{name}" for name in NAMES)
#: all columns but the key, in order
COLUMNS = {**FIGURES, **dict.fromkeys((*VALUES, *SIGMAS), REAL), **LONG}
COUNT = len(NAMES)
TRIANGLE = np.triu_indices(COUNT)

Row = dict[str, Any]


def empty() -> Row:
    """Return a row of unknown values."""
    return dict.fromkeys(COLUMNS)


def packed(covariance: np.ndarray) -> bytes:
    """Pack the upper triangle of (21, 21), row by row, little-endian float64; NaN where unknown."""
    return np.ascontiguousarray(covariance[TRIANGLE], dtype="<f8").tobytes()


def unpacked(blob: bytes | None) -> np.ndarray:
    """Unpack (21, 21); NaN for None."""
    covariance = np.full((COUNT, COUNT), np.nan)
    if blob is not None:
        covariance[TRIANGLE] = np.frombuffer(blob, dtype="<f8")
        covariance.T[TRIANGLE] = covariance[TRIANGLE]
    return covariance


def number(value: float | None) -> float | None:
    """Return the value as SQLite stores it: SQLite makes NaN NULL, so it is None already here and rows compare equal."""
    return None if value is None or not np.isfinite(value) else float(value)


# A fit's part of a row: closure, floor, recommended model, and the 21 numbers of ``tinygc.features.fleet.lot`` with their covariance.

LEAST_SQUARES = "least_squares"
GYRO, ACCEL = slice(0, linear.PARAMETERS), slice(linear.PARAMETERS, COUNT)


def fitted(result: FitResult) -> Row:
    """Return the fit's part of a row."""
    values, covariance = numbers_of(result)
    sigmas = sigmas_in(covariance)
    runs = [run_figures(errors[LEAST_SQUARES])["rmse_deg"] for errors in result.run_errors]
    return {
        "segments": len(result.problem.used),
        "held_out_deg": number(closure_figures(result.methods[LEAST_SQUARES].held_out)["tilt_rms_deg"]),
        "floor_deg": number(result.problem.floor.tilt_rms / DEG),
        "run_rmse_deg": number(max(runs)) if runs else None,
        "use": result.use.method,
        "answer": result.verdict().answer,
        "answer_within": result.verdict(np.inf).answer,
        "covariance": packed(covariance),
        **{name: number(value) for name, value in zip((*VALUES, *SIGMAS), (*values, *sigmas), strict=True)},
    }


def numbers_of(result: FitResult) -> tuple[np.ndarray, np.ndarray]:
    """Return (21,) and (21, 21) in the order of ``tinygc.features.fleet.lot.NAMES``; NaN where unknown."""
    values, covariance = np.full(COUNT, np.nan), np.full((COUNT, COUNT), np.nan)
    accelerometer, joint = result.accelerometer, result.joint_covariance
    values[GYRO], covariance[GYRO, GYRO] = result.linear.linear.vector, result.covariance
    if joint is not None:
        # A joint covariance is of the accelerometer's correction, then of the gyroscope; the triad's numbers follow the correction.
        whole = np.eye(COUNT)
        own = COUNT - linear.PARAMETERS
        whole[:own, :own] = accelerometer.jacobian
        order = [*range(own, COUNT), *range(own)]
        values[ACCEL], covariance = accelerometer.values, (whole @ joint @ whole.T)[np.ix_(order, order)]
        covariance = (covariance + covariance.T) / 2
    unknown = np.isnan(values)
    unknown[GYRO] |= np.isin(linear.NAMES, result.linear.unobserved)
    if joint is not None:
        unknown[ACCEL] |= np.isin(TRIAD, accelerometer.unobserved)
    values[unknown] = np.nan
    covariance[unknown] = covariance[:, unknown] = np.nan
    return values, covariance


# One session into a row, in this process or another one.

#: length limits of an error message, and of the findings in a row: a hundred thousand of them are stored
MOST_ERROR, MOST_FINDINGS = 500, 20


@dataclass(frozen=True)
class Job:
    """Job for one session.

    folder; key of its content when the job was made.
    """

    folder: str
    key: str
    options: FleetOptions


@dataclass(frozen=True)
class Outcome:
    """Result of a job: key; row, None where nothing may be stored, with the reason in trouble; cpu_s and wall_s of the job."""

    key: str
    row: Row | None
    trouble: str = ""
    cpu_s: float = 0.0
    wall_s: float = 0.0


def compute(job: Job) -> Outcome:
    """Compute a job's outcome; errors of a session are stored in its row.

    Raises CalibrationError for errors of the process: missing effects, or other effect files than the job's.
    """
    with using(job.options.effects):
        began, cpu = time.perf_counter(), time.process_time()
        folder, row = Path(job.folder), empty() | {"status": DONE}
        with _failing_at("check", row, folder):
            _fill(row, folder, job.options)
        try:
            after = key_of(folder, job.options)
        except CalibrationError as error:
            trouble = str(error)
        else:
            trouble = "" if after == job.key else f"{folder}: changed while it was read; run again"
        if job.options.effects and effects_hash(job.options.effects) != job.options.effects_sha256:
            where = ", ".join(job.options.effects)
            raise CalibrationError(f"{where}: effects have changed; let them be, and run again")
        return Outcome(job.key, None if trouble else row, trouble, time.process_time() - cpu, time.perf_counter() - began)


def _fill(row: Row, folder: Path, options: FleetOptions) -> None:
    _kept_config(row, folder, read_config(folder / "session.toml"))
    if options.steps == ("check",):
        _kept_findings(row, folder, check_folder(folder, first_look_at_fit))
        errors = [finding for finding in cell_content(row["findings"]) if finding["level"] == "error"]
        if errors:
            raise CalibrationError(": ".join(errors[0][key] for key in ("where", "what", "description")))
        return
    session = read_session(folder)
    prepared = prepared_for(session, options.of_fit, lambda what, done, of: None)
    if "check" in options.steps:
        _kept_findings(row, folder, prepared.findings + check_rests(session.rests, session.config.sensor))
    fit = None
    if "fit" in options.steps:
        with _failing_at("fit", row, folder):
            fit = fit_session(session, options.of_fit, prepared=prepared)
            row |= fitted(fit)
    if "explain" in options.steps and row["status"] == DONE:
        with _failing_at("explain", row, folder):
            row |= _explained(session, prepared, options, fit)


@contextlib.contextmanager
def _failing_at(step: str, row: Row, folder: Path) -> Iterator[None]:
    """Store a step's error as the row's one line; earlier results stay."""
    try:
        yield
    except MemoryError:
        raise  # the process is in an unknown state: the parent treats it as dead
    except (CalibrationError, OSError) as error:
        text = str(error) if isinstance(error, CalibrationError) else f"{error.filename or folder}: {error.strerror or error}"
        row |= {"status": FAILED, "step": step, "error": _without_folder(text, folder)}
    except Exception as error:  # one session must not end a run of a hundred thousand
        row |= {"status": FAILED, "step": step, "error": _without_folder(f"internal error: {type(error).__name__}: {error}", folder)}


def _without_folder(text: str, folder: Path) -> str:
    """Remove the folder's name from a line, since copies of a session have other folders."""
    for where in sorted({str(folder), str(folder.resolve())}, key=len, reverse=True):
        text = text.replace(f"{where}/", "").replace(f"{where}: ", "").replace(where, "the session")
    return printable(text)[:MOST_ERROR]


def _kept_config(row: Row, folder: Path, config: Config) -> None:
    """Store a session's configuration, also where its logs cannot be read."""
    notes, sensor = config.notes, config.sensor
    recorded = _moment(date_of(folder, config)[0])
    row |= {"model": printable(sensor.model), "serial": printable(sensor.serial), "recorded": recorded}
    row |= {name: printable(str(notes[name])) if name in notes else None for name in ("operator", "station")}


def _moment(text: str | None) -> str | None:
    """Return ISO 8601, in UTC where the zone is known, so that rows sort by time; None for text that is no date."""
    try:
        found = datetime.fromisoformat(text or "")
    except ValueError:
        return None
    if found.tzinfo is not None:
        return found.astimezone(UTC).isoformat(timespec="seconds")
    return text if len(text or "") == len("2026-01-05") else found.isoformat(timespec="seconds")


def _kept_findings(row: Row, folder: Path, findings: list[Finding]) -> None:
    """Store the highest severity, and all findings worth reporting."""
    name = printable(folder.resolve().name)
    worth = sorted((finding for finding in findings if finding.level in ("warning", "error")), key=lambda each: each.level)
    kept = [
        {"level": each.level, "where": "session" if each.where == name else each.where, "what": each.what}
        | {"description": _without_folder(each.description, folder), "advice": _without_folder(each.do, folder)}
        for each in worth[:MOST_FINDINGS]
    ]
    row |= {"first_look": worst(findings), "findings": cell_of(kept)}


def _explained(session: Session, prepared: Prepared, options: FleetOptions, fit: FitResult | None) -> Row:
    found = explain_session(session, prepared=prepared, fit=fit, seed=options.seed, use_earth=options.earth)
    effects = cell_of([claim.to_json() for claim in found.claimed])
    return {"verdict": found.verdict, "p_value": number(found.p_value), "effects": effects}
