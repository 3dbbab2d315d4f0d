"""What the keys that all kinds of model share must hold, and the ranges that their numbers have (``session/files/shapes.py``)."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG, G
from session.files.shapes import Array, Keys, ListOf, MapOf, Maybe, Number, Text

#: of a factor on a rate or a force: even units that are mixed up, or mdps for dps, are within it
FACTOR = Number(-1e4, 1e4)
#: what no gyroscope and no accelerometer measures (session/common/plausible.py), rad/s and m/s^2
RATE, FORCE = Number(-1e5 * DEG, 1e5 * DEG), Number(-1e4 * G, 1e4 * G)
CELSIUS = Number(-1e4, 1e4)
SECONDS = Number(-1e9, 1e9)
#: of a matrix's smallest response to its largest: below, one of its axes lies within half a degree of the plane of the others
SINGULAR = 1e-2
#: of correlations
ROUNDING = 1e-6


def invertible(matrix: np.ndarray) -> str:
    """What is wrong with a matrix (3, 3) that must be undone; empty for none."""
    responses = np.linalg.svd(matrix, compute_uv=False)
    if responses[-1] <= SINGULAR * responses[0]:
        return "is singular, expected a matrix that keeps all three axes apart"
    return "mirrors the axes, expected a matrix that turns a right-handed triad into one" if np.linalg.det(matrix) < 0 else ""


def covariance(matrix: np.ndarray) -> str:
    """What is wrong with a covariance (n, n); empty for nothing."""
    if matrix.shape[0] != matrix.shape[1]:
        return f"has shape {matrix.shape[0]} x {matrix.shape[1]}, expected as many rows as columns"
    variance = np.diag(matrix)
    if (variance < 0).any():
        return "is not positive: it has a variance below 0; expected a covariance"
    sigma = np.sqrt(np.where(variance > 0, variance, 1.0))
    limit = np.outer(sigma, sigma)  # of sigmas: variances of 1e-300 have no product
    with np.errstate(over="ignore"):
        if (np.abs(matrix - matrix.T) > ROUNDING * limit).any():
            return "is not symmetric, expected a covariance"
    sound = (np.abs(matrix) <= (1 + ROUNDING) * limit).all() and np.linalg.eigvalsh(matrix / limit).min() > -ROUNDING
    return "" if sound else "is not positive, expected a covariance"


def certain(matrix: np.ndarray) -> str:
    """The same, where each of the numbers must be uncertain by something."""
    return covariance(matrix) or ("" if (np.diag(matrix) > 0).all() else "has a variance of 0, expected a covariance of uncertain numbers")


MATRIX = Array((3, 3), FACTOR, invertible)
COVARIANCE = Array((None, None), sound=covariance)
ORIGIN = {"method": Maybe(Text()), "session": Maybe(Text()), "sha256": Maybe(MapOf(Text()))}
#: beside what a kind has of its own
MODEL = Keys(
    may={
        **ORIGIN,
        "equation": Text(),
        "version": Text(),
        "covariance": Maybe(COVARIANCE),
        "covariance_of": ListOf(Text()),
        "covariance_units": Text(),
        "accelerometer_covariance": COVARIANCE,
        "joint_covariance": Maybe(
            Keys({"matrix": Array((None, None), sound=certain)}, {"parameters": ListOf(Text()), "shared": COVARIANCE})
        ),
        "unobserved": Maybe(ListOf(Text())),
        "bias_sigma_rps": Maybe(Array((3,), Number(0, RATE.high))),
        "began_s": MapOf(SECONDS),
        "stored": Maybe(Keys(may=ORIGIN)),
        "remaining_rps": Maybe(ListOf(Maybe(Number(0, RATE.high)))),
        "accel_change_mps2": Maybe(ListOf(Array((3,), FORCE))),
        "delay_s": SECONDS,
    }
)
