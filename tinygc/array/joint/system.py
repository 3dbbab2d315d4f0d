"""The linear system of an array: rows with variances of several components, unknowns with priors; its solution and its likelihood.

A row k, a_k x + v_k = error, has the variance base_k + sum_g t_g V_gk, t_g >= 0 the variance components.  What is random in x (the part
that all units share) is an unknown with a row of its own, value 0, whose variance is that component.  So all components are sizes of rows.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

#: of a component's step in the search, and how often it is made
SETTLED, MOST_STEPS = 1e-3, 60
#: of the typical base variance of its rows: a component below is none
NOTHING = 1e-6


@dataclass(frozen=True, eq=False)
class System:
    """design (n, P), values (n,), base (n,) variances; V (G, n) how each component enters them; prior (P,) sigmas about pull (P,): where
    the prior's centre is from here; out (n,) bool: rows that do not count."""

    design: np.ndarray
    values: np.ndarray
    base: np.ndarray
    V: np.ndarray
    prior: np.ndarray
    pull: np.ndarray
    out: np.ndarray

    def solved(self, t: np.ndarray) -> Solution:
        """At components t (G,)."""
        variance = self.base + t @ self.V
        root = np.where(self.out, 0.0, 1 / np.sqrt(variance))
        scaled = self.design * root[:, None] * self.prior
        normal = scaled.T @ scaled + np.eye(len(self.prior))
        factor = cho_factor(normal, lower=True)
        aim = -scaled.T @ (root * self.values) + self.pull / self.prior
        x = cho_solve(factor, aim)
        residual = self.values + self.design @ (self.prior * x)
        taken = solve_triangular(factor[0], scaled.T, lower=True)
        leverage = np.sum(taken**2, axis=0)
        apart = x - self.pull / self.prior
        counted = ~self.out
        value = float(
            np.sum(np.log(variance[counted])) + 2 * np.sum(np.log(np.diag(factor[0]))) + np.sum((residual * root) ** 2) + apart @ apart
        )
        return Solution(self, t, self.prior * x, residual, variance, leverage, taken, factor, value)

    def estimated(self, t: np.ndarray, held: np.ndarray | None = None) -> Solution:
        """Components by restricted maximum likelihood (Patterson & Thompson 1971), by scoring, beginning at t (G,); held (G,) bool."""
        free = np.ones(len(t), dtype=bool) if held is None else ~held
        counted = ~self.out
        least = np.array([NOTHING * np.median(self.base[(v > 0) & counted]) if ((v > 0) & counted).any() else 0.0 for v in self.V])
        found = self.solved(t)
        for _ in range(MOST_STEPS):
            slope, information = found.score()
            moving = free & ~((t <= least) & (slope < 0)) & (np.diag(information) > 0)
            if not moving.any():
                break
            step = np.zeros(len(t))
            step[moving] = np.linalg.solve(information[np.ix_(moving, moving)], slope[moving])
            size = 1.0
            for _ in range(8):
                trial = np.where(moving, np.maximum(t + size * step, 0.0), t)
                again = self.solved(trial)
                if again.value <= found.value + 1e-9:
                    break
                size /= 3
            else:
                break
            done = np.all(np.abs(trial - t) <= SETTLED * np.maximum(trial, 30 * least)) or found.value - again.value < 1e-5
            t, found = trial, again
            if done:
                break
        return found

    def without(self, rows: np.ndarray) -> System:
        """With further rows (n,) bool that do not count."""
        return replace(self, out=self.out | rows)


@dataclass(frozen=True, eq=False)
class Solution:
    """t (G,) the components; x (P,) the change; residual (n,) that it leaves; variance (n,), and leverage (n,): how much of a row's own
    error the solution follows; value: -2 log of the restricted likelihood, less a constant."""

    system: System
    t: np.ndarray
    x: np.ndarray
    residual: np.ndarray
    variance: np.ndarray
    leverage: np.ndarray
    taken: np.ndarray
    factor: tuple[np.ndarray, bool]
    value: float

    @property
    def covariance(self) -> np.ndarray:
        """(P, P) of x."""
        inverse = cho_solve(self.factor, np.eye(len(self.x)))
        return inverse * np.outer(self.system.prior, self.system.prior)

    def score(self) -> tuple[np.ndarray, np.ndarray]:
        """(G,) slope of the log likelihood by each component, and (G, G) its information, as if rows stood alone."""
        counted = np.where(self.system.out, 0.0, 1.0)
        V, left = self.system.V * counted, 1 - self.leverage
        slope = V @ (self.residual**2 / self.variance**2 - left / self.variance) / 2
        weight = (left / self.variance) ** 2 / 2
        return slope, (V * weight) @ V.T

    def sigma(self) -> np.ndarray:
        """(G,) of the components, by the expected information."""
        counted = ~self.system.out
        root = 1 / np.sqrt(self.variance[counted])
        taken = self.taken[:, counted]
        P = (np.eye(counted.sum()) - taken.T @ taken) * root[:, None] * root
        V = self.system.V[:, counted]
        information = np.einsum("gi,ij,hj->gh", V, P**2, V, optimize=True) / 2
        there = np.diag(information) > 0
        found = np.full(len(self.t), np.inf)
        if there.any():
            found[there] = np.sqrt(np.diag(np.linalg.pinv(information[np.ix_(there, there)], hermitian=True)))
        return found

    def blocks(self, rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of blocks of rows (B, d): chi-square (B,) of each block's error against what the others leave it, and that error (B, d).

        The error as the rest of the rows predict it, which the block itself has no part in; also for rows that do not count.
        """
        design = self.system.design * self.system.prior
        error, chi = np.empty(rows.shape), np.empty(len(rows))
        for b, row in enumerate(rows):
            known = solve_triangular(self.factor[0], design[row].T, lower=True)
            inner = known.T @ known
            own = np.diag(self.variance[row])
            if self.system.out[row].all():
                error[b], spread = self.residual[row], own + inner
            else:  # taken out again: residual = (1 - H) error of prediction
                spread = own - inner
                error[b] = own @ np.linalg.solve(spread, self.residual[row])
                spread = own @ np.linalg.solve(spread, own)
            chi[b] = float(error[b] @ np.linalg.solve(spread, error[b]))
        return chi, error
