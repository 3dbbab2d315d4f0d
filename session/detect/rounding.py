"""What rounding to the steps of a register leaves in the mean of readings at rest.

White noise of half a step and more spreads the readings over several steps, and their mean is right.  Below it, the mean of many readings
is off by what no further reading takes away.
"""

from __future__ import annotations

import numpy as np

#: different readings, from which on their least step is what they are rounded to
FEWEST_VALUES = 8
#: terms of the sum of rounding's harmonics
HARMONICS = 50
#: of readings: where more than this share has no more than two values, they do not show the noise
TWO_VALUES = 0.99


def rounding_variance(lsb: float, sigma: np.ndarray) -> np.ndarray:
    """Variance of the error that rounding to ``lsb`` leaves in the mean of many readings of one rate with noise sigma (…).

    The mean of rounded normal readings of mean m is m + sum over k of (-1)^k lsb / (pi k) exp(-2 (pi k sigma / lsb)^2) sin(2 pi k m / lsb)
    (Widrow & Kollár 2008, 4); its mean square over all m.  lsb^2 / 12 without noise; nothing from half a step of noise on.
    """
    if lsb == 0:
        return np.zeros(np.shape(sigma))
    k = np.arange(1, HARMONICS + 1).reshape(-1, *[1] * np.ndim(sigma))
    total = np.sum(np.exp(-((2 * np.pi * k * np.asarray(sigma) / lsb) ** 2)) / k**2, axis=0)
    rest = np.pi**2 / 6 - np.sum(1.0 / np.arange(1, HARMONICS + 1) ** 2)  # what the sum leaves out, where there is no noise
    return np.asarray(lsb**2 / (2 * np.pi**2) * (total + np.where(np.asarray(sigma) == 0, rest, 0.0)))


def rounding_of_mean(values: np.ndarray, lsb: float) -> np.ndarray:
    """(3,) variance of what rounding leaves in the mean of readings (N, 3) at rest.

    Readings of three values and more show their noise (Sheppard).  Those of two, a share p of the one, do not: noise far below a step puts
    the rate between the two, and the mean is off by up to (p - 1/2) lsb; so do those of a single one, p = 1.
    """
    if lsb == 0:
        return np.zeros(3)
    found = np.asarray(rounding_variance(lsb, np.sqrt(np.maximum(values.var(axis=0) - lsb**2 / 12, 0))))
    for axis, column in enumerate(values.T):
        counts = np.sort(np.unique(np.rint(column / lsb), return_counts=True)[1])[::-1]
        if (both := counts[:2].sum()) > TWO_VALUES * len(column):
            found[axis] = ((counts[0] / both - 0.5) * lsb) ** 2 / 3
    return found


def lsb_of(gyro: np.ndarray) -> float:
    """The least step between readings (N, 3) rad/s: what they are rounded to; 0 where too few of them differ."""
    values = np.unique(np.asarray(gyro))
    if len(values) < FEWEST_VALUES:
        return 0.0
    steps = np.diff(values)
    steps = steps[steps > 1e-12 * np.abs(gyro).max()]  # of equal decimals in other units, after a product
    return float(steps.min()) if len(steps) else 0.0
