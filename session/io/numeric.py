"""Two numeric idioms: scatter from medians, and the runs of a mask."""

from __future__ import annotations

import numpy as np

# Scatter from medians, which a few wild values do not move.

#: the median of |x| of a normal x, in standard deviations
MEDIAN_SIGMAS = 0.6745


def sigma_of(deviations: np.ndarray, axis: int | None = 0) -> np.ndarray:
    """Standard deviation of normal deviations (…) about zero, from the median of their sizes along an axis (None: of all)."""
    return np.median(np.abs(deviations), axis=axis) / MEDIAN_SIGMAS


def sigma_of_steps(values: np.ndarray) -> np.ndarray:
    """Standard deviation of white noise in values (N, …), from their steps: what changes slowly does not count."""
    return sigma_of(np.diff(values, axis=0)) / np.sqrt(2)


def weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    """The value (of N) up to which half of the weights (N,) lie."""
    order = np.argsort(values)
    below = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(below, below[-1] / 2)])


# Runs of rows that a mask marks.


def runs_of(mask: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """First rows (R,), and rows behind the last (R,), of each run of True in a mask (N,) bool, in order: ``start <= i < stop``."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.view(np.int8), [0]])))
    return edges[::2], edges[1::2]
