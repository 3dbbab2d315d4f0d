"""A fitted session as the calibration that it is: the model of least squares with its covariance, and the accelerometer's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from session.base.errors import DataError, FitError, FormatError
from session.base.names import CLOCKS, log_paths, refuse_special
from session.base.records import json_text
from session.base.results import read_json_text
from session.base.texts import command_line, printable
from session.detect.accelerometer import NAMES as ACCELEROMETER_NAMES
from session.detect.accelerometer import PARAMETERS
from session.log.config import Accelerometer, Config, read_config
from session.log.folder import hash_of_log, sha256_of
from tinygc import models
from tinygc.estimation.accelerometer import AccelerometerFit, into_frame_of
from tinygc.fitting.fit_file import model_tables, read_fit
from tinygc.fitting.fit_file import to_json as fit_to_json
from tinygc.fitting.results import FitResult
from tinygc.models.linear import NAMES, LinearModel
from tinygc.models.model import Model, accelerometer_of, certain

#: p-value below which a disagreement is significant
DIFFERS_P = 0.01
#: mode of an accelerometer's fit -> in words
MODES = {"given": "taken as given", "fit": "estimated from its own stills and turns", "prior": "given, and sharpened by its own stills"}


@dataclass(frozen=True, eq=False)
class Calibrated:
    """One fitted session: vector (12,) and covariance (12, 12) of least squares; unobserved parameters; hashes of its logs; notes; of_given
    (12, 12): part of the covariance from the accelerometer's given calibration; triad: the accelerometer, and triad_of_given (9, 9) the
    same part of its covariance."""

    folder: Path
    config: Config
    vector: np.ndarray
    covariance: np.ndarray
    unobserved: tuple[str, ...]
    hashes: tuple[str, ...]
    notes: tuple[str, ...]
    of_given: np.ndarray | None = None
    triad: AccelerometerFit = field(default_factory=lambda: AccelerometerFit("given", Accelerometer(source="none")))
    triad_of_given: np.ndarray | None = None

    @property
    def name(self) -> str:
        """Name of its folder."""
        return printable(self.folder.resolve().name)


def read_calibrated(folder: Path) -> Calibrated:
    """Read a session's least-squares calibration.  Raises FormatError where it has not been fitted."""
    config, path = read_config(folder / "session.toml"), folder / "fit" / "model_least_squares.json"
    if not path.exists():
        refuse_special(folder)
        raise FormatError(f"{path}: not found; run `{command_line('fit', folder)}` first")
    model, table = models.load_with_table(path)
    hashes = tuple(sha256_of(log) for log in log_paths(folder, "log"))
    do = f"run `{command_line('fit', folder)}` again"
    fit = read_fit(folder / "fit" / "fit.json", do)
    if fit.get("goodness") is None:
        raise FormatError(f"{folder / 'fit' / 'fit.json'}: goodness is missing, expected a table; {do}")
    return _calibrated(folder, config, path, (model, table), fit, hashes)


def calibrated_of(result: FitResult, config: Config) -> Calibrated:
    """Return the same of a fit that need not lie in a folder; config: of the session as it was given to the fit.

    Raises FitError where least squares was not fitted.
    """
    table = model_tables(result).get("least_squares")
    if table is None:
        raise FitError(f"{result.session.name}: least_squares was not fitted, and only that is compared; fit it as well")
    fit = read_json_text(json_text(fit_to_json(result)), "fit.json")
    hashes = tuple(hash_of_log(log) for log in result.session.logs)
    path = Path(f"{result.session.name}: model_least_squares.json")
    return _calibrated(result.session.folder, config, path, (models.from_dict(table), table), fit, hashes)


def _calibrated(folder: Path, config: Config, path: Path, stored: tuple[Model, dict], fit: dict, hashes: tuple[str, ...]) -> Calibrated:
    """Return the record of a fitted session; stored: its model with the table of its file, ``path``; fit: its figures."""
    model, table = stored
    covariance = _matrix(table.get("covariance"))
    if not isinstance(model, LinearModel) or covariance.shape != (12, 12) or not np.isfinite(covariance).all():
        raise FormatError(f"{path}: no linear model with a covariance of 12 x 12; run `{command_line('fit', folder)}` again")
    if certain(covariance) or np.linalg.eigvalsh(covariance / np.sqrt(np.outer(*[np.diag(covariance)] * 2))).min() <= 0:
        raise FormatError(f"{path}: the covariance is not positive definite; run `{command_line('fit', folder)}` again")
    notes = []
    if fit["goodness"]["p_value"] < DIFFERS_P:
        notes.append("its closure is above its noise floor: its sigmas are widened for that, and `explain` says why")
    if table.get("clock", CLOCKS[0]) != CLOCKS[0]:
        notes.append(f"its scale is by the computer's clock (--clock {table['clock']})")
    unobserved = tuple(name for name in NAMES if name in (table.get("unobserved") or ()))
    of_given = None
    if "accelerometer_covariance" in table:
        of_given = _matrix(table["accelerometer_covariance"])
        if of_given.shape != (12, 12) or not np.isfinite(of_given).all():
            raise FormatError(f"{path}: accelerometer_covariance is not 12 x 12; run `{command_line('fit', folder)}` again")
    triad, triad_of_given = _triad(table, fit, config, str(path))
    return Calibrated(folder, config, model.vector, covariance, unobserved, hashes, tuple(notes), of_given, triad, triad_of_given)


def _triad(table: dict, fit: dict, config: Config, where: str) -> tuple[AccelerometerFit, np.ndarray | None]:
    """The accelerometer of a model file and its ``fit.json``, and the part (9, 9) of its covariance from a given calibration.

    Raises FormatError for a damaged file.
    """
    said = fit.get("accelerometer") or {}
    mode = said.get("mode", "given")
    left = said.get("unobserved") or []
    calibration = accelerometer_of(table, where) or config.accelerometer
    joint = table.get("joint_covariance")
    covariance = shared = None
    if joint is not None:
        covariance, shared = (_part(joint, key, where) for key in ("matrix", "shared"))
    if mode not in MODES or not isinstance(left, list) or (mode != "given" and covariance is None and joint is not None):
        raise FormatError(f"{where}: fit.json beside it says nothing sound of the accelerometer; run `{command_line('fit')}` again")
    return AccelerometerFit(mode, calibration, covariance, tuple(name for name in ACCELEROMETER_NAMES if name in left)), shared


def _part(joint: Any, key: str, where: str) -> np.ndarray:
    """Return the accelerometer's part (9, 9) of a joint covariance."""
    matrix = _matrix(joint.get(key) if isinstance(joint, dict) else None)
    if matrix.ndim != 2 or min(matrix.shape) < PARAMETERS or not np.isfinite(matrix).all():
        raise FormatError(f"{where}: joint_covariance.{key} is not 21 x 21; run `{command_line('fit')}` again")
    return matrix[:PARAMETERS, :PARAMETERS]


def _matrix(entry: Any) -> np.ndarray:
    """Return an array of numbers; an empty one where the entry is not one."""
    try:
        return np.asarray(entry, dtype=float)
    except (TypeError, ValueError):
        return np.empty(0)


def all_given_the_same(sessions: Sequence[Calibrated]) -> bool:
    """Whether one given calibration of the accelerometer was used in all sessions: its error is then the same in all of them."""
    one = sessions[0].config.accelerometer
    return all(each.triad.mode != "fit" and each.config.accelerometer.is_as(one) for each in sessions)


def in_one_frame(sessions: Sequence[Calibrated], frame: Accelerometer) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vectors (n, 12) and covariances (n, 12, 12) in the body frame that an accelerometer defines, whole, and without the shared error of
    one given calibration of the accelerometer."""
    alike, turns = all_given_the_same(sessions), [into_frame_of(frame, each.triad.calibration) for each in sessions]
    apart = [s.covariance - s.of_given if alike and s.of_given is not None else s.covariance for s in sessions]
    whole, own = (
        np.array([turn @ each @ turn.T for turn, each in zip(turns, of, strict=True)]) for of in ([s.covariance for s in sessions], apart)
    )
    return np.array([turn @ s.vector for turn, s in zip(turns, sessions, strict=True)]), whole, own


def refuse_same(sessions: Sequence[Calibrated]) -> None:
    """Raise DataError where two sessions hold the same log."""
    for i, one in enumerate(sessions):
        for other in sessions[:i]:
            if set(one.hashes) & set(other.hashes):
                raise DataError(f"{other.folder} and {one.folder} hold the same log: a recording agrees with itself; give another")
