"""Which order of polynomial, and whether with a lag: chosen by sweeps that the fit never saw.

Each sweep is left out in turn.  A candidate is fitted to the others, its lag too, and predicts it.  Of the candidates within one standard
error of the best, the simplest is taken (Breiman et al. 1984, 1-SE rule), and only if its coefficients differ from none beyond noise.

All knots count alike in a polynomial's coefficients.  Weights by the noise would trust the steps from knot to knot where the zero
wanders, and lose its level: on a public sweep they predict a third sweep's zero to 0.26 dps, where equal weights do to 0.12.  A lag
lives in just these steps, and is fitted with the weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from tinygc.temperature.coloured import Coloured, whiten
from tinygc.temperature.knots import Knots

#: lags that are tried, either sign; the longest is this share of the shortest sweep
LAGS, LONGEST_SHARE = 20, 0.25
#: where there is but one sweep: stretches of time, left out in turn
STRETCHES, STRETCH_FOLDS = 20, 5


@dataclass(frozen=True)
class Candidate:
    """order of the polynomial; lagged: whether the element's temperature is the reading's with a lag."""

    order: int
    lagged: bool

    @property
    def complexity(self) -> int:
        """How many numbers are fitted beside the zero itself."""
        return self.order + self.lagged


@dataclass(frozen=True, eq=False)
class Examined:
    """held_out (F, candidates): mean square of each fold's prediction; candidates; chosen: index; by: ``sweeps`` or ``stretches``."""

    candidates: tuple[Candidate, ...]
    held_out: np.ndarray
    chosen: int
    by: str


def folds_of(knots: Knots) -> tuple[np.ndarray, str]:
    """(K,) number of each knot's fold, and what a fold is."""
    if len(np.unique(knots.sweep)) > 1:
        return knots.sweep, "sweeps"
    return np.minimum(np.arange(len(knots)) * STRETCHES // len(knots), STRETCHES - 1) % STRETCH_FOLDS, "stretches"


def lag_grid(knots: Knots) -> np.ndarray:
    """Lags s that are tried, none among them; empty where the temperature goes one way only, which shows none."""
    if not {-1, 1} <= set(knots.direction.tolist()):
        return np.zeros(0)
    block_s = max(log.block_s for log in knots.logs)
    shortest = min(float(knots.span_s[knots.sweep == sweep].sum()) for sweep in np.unique(knots.sweep))
    longest = LONGEST_SHARE * shortest
    if longest <= 4 * block_s:
        return np.zeros(0)
    lags = np.geomspace(block_s, longest, LAGS)
    return np.concatenate([-lags[::-1], lags])


def columns(knots: Knots, tau_s: float, order: int) -> np.ndarray:
    """(K, L + order): a zero for each log, then the powers of the temperature."""
    return np.column_stack([knots.offsets(), knots.powers(tau_s, order)])


def misfit(y: np.ndarray, A: np.ndarray) -> float:
    """Sum of squares that whitened columns leave of whitened knots."""
    return float(np.sum((y - A @ np.linalg.lstsq(A, y, rcond=None)[0]) ** 2))


def best_lag(knots: Knots, y: np.ndarray, L: np.ndarray, rows: np.ndarray | slice, lags: np.ndarray, order: int) -> float:
    """The lag that leaves least, first of a grid, then between its neighbours; y (K,), L the noise's factor of ``rows``."""
    white = whiten(L, y[rows])

    def left(tau: float) -> float:
        return misfit(white, whiten(L, columns(knots, float(tau), order)[rows]))

    k = int(np.argmin([left(tau) for tau in lags.tolist()]))
    between = float(lags[max(k - 1, 0)]), float(lags[min(k + 1, len(lags) - 1)])
    return float(minimize_scalar(left, bounds=between, method="bounded", options={"xatol": 1e-3 * abs(float(lags[k]))}).x)


def examine(knots: Knots, y: np.ndarray, noise: Coloured, orders: tuple[int, ...], lags: np.ndarray) -> Examined:
    """Predict each fold of knots y (K,) by each candidate fitted to the others."""
    folds, by = folds_of(knots)
    candidates = tuple(Candidate(p, lagged) for lagged in (False, *([True] if len(lags) else [])) for p in orders if p or not lagged)
    most = max(orders)
    table = []
    for fold in np.unique(folds):
        train, test = folds != fold, folds == fold
        L = noise.factor(train)
        tau = best_lag(knots, y, L, train, lags, most) if len(lags) else 0.0
        table.append([_predicted(knots, y, train, test, c.order, tau if c.lagged else 0.0) for c in candidates])
    held_out = np.array(table)
    return Examined(candidates, held_out, _simplest(candidates, held_out), by)


def _predicted(knots: Knots, y: np.ndarray, train: np.ndarray, test: np.ndarray, order: int, tau: float) -> float:
    """Mean square of what a fold's knots differ from the prediction, in the unit of y."""
    A = columns(knots, tau, order)
    seen = A[train].any(axis=0)
    coefficients = np.zeros(A.shape[1])
    coefficients[seen] = np.linalg.lstsq(A[train][:, seen], y[train], rcond=None)[0]
    error = y[test] - A[test] @ coefficients
    logs = len(knots.logs)
    # A log that was left out whole has a zero of its own, which nothing predicts: how it scatters is said apart.
    if not seen[:logs][np.unique(knots.of[test])].all():
        error = error - error.mean()
    return float(np.mean(error**2))


def _simplest(candidates: tuple[Candidate, ...], held_out: np.ndarray) -> int:
    """Index of the simplest candidate within one standard error of the best."""
    best = int(np.argmin(held_out.mean(axis=0)))
    worse = held_out - held_out[:, [best]]
    error = worse.std(axis=0, ddof=1) / np.sqrt(len(worse)) if len(worse) > 1 else np.zeros(len(candidates))
    within = [i for i in range(len(candidates)) if worse[:, i].mean() <= error[i]]
    return min(within, key=lambda i: (candidates[i].complexity, candidates[i].lagged))
