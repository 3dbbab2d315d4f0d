"""How a unit is turned against the first one: from gravity in the stills of both, and from the rates of both.

Gravity gives the rotation between the accelerometers' triads, which the body frames are, and needs two directions that are not one.  The
rates give the rotation between the gyroscopes' triads, about all axes, but a gyroscope's triad is only mounted on the accelerometer's as
well as its maker could.  Both are put together by their sigmas (Wahba's problem; Markley, J. Astronaut. Sci. 36, 1988).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

#: rad; how far a gyroscope's triad is from the accelerometer's of its chip: cross-axis sensitivities of 2 % stand in data sheets
TRIADS_RAD = 0.02
#: rad; a direction of gravity by an accelerometer that nobody has calibrated: zeros of some 30 mg
DIRECTION_RAD = 0.03
#: rad; no direction is known better: a 16-bit register of 2 g has steps of 6e-5 g
LEAST_RAD = 1e-5
ROUNDS = 20


@dataclass(frozen=True, eq=False)
class Mounting:
    """matrix (3, 3): takes vectors of the unit's body frame to the array's; covariance (3, 3) rad^2, of a turn about the array's axes;
    scatter_rad: of gravity's directions, NaN with too few of them; stills: how many of them both units have."""

    matrix: np.ndarray
    covariance: np.ndarray
    scatter_rad: float
    stills: int


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) that is nearest to a matrix of positive determinant (polar decomposition)."""
    left, _, right = np.linalg.svd(matrix)
    return np.asarray(left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right)


def fit_mounting(first_force: np.ndarray, unit_force: np.ndarray, rate_matrix: np.ndarray) -> Mounting:
    """first_force, unit_force (K, 3): mean specific force in the same stills, each in its own body frame, any unit of length; rate_matrix
    (3, 3): the unit's rates from the first unit's.  K may be 0."""
    from_rates = nearest_rotation(np.linalg.inv(rate_matrix))
    ours, theirs = (force / np.linalg.norm(force, axis=1, keepdims=True) for force in (first_force, unit_force))
    count = len(ours)
    mounting, sigma = from_rates, DIRECTION_RAD
    for _ in range(ROUNDS):
        mounting, information = _weighed(ours, theirs, from_rates, sigma)
        before, freedom = sigma, 2 * count - 3
        if freedom > 0:
            sigma = max(float(np.sqrt(np.square(ours - theirs @ mounting.T).sum() / freedom)), LEAST_RAD)
        if abs(sigma - before) <= 1e-6 * before:
            break
    return Mounting(mounting, np.linalg.inv(information), sigma if 2 * count > 3 else float("nan"), count)


def _weighed(ours: np.ndarray, theirs: np.ndarray, from_rates: np.ndarray, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """The rotation of the largest likelihood, and its information (3, 3) about the array's axes: gravity's directions of a sigma each, and
    the rates' three axes, whose directions a turn by TRIADS_RAD moves."""
    axes = np.eye(3)
    weights = np.concatenate([np.full(len(ours), sigma**-2), np.full(3, TRIADS_RAD**-2 / 2)])
    to, of = np.concatenate([ours, axes @ from_rates.T]), np.concatenate([theirs, axes])
    matrix = nearest_rotation((weights[:, None, None] * to[:, :, None] * of[:, None, :]).sum(axis=0))
    information = weights.sum() * np.eye(3) - np.einsum("k,ki,kj->ij", weights, to, to)
    return matrix, information


def rotation_vector(matrix: np.ndarray) -> np.ndarray:
    """(3,) rad of a rotation matrix."""
    return np.asarray(Rotation.from_matrix(matrix).as_rotvec())
