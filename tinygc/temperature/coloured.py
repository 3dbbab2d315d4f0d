"""The noise beside a temperature's effect: white, flicker and a random walk, their sizes estimated from the rest log itself.

Sigmas by white noise alone are too small by an order: an hour of rest holds few independent values of a bias that wanders.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from tinygc.explanation.noise.restricted_likelihood import estimate

#: of the residuals' own scatter: the prior of what is fitted, so wide that it says nothing
WIDE = 1e4


@dataclass(frozen=True, eq=False)
class Coloured:
    """sizes (3,) of white (unit/sqrt(Hz), two-sided), flicker (unit) and random walk (unit/sqrt(s)); C (K, K) what they make together."""

    sizes: np.ndarray
    C: np.ndarray

    def factor(self, rows: np.ndarray | slice = slice(None)) -> np.ndarray:
        """Lower Cholesky factor of the covariance of some knots."""
        part = self.C[rows][:, rows]
        return cholesky(part, lower=True, check_finite=False)


def estimate_noise(y: np.ndarray, A: np.ndarray, V: list[np.ndarray], white: float) -> Coloured:
    """Of knots y (K,) with all that is fitted, A (K, p); V of unit sizes (``Knots.covariances``); white: its size by the blocks' steps."""
    scatter = float(np.std(y - A @ np.linalg.lstsq(A, y, rcond=None)[0])) or white or 1.0
    longest = float(np.sqrt(V[2].max()))
    usual = np.array([white or scatter * np.sqrt(1 / V[0].max()), scatter, scatter / longest])
    J = A / np.maximum(np.abs(A).max(axis=0), 1e-12) * (WIDE * scatter)
    base = V[0] * (0.5 * usual[0]) ** 2
    found = estimate(y, J, base, [*V], usual, [None] * 3, [np.arange(len(y))], steps=25)
    sizes = found.s.copy()
    sizes[0] = np.hypot(sizes[0], 0.5 * usual[0])
    return Coloured(sizes, sum((v * s**2 for v, s in zip(V, sizes, strict=True)), np.zeros_like(base)))


def whiten(L: np.ndarray, values: np.ndarray) -> np.ndarray:
    """L^-1 values, (K, …)."""
    return solve_triangular(L, values, lower=True, check_finite=False)
