"""Name: which group of columns explains the residuals beyond chance.

What the calibration already fits is projected out of everything.  Each candidate's group of P columns is tested with Fisher's F, which
carries the residuals' own scale and so keeps its false alarms where the noise is larger than stated.  The smallest p-value of so
many correlated groups is not a p-value; its distribution when nothing is missing is drawn by Monte Carlo for this very design.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Generic, TypeVar

import numpy as np
from scipy import stats

#: Monte Carlo: the level of 5 % is then known to 0.7 % (binomial)
DRAWS = 1000
#: false alarms that are allowed; benchmarks/null_sessions.py finds 6.5 % +- 1.7 %
FAMILY_WISE = 0.05
#: of the family-wise level, for the candidates; the rest is for the channels' chi-square, which stated noise decides
#: (benchmarks/null_sessions.py: detection p-values uniform with it)
SHAPE_SHARE = 0.98
#: a direction that the nuisance leaves less of than this is not seen: a hundredth of a per cent, less than columns are linear to
UNSEEN = 1e-4
#: the same beside the allowances, of which there are twelve, themselves known to finite differences (``twin.SMALL_SHARE``)
UNSEEN_BESIDE = 1e-3

#: of a candidate: an id, a number, the effect itself
Name = TypeVar("Name")


@dataclass(frozen=True, eq=False)
class Group(Generic[Name]):
    """A candidate's columns (n, r), orthonormal, after projection; gone where nothing of it is left."""

    name: Name
    basis: np.ndarray


class Selection(Generic[Name]):
    """Candidates against one set of nuisance columns.

    nuisance (n, p); candidates: name -> columns (n, P); allowances (n, m): directions that the covariance is wide along;
    scale_rows: rows that tell the noise's scale; along: names of the candidates that are looked for along the allowances, too.
    """

    def __init__(
        self,
        nuisance: np.ndarray,
        candidates: Mapping[Name, np.ndarray],
        seed: int,
        *,
        allowances: np.ndarray | None = None,
        scale_rows: slice | np.ndarray = slice(None),
        along: frozenset = frozenset(),
    ):
        self.q = orthonormal(nuisance)
        self.groups = [Group(name, basis) for name, columns in candidates.items() if (basis := left_of(self.q, columns, UNSEEN)).shape[1]]
        self.n = len(nuisance)
        self._seed, self._rows, self._along = seed, scale_rows, along
        self._candidates, self._nuisance, self._allowances = candidates, nuisance, allowances
        self._lowest: np.ndarray | None = None

    def log_p(self, r: np.ndarray) -> np.ndarray:
        """(groups, …) logarithm of each group's p-value for residuals r (n, …): their order, no more."""
        r = r - self.q @ (self.q.T @ r)
        rss = np.sum(r**2, axis=0)
        return np.array([self._log_p_of(group, r, rss) for group in self.groups])

    def gains(self, r: np.ndarray) -> dict[Name, float]:
        """Chi-square that each candidate would take up."""
        r = r - self.q @ (self.q.T @ r)
        return {group.name: float(np.sum((group.basis.T @ r) ** 2)) for group in self.groups}

    def _log_p_of(self, group: Group[Name], r: np.ndarray, rss: np.ndarray) -> np.ndarray:
        rank = group.basis.shape[1]
        freedom = self.n - self.q.shape[1] - rank
        gain = np.sum((group.basis.T @ r) ** 2, axis=0)
        ratio = (gain / rank) / np.maximum((rss - gain) / freedom, 1e-300)
        return _log_f_tail(ratio, rank, freedom)

    def p_value(self, r: np.ndarray) -> float:
        """Probability that some candidate explains as much of residuals r (n,) as the best one does, when nothing is missing."""
        return self.family_wise(float(self._lowest_of(r[:, None])[0]))

    def family_wise(self, log_p: float) -> float:
        """Probability that the smallest of all groups' p-values is as small as this when nothing is missing."""
        if self._lowest is None:
            self._lowest = np.sort(self._lowest_of(np.random.default_rng(self._seed).standard_normal((self.n, DRAWS))))
        drawn = float((1 + np.searchsorted(self._lowest, log_p, side="right")) / (DRAWS + 1))
        if log_p >= self._lowest[DRAWS // 100]:
            return drawn
        # So many independent tests would have given this distribution: Sidak's formula carries it on beyond what was drawn.
        tests = np.log1p(-0.1) / np.log1p(-np.exp(self._lowest[DRAWS // 10]))
        return min((1 + DRAWS // 100) / (DRAWS + 1), float(-np.expm1(tests * np.log1p(-np.exp(max(log_p, -700))))))

    @cached_property
    def _tested(self) -> tuple[np.ndarray, list[tuple[Group[Name], bool]]]:
        """Orthonormal nuisance with the allowances, and the groups left beside it, each with whether it is along them."""
        if self._allowances is None:
            return self.q, [(group, False) for group in self.groups]
        q = orthonormal(np.concatenate([_unit(self._nuisance), _unit(self._allowances)], axis=1), UNSEEN)
        groups = []
        for name, columns in self._candidates.items():
            basis = left_of(self.q, columns, UNSEEN) if name in self._along else left_of(q, columns, UNSEEN_BESIDE)
            if basis.shape[1]:
                groups.append((Group(name, basis), name in self._along))
        return q, groups

    def _lowest_of(self, r: np.ndarray) -> np.ndarray:
        """(draws,) logarithm of the smallest p-value of residuals r (n, draws)."""
        q, groups = self._tested
        r = r - self.q @ (self.q.T @ r)
        left = (r - q @ (q.T @ r))[self._rows]
        rss, freedom = np.sum(left**2, axis=0), len(left) - np.sum(q[self._rows] ** 2)
        lowest = np.zeros(r.shape[1])
        for group, is_along in groups:
            rank = group.basis.shape[1]
            gain = np.sum((group.basis.T @ r) ** 2, axis=0)
            rest, rest_freedom = (rss, freedom) if is_along else (np.maximum(rss - gain, 1e-12 * rss), freedom - rank)
            if rest_freedom >= 1:
                ratio = (gain / rank) / np.maximum(rest / rest_freedom, 1e-300)
                lowest = np.minimum(lowest, _log_f_tail(ratio, rank, rest_freedom))
        return lowest


def _log_f_tail(ratio: np.ndarray, rank: int, freedom: int) -> np.ndarray:
    """Logarithm of Fisher's tail, where scipy's underflows as well: the tail is a power law there."""
    value = stats.f.logsf(ratio, rank, freedom)
    far = -freedom / 2 * np.log1p(np.maximum(ratio, 0) * rank / freedom)
    return np.where(np.isfinite(value), value, far)


def _unit(columns: np.ndarray) -> np.ndarray:
    """Those of the columns (n, P) that are not zero, each of length one."""
    size = np.linalg.norm(columns, axis=0)
    return columns[:, size > 0] / size[size > 0]


def left_of(q: np.ndarray, columns: np.ndarray, unseen: float = UNSEEN) -> np.ndarray:
    """Orthonormal basis of what is left of the columns beside q."""
    columns = _unit(columns)
    return orthonormal(columns - q @ (q.T @ columns), unseen, scaled=False)


def orthonormal(columns: np.ndarray, unseen: float = 1e-9, scaled: bool = True) -> np.ndarray:
    """Orthonormal basis (n, r) of columns (n, P): directions of a singular value above ``unseen``, of columns of length one if scaled."""
    u, s, _ = np.linalg.svd(_unit(columns) if scaled else columns, full_matrices=False)
    return u[:, s > unseen]
