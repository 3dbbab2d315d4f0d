"""Prove: rows that an estimate never saw, predicted with and without a hypothesis.

Folds are every k-th of the parts in order of time, held out together with what they share.  Rows k of a fold, by the parameters of all
others, one Gauss-Newton step from the estimate of all (``left_out``):

    r_k + J_k H (C^-1 J)_k' P_kk^-1 (C^-1 r)_k,      H = (J' C^-1 J + 1)^-1,      P = C^-1 - C^-1 J H J' C^-1

An improvement is tested by Wilcoxon's signed ranks of the squares with and without, part by part, whatever one part's errors are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tinygc.inference.choose import normal_above

#: ten-fold cross-validation, stratified in time (Kohavi 1995)
FOLDS = 10


def folds_of(count: int, folds: int = FOLDS) -> list[np.ndarray]:
    """Indices of the parts that are held out together: every ``folds``-th."""
    return [np.arange(k, count, folds) for k in range(min(folds, count))]


def left_out(
    r: np.ndarray,
    J: np.ndarray,
    precision: np.ndarray,
    pulled_r: np.ndarray,
    pulled_J: np.ndarray,
    parts: Sequence[np.ndarray],
) -> np.ndarray:
    """(n,) rows r as predicted from the other parts' rows; NaN of rows in no part; of a row in several, by the last.

    r (n,), J (n, p): at the optimum of all rows, J in units of the priors' sigmas; precision (n, n): C^-1; pulled: C^-1 r and C^-1 J.
    Leaving rows out is giving each a free number of its own; the parameters then move by what these rows contributed.
    """
    inverse = np.linalg.inv(J.T @ pulled_J + np.eye(J.shape[1]))
    found = np.full(len(r), np.nan)
    for rows in parts:
        across = pulled_J[rows]
        own = precision[np.ix_(rows, rows)] - across @ inverse @ across.T
        # At the optimum of all rows J' C^-1 r is balanced by the priors, so only the contribution of the left-out rows changes it.
        taken = np.linalg.solve(own, pulled_r[rows])
        found[rows] = r[rows] + J[rows] @ (inverse @ (across.T @ taken))
    return found


#: number of differences up to which all assignments of signs are counted
EXACT_UP_TO = 50


def signed_ranks_above(differences: np.ndarray) -> float:
    """Wilcoxon signed-rank test: one-sided p-value of the sum of positive ranks for symmetric differences (n,).

    Zeros, and what is no number, are left out; ties share their mean rank.  Exact up to ``EXACT_UP_TO``; above, a normal approximation
    with the ties' variance.
    """
    left = differences[(differences != 0) & ~np.isnan(differences)]
    if not len(left):
        return 1.0
    _, place, counts = np.unique(np.abs(left), return_inverse=True, return_counts=True)
    twice = (2 * np.cumsum(counts) - counts + 1)[place]  # doubled ranks, since those of ties may be half-integers
    positive = int(np.sum(twice[left > 0]))
    if len(left) <= EXACT_UP_TO:
        ways = np.zeros(int(np.sum(twice)) + 1)
        ways[0] = 1.0
        for rank in twice:
            ways[rank:] += ways[:-rank].copy()
        return float(np.sum(ways[positive:]) / np.sum(ways))
    sigma = math.sqrt(float(np.sum(twice.astype(float) ** 2)))
    return normal_above((2 * positive - float(np.sum(twice))) / sigma)
