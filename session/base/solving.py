"""Linear least squares and the inverse of an information, where some directions may not be determined.

Columns are scaled to length one.  A direction of the parameters along which the scaled prediction changes by less than ``BAR`` of what the
best observed one changes is *not determined*: no finite sigma is of it, nor of any function that it moves.  A pseudo-inverse would give it
variance 0.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: singular value of columns of length one, of the largest, below which a direction is not determined; its square is 10^4 roundings
BAR = 1e-6
#: part of a function's slope that may lie along directions that are not determined: what rounding and difference quotients leave there
TOUCHED = 1e-3


@dataclass(frozen=True, eq=False)
class Solution:
    """Least squares of p numbers.

    shortest (p,) or (p, k): of all solutions the one whose scaled numbers are smallest; it predicts as well as any.  spread (p, p): the
    covariance over the directions that are determined, for rows of variance one.  open (p, p - rank): changes of the numbers, of length one
    when scaled, that no row sees; size (p,): length of the columns.
    """

    shortest: np.ndarray
    spread: np.ndarray
    open: np.ndarray
    size: np.ndarray

    @property
    def rank(self) -> int:
        """How many directions are determined."""
        return len(self.size) - self.open.shape[1]

    @property
    def is_open(self) -> np.ndarray:
        """(p,) bool: numbers that are not determined."""
        found: np.ndarray = np.linalg.norm(self.open * self.size[:, None], axis=1) > TOUCHED
        return found

    @property
    def value(self) -> np.ndarray:
        """The numbers, NaN where they are not determined."""
        found = self.shortest.copy()
        found[self.is_open] = np.nan
        return found

    @property
    def covariance(self) -> np.ndarray:
        """(p, p) for rows of variance one; of numbers that are not determined the variance is infinite, the covariances NaN."""
        return _marked(self.spread, self.is_open)

    def variance(self, slope: np.ndarray) -> float:
        """Of a function of the numbers with slopes (p,), for rows of variance one; infinite where a direction that is not determined moves
        it."""
        moved = np.linalg.norm(slope @ self.open) if self.open.size else 0.0
        if moved > TOUCHED * np.linalg.norm(slope / self.size):
            return float("inf")
        return float(max(slope @ self.spread @ slope, 0.0))


def solve(design: np.ndarray, values: np.ndarray | None = None) -> Solution:
    """Least squares of values (n,) or (n, k) by columns (n, p), both divided by the rows' sigmas; without values the spread alone.

    A column of zeros is not determined.
    """
    size = np.linalg.norm(design, axis=0)
    size[size == 0] = 1.0
    left, strength, right = np.linalg.svd(design / size, full_matrices=False)
    kept = strength > BAR * strength.max(initial=0.0)
    seen = right[kept].T / strength[kept]
    found = seen @ (left.T[kept] @ (np.zeros(len(design)) if values is None else values))
    # Where rows are fewer than numbers, the directions beyond them are those across all that are seen.
    across = np.linalg.svd(right[kept], full_matrices=True)[2][kept.sum() :].T if kept.sum() < len(size) else np.zeros((len(size), 0))
    whole = size.reshape(-1, *[1] * (found.ndim - 1))
    return Solution(found / whole, seen @ seen.T / np.outer(size, size), across / size[:, None], size)


def inverse(information: np.ndarray) -> np.ndarray:
    """Covariance (…, p, p) of an information; of numbers that are not determined the variance is infinite, the covariances NaN."""
    each = np.diagonal(information, axis1=-2, axis2=-1)
    size = np.sqrt(np.where(each > 0, each, 1.0))
    both = size[..., :, None] * size[..., None, :]
    strength, axes = np.linalg.eigh((information + np.swapaxes(information, -2, -1)) / 2 / both)
    kept = strength > BAR**2 * strength.max(axis=-1, initial=0.0, keepdims=True)
    spread = np.einsum("...ij,...j,...kj->...ik", axes, np.where(kept, 1 / np.where(kept, strength, 1.0), 0.0), axes)
    return _marked(spread / both, np.sqrt(np.sum(axes**2 * ~kept[..., None, :], axis=-1)) > TOUCHED)


def _marked(spread: np.ndarray, is_open: np.ndarray) -> np.ndarray:
    found = np.where(is_open[..., :, None] | is_open[..., None, :], np.nan, spread)
    every = np.arange(found.shape[-1])
    found[..., every, every] = np.where(is_open, np.inf, spread[..., every, every])
    return found


def unit_columns(columns: np.ndarray) -> np.ndarray:
    """Those of the columns (n, P) that are not zero, each of length one."""
    size = np.linalg.norm(columns, axis=0)
    return columns[:, size > 0] / size[size > 0]
