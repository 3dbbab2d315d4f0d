"""The best linear unbiased combination of units that measure one rate (Gauss and Markov; Aitken for correlated noise).

    omega = sum_i W_i x_i,   sum_i W_i = I,   W = (A^T Q^-1 A)^-1 A^T Q^-1,   covariance (A^T Q^-1 A)^-1

x_i is a unit's calibrated rate in the array's frame, Q the noise covariance of all of them, A identities one below the other.
"""

from __future__ import annotations

import numpy as np

from session.common.errors import CalibrationError

#: of eigenvalues to the greatest one: below, a covariance cannot be undone
SINGULAR = 1e-12


def best_weights(covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``(weights (N, 3, 3), covariance of the combination (3, 3))`` for a noise covariance (3 N, 3 N) of the units, unit by unit.

    CalibrationError where the covariance cannot be undone.  Any unit's weights may be negative where noise is correlated.
    """
    count = len(covariance) // 3
    scale = np.sqrt(np.diag(covariance))
    if not (scale > 0).all():
        raise CalibrationError("a unit's noise is 0: no best combination; give the noise of every axis")
    whitened = covariance / np.outer(scale, scale)
    if np.linalg.eigvalsh(whitened)[0] <= SINGULAR:
        raise CalibrationError("the units' noise covariance is singular (two units with the same noise): no best combination")
    stacked = np.tile(np.eye(3), (count, 1)) / scale[:, None]
    solved = np.linalg.solve(whitened, stacked)  # of Q^-1 A, its rows times their scale
    fused = np.linalg.inv(stacked.T @ solved)
    fused = (fused + fused.T) / 2
    weights = fused @ (solved / scale[:, None]).T
    weights = weights.reshape(3, count, 3).transpose(1, 0, 2)
    return weights, fused


def combined(weights: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """(3, 3): the covariance of a combination by any weights (N, 3, 3) of units with covariance (3 N, 3 N)."""
    row = weights.transpose(1, 0, 2).reshape(3, -1)
    return row @ covariance @ row.T


def divisible(weights: np.ndarray, fused: np.ndarray) -> bool:
    """Whether the weights of any units that are left can be renormalised: ``fused^-1 W_i``, a unit's information, is positive for each.

    Sums of such matrices have a positive symmetric part, so they can be undone.
    """
    information = np.linalg.solve(fused, weights)
    return bool(np.linalg.eigvalsh((information + information.transpose(0, 2, 1)) / 2).min() > 0)


def blocks(matrices: np.ndarray) -> np.ndarray:
    """(N k, N k): matrices (N, k, k) along the diagonal."""
    count, size, _ = matrices.shape
    whole = np.zeros((count, size, count, size))
    whole[np.arange(count), :, np.arange(count), :] = matrices
    return whole.reshape(count * size, count * size)
