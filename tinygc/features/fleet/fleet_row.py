"""A row of the fleet's table: the result of one session, and its key."""

from __future__ import annotations

import hashlib
import json
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from session import VERSION
from session.base.errors import FormatError
from session.base.numeric import sigmas_in
from session.base.records import json_text
from session.base.texts import unicode_text
from session.base.units import DEG
from session.detect.accelerometer import NAMES as TRIAD
from session.log.folder import file_key, sha256_of
from tinygc.estimation.choice import closure_figures, run_figures
from tinygc.estimation.options import FitOptions
from tinygc.features.fleet.lot import NAMES
from tinygc.features.fleet.work import STEPS, Run
from tinygc.fitting.results import FitResult
from tinygc.models import linear
from tinygc.noise.figures import FILE as NOISE

# Lists and tables in one cell of a fleet's table: JSON on one line.


def cell_of(table: list | dict) -> str:
    """Return JSON as ``session.base.results`` writes it, on one line, with sorted keys."""
    return json.dumps(json.loads(json_text(table)), separators=(",", ":"), ensure_ascii=False, sort_keys=True)


def told_by(cell: str) -> Any:
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
        table = {
            "steps": self.steps,
            "seed": self.seed,
            "earth": self.earth,
            "accelerometer": self.accelerometer,
            "effects": self.effects_sha256,
        }
        return json.dumps(table, sort_keys=True)


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
    "judged": TEXT,
    "judged_within": TEXT,
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
        "judged": result.verdict().answer,
        "judged_within": result.verdict(np.inf).answer,
        "covariance": packed(covariance),
        **{name: number(value) for name, value in zip((*VALUES, *SIGMAS), (*values, *sigmas), strict=True)},
    }


def numbers_of(result: FitResult) -> tuple[np.ndarray, np.ndarray]:
    """Return (21,) and (21, 21) in the order of ``tinygc.features.fleet.lot.NAMES``; NaN where unknown."""
    values, covariance = np.full(COUNT, np.nan), np.full((COUNT, COUNT), np.nan)
    accelerometer, joint = result.accelerometer, result.joint_covariance
    values[GYRO], covariance[GYRO, GYRO] = result.linear.model.vector, result.covariance  # type: ignore[attr-defined]
    if joint is not None:
        # A joint covariance is of the accelerometer's correction, then of the gyroscope; the triad's numbers follow the correction.
        whole = np.eye(COUNT)
        own = COUNT - linear.PARAMETERS
        whole[:own, :own] = accelerometer.jacobian
        order = [*range(own, COUNT), *range(own)]
        values[ACCEL], covariance = accelerometer.values, (whole @ joint @ whole.T)[np.ix_(order, order)]
        covariance = (covariance + covariance.T) / 2
    untold = np.isnan(values)
    unobserved = result.linear.notes.get("unobserved", [])
    untold[GYRO] |= np.isin(linear.NAMES, unobserved)
    if joint is not None:
        untold[ACCEL] |= np.isin(TRIAD, accelerometer.unobserved)
    values[untold] = np.nan
    covariance[untold] = covariance[:, untold] = np.nan
    return values, covariance
