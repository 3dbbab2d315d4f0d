"""Name: which group of columns explains the residuals beyond chance.

What the calibration already fits is projected out of everything.  Each candidate's group of P columns is tested with Fisher's F, which
carries the residuals' own scale and so keeps its false alarms where the noise is larger than stated.  The smallest p-value of so
many correlated groups is not a p-value; its distribution when nothing is missing is drawn by Monte Carlo for this very design.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

DRAWS = 1000
FAMILY_WISE = 0.05
#: a direction that the nuisance leaves less of than this is not seen
UNSEEN = 1e-4


@dataclass(frozen=True, eq=False)
class Group:
    """A candidate's columns (n, r), orthonormal, after projection; gone where nothing of it is left."""

    name: str
    basis: np.ndarray


class Selection:
    """Candidates against one set of nuisance columns."""

    def __init__(self, nuisance: np.ndarray, candidates: dict[str, np.ndarray], seed: int):
        self.q = _orthonormal(nuisance)
        self.groups = [Group(name, basis) for name, columns in candidates.items() if (basis := self._left(columns)).shape[1]]
        self.n = len(nuisance)
        self._seed = seed
        self._lowest = None

    def _left(self, columns: np.ndarray) -> np.ndarray:
        size = np.linalg.norm(columns, axis=0)
        columns = columns[:, size > 0] / size[size > 0]
        left = columns - self.q @ (self.q.T @ columns)
        u, s, _ = np.linalg.svd(left, full_matrices=False)
        return u[:, s > UNSEEN]

    def log_p(self, r: np.ndarray) -> np.ndarray:
        """(groups, …) logarithm of each group's p-value for residuals r (n, …)."""
        r = r - self.q @ (self.q.T @ r)
        rss = np.sum(r**2, axis=0)
        return np.array([self._log_p_of(group, r, rss) for group in self.groups])

    def gains(self, r: np.ndarray) -> dict[str, float]:
        """Chi-square that each candidate would take up."""
        r = r - self.q @ (self.q.T @ r)
        return {group.name: float(np.sum((group.basis.T @ r) ** 2)) for group in self.groups}

    def _log_p_of(self, group: Group, r: np.ndarray, rss: np.ndarray) -> np.ndarray:
        rank = group.basis.shape[1]
        freedom = self.n - self.q.shape[1] - rank
        gain = np.sum((group.basis.T @ r) ** 2, axis=0)
        ratio = (gain / rank) / np.maximum((rss - gain) / freedom, 1e-300)
        return _log_f_tail(ratio, rank, freedom)

    def family_wise(self, log_p: float) -> float:
        """Probability that the smallest of all groups' p-values is as small as this when nothing is missing."""
        if self._lowest is None:
            draws = np.random.default_rng(self._seed).standard_normal((self.n, DRAWS))
            self._lowest = np.sort(self.log_p(draws).min(axis=0))
        # So many independent tests would have given this distribution: Sidak's formula carries it on beyond what was drawn.
        tenth = self._lowest[DRAWS // 10]
        tests = np.log1p(-0.1) / np.log1p(-np.exp(tenth))
        if log_p < self._lowest[DRAWS // 100]:
            return float(-np.expm1(tests * np.log1p(-np.exp(max(log_p, -700)))))
        return float((1 + np.searchsorted(self._lowest, log_p, side="right")) / (DRAWS + 1))


def _log_f_tail(ratio: np.ndarray, rank: int, freedom: int) -> np.ndarray:
    """Logarithm of Fisher's tail, where scipy's underflows as well: the tail is a power law there."""
    value = stats.f.logsf(ratio, rank, freedom)
    far = -freedom / 2 * np.log1p(np.maximum(ratio, 0) * rank / freedom)
    return np.where(np.isfinite(value), value, far)


def _orthonormal(columns: np.ndarray) -> np.ndarray:
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 0] / size[size > 0]
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    return u[:, s > 1e-9]
