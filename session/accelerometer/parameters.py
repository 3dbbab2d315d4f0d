"""The nine numbers of a triad of accelerometers, and which of them a recording can tell.

The force is f = M (m - b), M upper triangular: the triad itself defines the body frame, x along the sensor's x axis, y in the plane
of its x and y.  A full matrix, as another program may give it, is such a triangle behind a frame of its own: f = T (M0 (m - b0) - d).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.log.config import Accelerometer

UPPER = np.triu_indices(3)
MATRIX, BIAS = slice(0, 6), slice(6, 9)
PARAMETERS = BIAS.stop
#: in the order of a vector: the matrix's upper triangle row by row, then the bias
NAMES = (
    "scale x",
    "nonorthogonality xy",
    "nonorthogonality xz",
    "scale y",
    "nonorthogonality yz",
    "scale z",
    "bias x",
    "bias y",
    "bias z",
)
IDENTITY = np.array([1.0, 0, 0, 1, 0, 1, 0, 0, 0])
SCALES, SHEARS, BIASES = np.array([0, 3, 5]), np.array([1, 2, 4]), np.array([6, 7, 8])


@dataclass(frozen=True, eq=False)
class Ladder:
    """One choice of what is fitted: what a person calls it, directions (9, K) of the vector, and the numbers that it leaves alone."""

    says: str
    directions: np.ndarray
    left: tuple[str, ...]

    @property
    def count(self) -> int:
        """Numbers that are fitted."""
        return self.directions.shape[1]


def _axes(*groups: np.ndarray) -> np.ndarray:
    return np.eye(PARAMETERS)[:, np.concatenate(groups)]


_ONE_SCALE = np.eye(PARAMETERS)[:, SCALES].sum(axis=1, keepdims=True)
#: what is tried, the most first.  Six faces up and down fix six numbers; a bias and one scale are the least that is worth its name
RUNGS = (
    Ladder("scale, nonorthogonality and bias", np.eye(PARAMETERS), ()),
    Ladder("scale and bias", _axes(SCALES, BIASES), tuple(NAMES[i] for i in SHEARS)),
    Ladder(
        "bias and one scale for all axes",
        np.concatenate([_ONE_SCALE, _axes(BIASES)], axis=1),
        (*(NAMES[i] for i in SHEARS), "differences of the scales"),
    ),
)


def matrix_of(x: np.ndarray) -> np.ndarray:
    """(3, 3) of a vector (9,)."""
    matrix = np.zeros((3, 3))
    matrix[UPPER] = x[MATRIX]
    return matrix


def after(x: np.ndarray, before: Accelerometer, source: str = "stills") -> Accelerometer:
    """What a correction x (9,) of the force that ``before`` gives makes of it: f = T (M0 (m - b0) - d)."""
    matrix = matrix_of(x) @ before.matrix
    return Accelerometer(matrix, before.bias_mps2 + np.linalg.solve(before.matrix, x[BIAS]), source)


def corrected(x: np.ndarray, force: np.ndarray) -> np.ndarray:
    """(S, 3) m/s^2 of forces (S, 3) under a vector (9,)."""
    return (force - x[BIAS]) @ matrix_of(x).T


def length_columns(x: np.ndarray, force: np.ndarray) -> np.ndarray:
    """(S, 9): how each number changes the length of the corrected force: m/s^2 per 1, or per m/s^2."""
    found = corrected(x, force)
    unit = found / np.linalg.norm(found, axis=1, keepdims=True)
    rows, columns = UPPER
    return np.concatenate([unit[:, rows] * (force - x[BIAS])[:, columns], -unit @ matrix_of(x)], axis=1)


def force_columns(x: np.ndarray, force: np.ndarray) -> np.ndarray:
    """(S, 3, 9): how each number changes the corrected force."""
    rows, columns = UPPER
    found = np.zeros((len(force), 3, PARAMETERS))
    found[:, rows, np.arange(6)] = (force - x[BIAS])[:, columns]
    found[:, :, BIAS] = -matrix_of(x)
    return found


def units(gravity_mps2: float) -> np.ndarray:
    """(9,) one m/s^2 in each number's own unit."""
    return np.concatenate([np.full(6, 1 / gravity_mps2), np.ones(3)])
