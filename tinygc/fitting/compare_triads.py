"""The accelerometers of several sessions side by side, and the body frames that they define.

The force is M (m - b), M = Q U: U upper triangular is the sensor's triad, Q a turn of the body frame against it, where a full matrix was
given.  omega = E m + B is in that frame.  Two sessions of one sensor whose frames differ are brought into one by Q_1 Q_2', which leaves
nothing of the frames but the triad, the same in both.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.linalg import eigh

from session.accelerometer.parameters import NAMES, PARAMETERS
from session.common.errors import FormatError
from session.log.config import Accelerometer, Config
from tinygc.fitting.accelerometer import AccelerometerFit
from tinygc.fitting.agreement import Agreement, agreement
from tinygc.models.accelerometer import accelerometer_of
from tinygc.models.linear import BIAS, MATRIX
from tinygc.models.linear import PARAMETERS as GYROSCOPE_PARAMETERS

#: mode of a fit -> in words
MODES = {"given": "taken as given", "fit": "estimated from its own stills and turns", "prior": "given, and sharpened by its own stills"}
#: data that alone would know a number no better than ten sigmas of what was given say nothing of it.  Simulated sessions of 30 turns have
#: 0.04 and more, but for the scale that all axes share, which is gravity's length: 1e-7
LEAST_SHARE = 0.01
_NONE = Accelerometer(source="none")


@dataclass(frozen=True, eq=False)
class Triad:
    """mode of the fit; calibration; covariance (9, 9) of the correction that led to it, SI, None where it was taken as given; shared
    (9, 9): what of it is an error of the calibration that was given; unobserved: names of the triad's numbers."""

    mode: str = "given"
    calibration: Accelerometer = field(default_factory=lambda: _NONE)
    covariance: np.ndarray | None = None
    shared: np.ndarray | None = None
    unobserved: tuple[str, ...] = ()

    @property
    def fit(self) -> AccelerometerFit:
        """The same, as a fit says it."""
        return AccelerometerFit(self.mode, self.calibration, self.covariance, self.unobserved)


@dataclass(frozen=True, eq=False)
class TriadComparison:
    """triads; agreement of those that were estimated, in the numbers that all of them show; None where fewer than two were."""

    triads: tuple[Triad, ...]
    agreement: Agreement | None

    @property
    def rows(self) -> list[tuple[str, str, str, list[float | None], list[float | None]]]:
        """Of the corrections: word, component, unit, and of each session value, None where it is not observed, and sigma, None where it
        was given."""
        return self._side_by_side([triad.fit.rows() for triad in self.triads])

    @property
    def errors(self) -> list[tuple[str, str, str, list[float | None], list[float | None]]]:
        """The same of what the sensors err by, as people are shown it."""
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
        """``accelerometer`` of ``tinygc-compare/1``."""
        return {
            "modes": [triad.mode for triad in self.triads],
            **(dict.fromkeys(("chi_square", "freedom", "p_value")) if self.agreement is None else vars(self.agreement)),
            "quantities": [
                {"word": word, "component": component, "unit": unit, "values": values, "sigmas": sigmas}
                for word, component, unit, values, sigmas in self.rows
            ],
        }


def read_triad(table: dict, fit: dict, config: Config, where: str) -> Triad:
    """Of a model file and the ``fit.json`` beside it; session.toml's where an older fit does not say.  FormatError for a damaged one."""
    said = fit.get("accelerometer") or {}
    mode = said.get("mode", "given")
    left = said.get("unobserved") or []
    calibration = accelerometer_of(table, where) or config.accelerometer
    joint = table.get("joint_covariance")
    covariance = shared = None
    if joint is not None:
        covariance, shared = (_part(joint, key, where) for key in ("matrix", "shared"))
    if mode not in MODES or not isinstance(left, list) or (mode != "given" and covariance is None and joint is not None):
        raise FormatError(f"{where}: fit.json beside it says nothing sound of the accelerometer; run `calibrate.py fit` again")
    return Triad(mode, calibration, covariance, shared, tuple(name for name in NAMES if name in left))


def _part(joint: Any, key: str, where: str) -> np.ndarray | None:
    """(9, 9) of a joint covariance; None where an older fit has none."""
    if isinstance(joint, dict) and key == "shared" and key not in joint:
        return None
    try:
        matrix = np.asarray(joint[key], dtype=float)
    except (KeyError, TypeError, ValueError):
        matrix = np.empty(0)
    if matrix.ndim != 2 or min(matrix.shape) < PARAMETERS or not np.isfinite(matrix).all():
        raise FormatError(f"{where}: joint_covariance.{key} is not 21 x 21; run `calibrate.py fit` again")
    return matrix[:PARAMETERS, :PARAMETERS]


def all_given_the_same(triads: list[Triad], configs: list[Config]) -> bool:
    """Whether one calibration was given to all sessions, and used: its error is then the same in all of them."""
    one, others = configs[0].accelerometer, [config.accelerometer for config in configs[1:]]
    same = (np.array_equal(other.matrix, one.matrix) and np.array_equal(other.bias_mps2, one.bias_mps2) for other in others)
    return all(triad.mode != "fit" for triad in triads) and all(same)


def into_frame_of(first: Triad, other: Triad) -> np.ndarray:
    """(12, 12): what turns E row by row and B of one session into the body frame of the other; exactly 1 where they have the same."""
    turned = np.eye(GYROSCOPE_PARAMETERS)
    if not np.array_equal(first.calibration.matrix, other.calibration.matrix):
        turn = first.calibration.frame @ other.calibration.frame.T
        turned[MATRIX, MATRIX], turned[BIAS, BIAS] = np.kron(turn, np.eye(3)), turn
    return turned


def frame_angle(first: Triad, other: Triad) -> float:
    """rad between two body frames."""
    turn = first.calibration.frame @ other.calibration.frame.T
    return float(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1)))


def compare_triads(triads: list[Triad], configs: list[Config]) -> TriadComparison:
    """Side by side; their agreement leaves out what a calibration that all were given errs by."""
    estimated = [triad for triad in triads if triad.covariance is not None]
    seen = np.array([not any(name in triad.unobserved for triad in triads) for name in NAMES])
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
    kept = _told(whole.sum(axis=0), apart.sum(axis=0))
    if not kept.shape[1]:
        return TriadComparison(tuple(triads), None)
    return TriadComparison(tuple(triads), agreement(vectors @ kept, kept.T @ apart @ kept))


def _told(whole: np.ndarray, apart: np.ndarray) -> np.ndarray:
    """(k, j): combinations of the numbers that the recordings tell, and not the calibration that they were given alone.

    Where data have a share s in what is known, and what was given has 1 - s, apart is s of the whole, too.
    """
    share, directions = eigh(apart, whole)
    return directions[:, share > LEAST_SHARE]


#: what a table shows each number with
DIGITS = {"ppm": 0, "mrad": 3, "mg": 3}
