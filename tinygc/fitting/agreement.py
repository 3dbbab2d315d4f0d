"""Whether vectors with covariances agree: their weighted scatter about the weighted mean."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats


@dataclass(frozen=True)
class Agreement:
    """chi_square of so many degrees of freedom, and the probability of more by chance."""

    chi_square: float
    freedom: int
    p_value: float


def agreement(vectors: np.ndarray, covariances: np.ndarray) -> Agreement:
    """Of vectors (n, p) with covariances (n, p, p), each scaled to its own size so that no unit is lost in rounding."""
    scale = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2)).min(axis=0)
    vectors, covariances = (vectors - vectors.mean(axis=0)) / scale, covariances / np.outer(scale, scale)
    weights = np.linalg.inv(covariances)
    mean = np.linalg.solve(weights.sum(axis=0), np.einsum("sij,sj->i", weights, vectors))
    left = vectors - mean
    chi_square = float(np.einsum("si,sij,sj->", left, weights, left))
    freedom = (len(vectors) - 1) * vectors.shape[1]
    return Agreement(chi_square, freedom, float(stats.chi2.sf(chi_square, freedom)))
