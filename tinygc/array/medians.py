"""The weighted median of units, continuous in their values and weights."""

from __future__ import annotations

import numpy as np


def weighted_median(values: np.ndarray, use: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(T, 3) of values (T, N, 3), those with use (T, N), by weights (N,); NaN where no unit is used.

    Sorted values stand at the middle of their weights, and the median is read between them: of two equal units their mean.
    """
    used = np.where(use, weights, 0.0)
    value = np.where(use[..., None], values, np.inf)
    order = np.argsort(value, axis=1, kind="stable")
    value = np.take_along_axis(value, order, axis=1)
    weight = np.take_along_axis(np.broadcast_to(used[..., None], values.shape), order, axis=1)
    half = weight.sum(axis=1) / 2
    at = np.cumsum(weight, axis=1) - weight / 2 - half[:, None]
    known = np.isfinite(value)
    last = np.maximum((known & (at <= 0)).sum(axis=1) - 1, 0)[:, None]  # of those at or below the half
    following = np.minimum(last + 1, np.maximum(known.sum(axis=1) - 1, 0)[:, None])
    low, high = (np.take_along_axis(value, which, axis=1)[:, 0] for which in (last, following))
    before, after = (np.take_along_axis(at, which, axis=1)[:, 0] for which in (last, following))
    span = after - before
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(span > 0, np.clip(-before / span, 0, 1), 0.0)
        middle = low + share * (high - low)
    return np.where(used.sum(axis=1)[:, None] > 0, middle, np.nan)
