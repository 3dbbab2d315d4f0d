"""The weighted median of units, continuous in their values and weights."""

from __future__ import annotations

import numpy as np

#: of a unit's weight, to either side of its middle: there it is the median by itself, and no other unit has a share in it
ALONE = 0.25


def weighted_median(values: np.ndarray, use: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """(T, 3) of values (T, N, 3), those with use (T, N), by weights (N,); NaN where no unit is used.

    Sorted values stand at the middle halves of their weights, and the half of all weights is read there, or between two of them: of two
    equal units their mean; of three equal ones the middle one, however far off another is.
    """
    used = np.where(use, weights, 0.0)
    value = np.where(use[..., None], values, np.inf)
    order = np.argsort(value, axis=1, kind="stable")
    value = np.take_along_axis(value, order, axis=1)
    weight = np.take_along_axis(np.broadcast_to(used[..., None], values.shape), order, axis=1)
    total = used.sum(axis=1)[:, None]
    middle_at = np.cumsum(weight, axis=1) - weight / 2 - total[:, None] / 2
    begins, ends = middle_at - ALONE * weight, middle_at + ALONE * weight
    there = np.arange(values.shape[1])[:, None] < use.sum(axis=1)[:, None, None]
    last = np.maximum((there & (begins <= 0)).sum(axis=1) - 1, 0)[:, None]
    following = np.minimum(last + 1, np.maximum(use.sum(axis=1) - 1, 0)[:, None, None])
    low, high = (np.take_along_axis(value, which, axis=1)[:, 0] for which in (last, following))
    end, begin = np.take_along_axis(ends, last, axis=1)[:, 0], np.take_along_axis(begins, following, axis=1)[:, 0]
    between = (end < 0) & (begin > end)
    with np.errstate(invalid="ignore", divide="ignore"):
        middle = np.where(between, low - end / np.where(between, begin - end, 1.0) * (high - low), low)
    return np.where(total > 0, middle, np.nan)
