"""Nine numbers of an accelerometer from the stills of a recording: in each of them it reads gravity's length, however it lies.

Length alone fixes the sensor's own axes only up to a turn.  The matrix is upper triangular, so x and the plane of y and x stay where
the sensor has them.  What is left between these axes and the gyro's is the gyro's calibration's to find.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import least_squares

from session.common.errors import SegmentError
from session.common.robust import sigma_of
from session.common.units import DEG, STANDARD_GRAVITY_MPS2
from session.detect.stills import Still, find_stills
from session.log.config import Accelerometer
from session.log.samples import Samples

PARAMETERS = 9
UPPER = np.triu_indices(3)
APART_RAD = 10 * DEG  #: stills nearer than this are one attitude
#: m/s^2 of a parameter's error for one m/s^2 in every still.  The public recordings reach 0.9 to 1.6, 20 random attitudes 1.6, 20 in one
#: half of the sphere 9; attitudes all about one axis reach thousands
WORST_GAIN = 10.0
FIRST_BAR = 0.01  #: of gravity: what a still may miss before it counts less, until the stills themselves say how far they miss
BAR_SIGMAS = 2.0
LEAST_BAR = 1e-7  #: of gravity; below any noise, and above rounding
ROUNDS = 20
SETTLED = 0.01


def from_stills(samples: Sequence[Samples], gravity_mps2: float = STANDARD_GRAVITY_MPS2, still_s: float = 1.0) -> Accelerometer:
    """The pre-calibration that brings every still's mean specific force to ``gravity_mps2``, upper triangular, with its bias.

    samples: the logs, accelerometer as measured in m/s^2.  A few stills that are none hardly count.  Raises SegmentError where the
    stills are too few or their attitudes too alike.
    """
    stills = [still for log in samples for still in find_stills(log, still_s)[0] if still.problem is None]
    return fit_length(force_of(stills), gravity_mps2)


def force_of(stills: Sequence[Still]) -> np.ndarray:
    """(S, 3) m/s^2: the mean specific force of each still, as measured."""
    return np.array([still.accel_mean for still in stills]).reshape(-1, 3)


def fit_length(force: np.ndarray, gravity_mps2: float) -> Accelerometer:
    """The pre-calibration under which force (S, 3) m/s^2 has gravity's length in every still.  SegmentError where it is not fixed."""
    attitudes = attitudes_of(force)
    if attitudes < PARAMETERS:
        lie = f"the stills lie in {attitudes} attitude{'s' * (attitudes != 1)}"
        raise SegmentError(
            f"{lie}; an accelerometer's {PARAMETERS} numbers need {PARAMETERS} at least: rest it on more sides, or leave them out"
        )

    def miss(x: np.ndarray) -> np.ndarray:
        return np.linalg.norm(_corrected(x, force), axis=1) - gravity_mps2

    x = np.concatenate([np.eye(3)[UPPER], np.zeros(3)])
    bar = FIRST_BAR * gravity_mps2
    for _ in range(ROUNDS):
        # A still far beyond the others stops counting.  Under soft_l1 instead, one in 24 that is 5 % long moves the bias by 10 mg.
        x = least_squares(miss, x, loss="cauchy", f_scale=bar, x_scale=_scales(gravity_mps2)).x
        sigma = float(sigma_of(miss(x))) * np.sqrt(len(force) / max(len(force) - PARAMETERS, 1))
        before, bar = bar, max(BAR_SIGMAS * sigma, LEAST_BAR * gravity_mps2)
        if abs(bar / before - 1) < SETTLED:
            break
    if not np.isfinite(x).all() or _gain(x, force, gravity_mps2) > WORST_GAIN or min(x[[0, 3, 5]]) <= 0:
        raise SegmentError(
            f"the {attitudes} attitudes of the stills do not fix an accelerometer's {PARAMETERS} numbers: "
            "rest it on all six sides and some edges, or leave its calibration out"
        )
    return Accelerometer(_matrix(x), x[6:], "stills")


def attitudes_of(force: np.ndarray) -> int:
    """How many of the directions of force (S, 3) lie apart from all that were counted before them."""
    kept: list[np.ndarray] = []
    for row in force:
        length = np.linalg.norm(row)
        if length and all(np.arccos(np.clip(row @ other / length, -1, 1)) > APART_RAD for other in kept):
            kept.append(row / length)
    return len(kept)


def _matrix(x: np.ndarray) -> np.ndarray:
    matrix = np.zeros((3, 3))
    matrix[UPPER] = x[:6]
    return matrix


def _corrected(x: np.ndarray, force: np.ndarray) -> np.ndarray:
    return Accelerometer(_matrix(x), x[6:]).correct(force)


def _scales(gravity_mps2: float) -> np.ndarray:
    """(9,) one m/s^2 in each parameter's own unit."""
    return np.concatenate([np.full(6, 1 / gravity_mps2), np.ones(3)])


def _gain(x: np.ndarray, force: np.ndarray, gravity_mps2: float) -> float:
    """m/s^2 of the worst parameter's sigma for one m/s^2 of independent noise in every still."""
    corrected = _corrected(x, force)
    unit = corrected / np.linalg.norm(corrected, axis=1, keepdims=True)
    rows, columns = UPPER
    by_matrix = unit[:, rows] * (force - x[6:])[:, columns] / gravity_mps2
    jacobian = np.concatenate([by_matrix, -unit @ _matrix(x)], axis=1)
    smallest = np.linalg.svd(jacobian, compute_uv=False)[-1]
    return float(1 / smallest) if smallest else float("inf")
