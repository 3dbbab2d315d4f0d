"""Variances of parts, appraisers, their interaction and repeats where the study is not balanced: by restricted likelihood.

Repeats within a cell (one part, one appraiser) are summed up first, then parts, so that only a matrix of appraisers is left, however
many sessions there are.  A balanced study gives what analysis of variance gives wherever no variance is at zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy import optimize

#: of the largest variance: what a variance of zero is in a logarithm
_LEAST = 1e-8


@dataclass(frozen=True, eq=False)
class Cells:
    """mean and count (C,) of each cell; part and appraiser (C,) as numbers; inside: sum of squares within cells, of so much freedom."""

    mean: np.ndarray
    count: np.ndarray
    part: np.ndarray
    appraiser: np.ndarray
    inside: float
    freedom: int


def cells_of(y: np.ndarray, part: np.ndarray, appraiser: np.ndarray) -> Cells:
    """Of sessions y (S,), with numbers of their parts and appraisers (S,)."""
    _, part = np.unique(part, return_inverse=True)
    _, appraiser = np.unique(appraiser, return_inverse=True)
    number = part * (appraiser.max() + 1) + appraiser
    names, cell = np.unique(number, return_inverse=True)
    count = np.bincount(cell)
    mean = np.bincount(cell, y) / count
    inside = float(np.sum((y - mean[cell]) ** 2))
    return Cells(mean, count, names // (appraiser.max() + 1), names % (appraiser.max() + 1), inside, len(y) - len(names))


def told(cells: Cells) -> np.ndarray:
    """(4,) bool: which of the variances of parts, appraisers, interaction and repeats such a study can tell."""
    parts, who, n = cells.part.max() + 1, cells.appraiser.max() + 1, len(cells.mean)
    repeats = cells.freedom > 0
    beyond = n > parts + who - 1
    return np.array([parts > 1 and (repeats or beyond), who > 1, repeats and beyond and who > 1, repeats or beyond])


def minus_twice_log_likelihood(variances: np.ndarray, cells: Cells) -> float:
    """Restricted, up to a constant, of the four variances."""
    part, who, both, again = variances
    D = both + again / cells.count
    n, parts, people = len(D), cells.part.max() + 1, cells.appraiser.max() + 1
    w = 1 / D
    by_part = np.bincount(cells.part, w, parts)
    g = part / (1 + part * by_part)
    cross = np.bincount(cells.part * people + cells.appraiser, w, parts * people).reshape(parts, people)

    def whitened(x: np.ndarray) -> np.ndarray:
        """Parts and cells undone: K^-1 x."""
        return w * (x - (g * np.bincount(cells.part, w * x, parts))[cells.part])

    S = np.diag(np.bincount(cells.appraiser, w, people)) - cross.T @ (cross * g[:, None])
    inner = np.eye(people) + who * S
    ones, y = np.ones(n), cells.mean - cells.mean.mean()
    k1, ky = whitened(ones), whitened(y)
    z1, zy = (np.bincount(cells.appraiser, k, people) for k in (k1, ky))
    solved = np.linalg.solve(inner, np.column_stack([z1, zy])) * who
    one_one, one_y, y_y = k1.sum() - z1 @ solved[:, 0], ky.sum() - z1 @ solved[:, 1], y @ ky - zy @ solved[:, 1]
    logs = np.log(D).sum() + np.log1p(part * by_part).sum() + np.linalg.slogdet(inner)[1] + np.log(one_one)
    return float(logs + y_y - one_y**2 / one_one + cells.freedom * np.log(again) + cells.inside / again)


def variances(cells: Cells) -> tuple[np.ndarray, np.ndarray]:
    """(4,): of parts, appraisers, interaction and repeats, and (4, 4) the covariance of their logarithms; NaN for what is not told."""
    can = told(cells)
    scale = max(float(np.var(cells.mean)), cells.inside / max(cells.freedom, 1), 1e-300)
    few = Cells(cells.mean / np.sqrt(scale), cells.count, cells.part, cells.appraiser, cells.inside / scale, cells.freedom)

    def cost(logs: np.ndarray) -> float:
        full = np.zeros(4)
        full[can] = np.exp(np.clip(logs, np.log(_LEAST), 25))
        full[3] = max(full[3], _LEAST)
        return minus_twice_log_likelihood(full, few)

    starts = [np.log(np.array([1.0, 0.1, 0.05, 0.1]))[can], np.log(np.array([0.3, 0.3, 0.01, 0.5]))[can]]
    bounds = [(np.log(_LEAST), 10.0)] * int(can.sum())
    options = {"ftol": 1e-11, "gtol": 1e-6}
    best = min((optimize.minimize(cost, start, method="L-BFGS-B", bounds=bounds, options=options) for start in starts), key=lambda o: o.fun)
    found, covariance = np.full(4, np.nan), np.full((4, 4), np.nan)
    found[can] = np.where(np.exp(best.x) > 10 * _LEAST, np.exp(best.x), 0.0) * scale
    inner = found[can] > 0
    curved = _curvature(cost, best.x)[np.ix_(inner, inner)]
    at = np.flatnonzero(can)[inner]
    covariance[np.ix_(can, can)] = 0.0
    covariance[np.ix_(at, at)] = np.linalg.pinv(curved / 2, hermitian=True)
    return found, covariance


def _curvature(cost: Callable[[np.ndarray], float], x: np.ndarray, step: float = 0.05) -> np.ndarray:
    """Second derivatives by differences."""
    E = np.eye(len(x)) * step

    def bent(a: np.ndarray, b: np.ndarray) -> float:
        return (cost(x + a + b) - cost(x + a - b) - cost(x - a + b) + cost(x - a - b)) / (4 * step**2)

    return np.array([[bent(a, b) for b in E] for a in E])
