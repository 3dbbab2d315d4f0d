"""Compare the calibrations of several sessions of one sensor, gyroscope and accelerometer."""

from __future__ import annotations

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
from tinygc.closure.uncertainty import chi_square_above, normal_above
from tinygc.estimation.accelerometer import USUAL_SPREAD, AccelerometerFit
from tinygc.fitting.fit_file import model_tables, read_fit
from tinygc.fitting.fit_file import to_json as fit_to_json
from tinygc.fitting.results import FitResult
from tinygc.models.linear import BIAS, MATRIX, NAMES, WORDS, LinearModel, field_jacobian, field_vector
from tinygc.models.linear import PARAMETERS as GYROSCOPE_PARAMETERS
from tinygc.models.model import Model, accelerometer_of, certain

# Whether vectors with covariances agree: their weighted scatter about the weighted mean.


@dataclass(frozen=True)
class Agreement:
    """A chi-square test: chi_square, its degrees of freedom, and the p-value."""

    chi_square: float
    freedom: int
    p_value: float


def agreement(vectors: np.ndarray, covariances: np.ndarray) -> Agreement:
    """Test vectors (n, p) with covariances (n, p, p), each quantity scaled to its own size to avoid rounding errors."""
    scale = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)).min(axis=0)
    vectors, covariances = (vectors - vectors.mean(axis=0)) / scale, covariances / np.outer(scale, scale)
    weights = np.linalg.inv(covariances)
    mean = np.linalg.solve(weights.sum(axis=0), np.einsum("sij,sj->i", weights, vectors))
    left = vectors - mean
    chi_square = float(np.einsum("si,sij,sj->", left, weights, left))
    freedom = (len(vectors) - 1) * vectors.shape[1]
    return Agreement(chi_square, freedom, chi_square_above(chi_square, freedom))


# The accelerometers of several sessions side by side, and the body frames that they define.
#
# The force is M (m - b), M = Q U: U upper triangular is the sensor's triad, Q a rotation of the body frame against it, where a full matrix
# was given.  omega = E m + B is in that frame.  Two sessions of one sensor whose frames differ are transformed into one by Q_1 Q_2'; both
# then refer to the triad alone.

#: mode of a fit -> in words
MODES = {"given": "taken as given", "fit": "estimated from its own stills and turns", "prior": "given, and sharpened by its own stills"}
#: least share of the information from the data (a sigma of ten prior sigmas) for a parameter to be observed.  Simulated sessions of 30
#: turns have 0.04 and more, except for the common scale of all axes, which is gravity's length: 1e-7
LEAST_SHARE = 0.01
_NONE = Accelerometer(source="none")


@dataclass(frozen=True, eq=False)
class SessionTriad:
    """The accelerometer of one session: mode of the fit; calibration; covariance (9, 9) of the correction that led to it, SI, None where it
    was taken as given; shared (9, 9): its part from the given calibration; unobserved: names of the triad's parameters."""

    mode: str = "given"
    calibration: Accelerometer = field(default_factory=lambda: _NONE)
    covariance: np.ndarray | None = None
    shared: np.ndarray | None = None
    unobserved: tuple[str, ...] = ()

    @property
    def fit(self) -> AccelerometerFit:
        """Return the same as the record of a fit."""
        return AccelerometerFit(self.mode, self.calibration, self.covariance, self.unobserved)


@dataclass(frozen=True, eq=False)
class TriadComparison:
    """The triads, and the agreement of the estimated ones in the parameters observed in all; None where fewer than two were estimated."""

    triads: tuple[SessionTriad, ...]
    agreement: Agreement | None

    @property
    def rows(self) -> list[tuple[str, str, str, list[float | None], list[float | None]]]:
        """Rows of the corrections: word, component, unit, and for each session the value, None where it is not observed, and the sigma,
        None where it was given."""
        return self._side_by_side([triad.fit.rows() for triad in self.triads])

    @property
    def errors(self) -> list[tuple[str, str, str, list[float | None], list[float | None]]]:
        """The same rows for the sensor errors, for display."""
        return self._side_by_side([triad.fit.errors() for triad in self.triads])

    def _side_by_side(self, tables: list) -> list[tuple[str, str, str, list[float | None], list[float | None]]]:
        found = []
        for parts in zip(*tables, strict=True):
            key, unit, _, _, names = parts[0]
            for i, name in enumerate(names):
                seen = [name not in triad.unobserved and triad.calibration.source != "none" for triad in self.triads]
                values = [float(part[2][i]) if known else None for part, known in zip(parts, seen, strict=True)]
                sigmas = [None if part[3] is None or not known else float(part[3][i]) for part, known in zip(parts, seen, strict=True)]
                found.append((key.removesuffix(f"_{unit}").replace("_", " "), name.split()[-1], unit, values, sigmas))
        return found

    def to_json(self) -> dict:
        """Return ``accelerometer`` of ``tinygc-compare/2``."""
        return {
            "modes": [triad.mode for triad in self.triads],
            **(dict.fromkeys(("chi_square", "freedom", "p_value")) if self.agreement is None else vars(self.agreement)),
            "quantities": [
                {"name": word, "component": component, "unit": unit, "values": values, "sigmas": sigmas}
                for word, component, unit, values, sigmas in self.rows
            ],
        }


def read_triad(table: dict, fit: dict, config: Config, where: str) -> SessionTriad:
    """Read a triad from a model file and its ``fit.json``.  Raises FormatError for a damaged file."""
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
    return SessionTriad(mode, calibration, covariance, shared, tuple(name for name in ACCELEROMETER_NAMES if name in left))


def _part(joint: Any, key: str, where: str) -> np.ndarray:
    """Return the accelerometer's part (9, 9) of a joint covariance."""
    try:
        matrix = np.asarray(joint[key], dtype=float)
    except (KeyError, TypeError, ValueError):
        matrix = np.empty(0)
    if matrix.ndim != 2 or min(matrix.shape) < PARAMETERS or not np.isfinite(matrix).all():
        raise FormatError(f"{where}: joint_covariance.{key} is not 21 x 21; run `{command_line('fit')}` again")
    return matrix[:PARAMETERS, :PARAMETERS]


def all_given_the_same(triads: list[SessionTriad], configs: list[Config]) -> bool:
    """Whether one given calibration was used in all sessions: its error is then the same in all of them."""
    one, others = configs[0].accelerometer, [config.accelerometer for config in configs[1:]]
    same = (np.array_equal(other.matrix, one.matrix) and np.array_equal(other.bias_mps2, one.bias_mps2) for other in others)
    return all(triad.mode != "fit" for triad in triads) and all(same)


def into_frame_of(first: SessionTriad, other: SessionTriad) -> np.ndarray:
    """Return the transform (12, 12) of E row by row and B of one session into the body frame of the other; exactly 1 for equal frames."""
    turned = np.eye(GYROSCOPE_PARAMETERS)
    if not np.array_equal(first.calibration.matrix, other.calibration.matrix):
        turn = first.calibration.frame @ other.calibration.frame.T
        turned[MATRIX, MATRIX], turned[BIAS, BIAS] = np.kron(turn, np.eye(3)), turn
    return turned


def _frame_angle(first: SessionTriad, other: SessionTriad) -> float:
    """Return the angle in rad between two body frames."""
    turn = first.calibration.frame @ other.calibration.frame.T
    return float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))


def _compare_triads(triads: list[SessionTriad], configs: list[Config]) -> TriadComparison:
    """Compare the triads; their agreement excludes the error of a calibration that was given to all."""
    estimated = [triad for triad in triads if triad.covariance is not None]
    seen = np.array([not any(name in triad.unobserved for triad in triads) for name in ACCELEROMETER_NAMES])
    if len(estimated) < 2 or not seen.any():
        return TriadComparison(tuple(triads), None)
    vectors = np.array([triad.fit.values for triad in estimated])[:, seen]
    whole = np.array([triad.covariance for triad in estimated])
    apart = whole
    if all_given_the_same(triads, configs):
        shared = [np.zeros((PARAMETERS, PARAMETERS)) if triad.shared is None else triad.shared for triad in estimated]
        apart = whole - np.array(shared)
    slope = np.array([triad.fit.jacobian for triad in estimated])[:, seen]
    whole, apart = (slope @ each @ slope.transpose(0, 2, 1) for each in (whole, apart))
    between = np.diag(USUAL_SPREAD.spread[seen] ** 2)  # each session is one draw of what a switch-on does
    whole, apart = whole + between, apart + between
    kept = _told(whole.sum(axis=0), apart.sum(axis=0))
    if not kept.shape[1]:
        return TriadComparison(tuple(triads), None)
    return TriadComparison(tuple(triads), agreement(vectors @ kept, kept.T @ apart @ kept))


def _told(whole: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """Return the combinations (k, j) of the parameters that the recordings observe, not only the given calibration.

    Where data contribute a share s of the information, and the given calibration 1 - s, ``apart`` is s times ``whole``.
    """
    from scipy.linalg import eigh

    share, directions = eigh(apart, whole)
    return directions[:, share > LEAST_SHARE]


#: decimals in a table, by unit
DIGITS = {"ppm": 0, "mrad": 3, "mg": 3}


# Sessions of one sensor side by side: does the calibration agree within its stated uncertainty, and if not, what changed?
#
# Stable and unstable parameters
# ------------------------------
# E, the scale factors and misalignments, is stable.  B changes with each switch-on, and with temperature.
# The verdict is therefore on E's nine parameters, with B free in every session (the covariance includes that).  B is compared separately,
# with the drift that the fit's covariance already includes; ``bias=True`` includes it in the verdict, for sessions between which the
# sensor was never switched off.
#
# The sessions' errors are assumed independent.  Shared errors cancel in the difference: the table's, and those of the accelerometer's
# calibration, where all sessions were given the same.  A calibration estimated in each session is not shared.  E maps into the body
# frame that the accelerometer's matrix defines; where the frames differ, all are transformed into the first one's.
#
# The statistic is the weighted scatter about the weighted mean, chi^2 = sum (x_i - x)^T P_i^-1 (x_i - x), of p (n - 1) degrees of
# freedom; with two sessions it is the difference's d^T (P_1 + P_2)^-1 d.

SCHEMA = "tinygc-compare/2"
#: p-value below which a disagreement is significant
DIFFERS_P = 0.01
#: names of the quantities that E's nine parameters give, and B's three
LASTING, SWITCH_ON = ("scale factor error", "misalignment"), ("bias",)


@dataclass(frozen=True, eq=False)
class Calibrated:
    """One fitted session: vector (12,) and covariance (12, 12) of least squares; unobserved parameters; hashes of its logs; notes;
    accelerometer (12, 12): part of the covariance from the accelerometer's given calibration; triad: its nine parameters."""

    folder: Path
    config: Config
    vector: np.ndarray
    covariance: np.ndarray
    unobserved: tuple[str, ...]
    hashes: tuple[str, ...]
    notes: tuple[str, ...]
    accelerometer: np.ndarray | None = None
    triad: SessionTriad = field(default_factory=SessionTriad)

    @property
    def name(self) -> str:
        """Name of its folder."""
        return printable(self.folder.resolve().name)


@dataclass(frozen=True)
class Moved:
    """A quantity that differs in one session from the rest: by how much, in unit, and by how many sigmas; p_value is corrected for the
    number of quantities and sessions compared."""

    session: str
    name: str
    component: str
    unit: str
    by: float
    sigmas: float
    p_value: float


@dataclass(frozen=True, eq=False)
class Comparison:
    """The comparison of sessions: agreement of E (lasting), of B (bias) and of both (all); values and sigmas (sessions, quantities) of the
    sensor errors; sigmas_off (sessions, quantities): each session against the rest; moved: significant changes, largest first; with_bias:
    whether the verdict includes B; triads: the accelerometers, side by side."""

    sessions: tuple[Calibrated, ...]
    lasting: Agreement
    bias: Agreement
    all: Agreement
    labels: tuple[tuple[str, str, str], ...]
    values: np.ndarray
    sigmas: np.ndarray
    sigmas_off: np.ndarray
    moved: tuple[Moved, ...]
    notes: tuple[str, ...]
    with_bias: bool
    triads: TriadComparison

    @property
    def verdict(self) -> Agreement:
        """The requested agreement."""
        return self.all if self.with_bias else self.lasting


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
    accelerometer = None
    if "accelerometer_covariance" in table:
        accelerometer = _matrix(table["accelerometer_covariance"])
        if accelerometer.shape != (12, 12) or not np.isfinite(accelerometer).all():
            raise FormatError(f"{path}: accelerometer_covariance is not 12 x 12; run `{command_line('fit', folder)}` again")
    triad = read_triad(table, fit, config, str(path))
    return Calibrated(folder, config, model.vector, covariance, unobserved, hashes, tuple(notes), accelerometer, triad)


def without_shared(sessions: list[Calibrated]) -> list[np.ndarray]:
    """Return each session's covariance (12, 12) without the shared error of one given calibration of the accelerometer."""
    if not all_given_the_same([s.triad for s in sessions], [s.config for s in sessions]):
        return [s.covariance for s in sessions]
    return [s.covariance if s.accelerometer is None else s.covariance - s.accelerometer for s in sessions]


def _matrix(entry: Any) -> np.ndarray:
    """Return an array of numbers; an empty one where the entry is not one."""
    try:
        return np.asarray(entry, dtype=float)
    except (TypeError, ValueError):
        return np.empty(0)


def compare(sessions: list[Calibrated], bias: bool = False) -> Comparison:
    """Compare two sessions or more.  Raises DataError where two of them are the same recording."""
    refuse_same(sessions)
    turns = [into_frame_of(sessions[0].triad, s.triad) for s in sessions]
    vectors = np.array([turn @ s.vector for turn, s in zip(turns, sessions, strict=True)])
    covariances = np.array([turn @ apart @ turn.T for turn, apart in zip(turns, without_shared(sessions), strict=True)])
    words = [(word, component, unit) for word, components, unit, _ in WORDS for component in components]
    si = np.array([size for _, components, _, size in WORDS for _ in components])
    # One Jacobian at the mean for all, so that equal differences are equal everywhere.
    jacobian = field_jacobian(vectors.mean(axis=0))
    kept = [i for i, (word, _, _) in enumerate(words) if word in LASTING + SWITCH_ON]
    values = np.array([field_vector(vector) for vector in vectors])[:, kept] / si[kept]
    spread = np.einsum("pi,sij,qj->spq", jacobian[kept] / si[kept, None], covariances, jacobian[kept] / si[kept, None])
    # Each value less the weighted mean of the other sessions', (sessions, quantities), in sigmas and in units.
    variances = np.diagonal(spread, axis1=1, axis2=2)
    weights = 1 / variances
    others = weights.sum(axis=0) - weights
    rest = ((weights * values).sum(axis=0) - weights * values) / others
    off, by = (values - rest) / np.sqrt(variances + 1 / others), values - rest
    labels = tuple(words[i] for i in kept)
    lasting = np.array([word in LASTING for word, _, _ in labels])
    looked_at = np.ones(len(kept), dtype=bool) if bias else lasting
    return Comparison(
        sessions=tuple(sessions),
        lasting=agreement(vectors[:, MATRIX], covariances[:, MATRIX, MATRIX]),
        bias=agreement(vectors[:, BIAS], covariances[:, BIAS, BIAS]),
        all=agreement(vectors, covariances),
        labels=labels,
        values=values,
        sigmas=np.sqrt(np.diagonal(spread, axis1=1, axis2=2)),
        sigmas_off=off,
        moved=_moved(sessions, labels, by, off, looked_at),
        notes=(*_notes(sessions), *_frame_notes(sessions, np.sqrt(np.einsum("sii->si", spread)), labels)),
        with_bias=bias,
        triads=_compare_triads([s.triad for s in sessions], [s.config for s in sessions]),
    )


def _moved(
    sessions: list[Calibrated], labels: tuple[tuple[str, str, str], ...], by: np.ndarray, off: np.ndarray, looked_at: np.ndarray
) -> tuple[Moved, ...]:
    """Return significant changes, corrected for the number of comparisons (Sidak); of two sessions only the second is named."""
    looks = int(looked_at.sum()) * (len(sessions) if len(sessions) > 2 else 1)
    found = []
    for s in range(len(sessions)) if len(sessions) > 2 else [1]:
        for q in np.flatnonzero(looked_at):
            p_value = float(-np.expm1(looks * np.log1p(-min(2 * normal_above(abs(off[s, q])), 1 - 1e-16))))
            word, component, unit = labels[q]
            found.append(Moved(sessions[s].name, word, component, unit, float(by[s, q]), float(off[s, q]), p_value))
    found = [moved for moved in found if moved.p_value < DIFFERS_P]
    return tuple(sorted(found, key=lambda moved: -abs(moved.sigmas)))


def refuse_same(sessions: list[Calibrated]) -> None:
    """Raise DataError where two sessions hold the same log."""
    for i, one in enumerate(sessions):
        for other in sessions[:i]:
            if set(one.hashes) & set(other.hashes):
                raise DataError(f"{other.folder} and {one.folder} hold the same log: a recording agrees with itself; give another")


def _notes(sessions: list[Calibrated]) -> tuple[str, ...]:
    notes = [f"{session.name}: {note}" for session in sessions for note in session.notes]
    notes += [f"{session.name}: not observed there: {', '.join(session.unobserved)}" for session in sessions if session.unobserved]
    first = sessions[0].config
    for session in sessions[1:]:
        sensor = session.config.sensor
        if (sensor.model, sensor.serial) != (first.sensor.model, first.sensor.serial):
            one, other = (f"{s.model} {s.serial}".strip() for s in (first.sensor, sensor))
            notes.append(f"{session.name} is of another sensor by its session.toml ({other}, not {one})")
        if sensor.gyro_fs_dps != first.sensor.gyro_fs_dps:
            notes.append(f"{session.name} has another full scale ({sensor.gyro_fs_dps:g}, not {first.sensor.gyro_fs_dps:g} dps)")
        if session.triad.mode != sessions[0].triad.mode:
            one, other = (MODES[s.triad.mode] for s in (sessions[0], session))
            notes.append(f"{session.name}: the accelerometer's calibration was {other} there, {one} in {sessions[0].name}")
        before, after = first.accelerometer, session.config.accelerometer
        given = all(s.triad.mode != "fit" for s in (sessions[0], session))
        if given and not (np.array_equal(before.matrix, after.matrix) and np.array_equal(before.bias_mps2, after.bias_mps2)):
            notes.append(f"{session.name} was given another calibration of the accelerometer: what it changed is in the difference of E")
    return tuple(notes)


def _frame_notes(sessions: list[Calibrated], sigmas: np.ndarray, labels: tuple[tuple[str, str, str], ...]) -> list[str]:
    """Return notes on sessions in another body frame, where it differs by more than a misalignment's sigma."""
    smallest = sigmas[:, [word == "misalignment" for word, _, _ in labels]].min() * 1e-3
    angles = [_frame_angle(sessions[0].triad, session.triad) for session in sessions]
    return [
        f"{session.name} is fitted in another body frame, {1e3 * angle:.2g} mrad away: E and B are turned into that of {sessions[0].name}"
        for session, angle in zip(sessions, angles, strict=True)
        if angle > smallest
    ]


def to_json(comparison: Comparison) -> dict:
    """Return the comparison as ``tinygc-compare/2``."""
    verdict = comparison.verdict
    return {
        "schema": SCHEMA,
        "sessions": [session.name for session in comparison.sessions],
        "agree": verdict.p_value >= DIFFERS_P,
        "verdict_on": "E and B" if comparison.with_bias else "E",
        **{name: vars(getattr(comparison, name)) for name in ("lasting", "bias", "all")},
        "moved": [vars(moved) for moved in comparison.moved],
        "quantities": [
            {
                "name": word,
                "component": component,
                "unit": unit,
                "values": comparison.values[:, q].tolist(),
                "sigmas": comparison.sigmas[:, q].tolist(),
                "sigmas_from_the_rest": comparison.sigmas_off[:, q].tolist(),
            }
            for q, (word, component, unit) in enumerate(comparison.labels)
        ],
        "accelerometer": comparison.triads.to_json(),
        "notes": list(comparison.notes),
    }
