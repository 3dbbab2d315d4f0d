"""Estimate variance components: restricted maximum likelihood (Patterson & Thompson 1971), with what is known beforehand as a prior.

    -2 log L(s) = log|C| + log|J' C^-1 J + D^-1| + r' P r + prior,      C = C_0 + sum s_k^2 V_k,

r the residuals, J the columns of all that is fitted, D their prior.  In a long session C is taken block by block of neighbouring turns:
what is correlated over more than a block says little of the components and costs the cube of the session.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from tinygc.closure.triangular import inverse_lower, solve_lower
from tinygc.explanation.noise.sparse import Sparse

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

#: steps of the search; it begins where the last one ended
STEPS = 12
#: blocks in which sizes are searched for, spread over a long session; the likelihood is that of all (benchmarks/explain_speed.py)
SEARCHED = 3
#: of a component's usual size, as a variance: below, it is not there
NOTHING = 1e-4


class Prior(NamedTuple):
    """What is known of a size s beforehand: its median, and how far it may be from it, ln; upwards, if that is another."""

    median: float
    spread: float
    spread_above: float | None = None

    def apart(self, s: float) -> tuple[float, float]:
        """ln(s / median) in spreads, and the spread on its side."""
        off = float(np.log(s / self.median))
        spread = self.spread if self.spread_above is None or off < 0 else self.spread_above
        return off / spread, spread


@dataclass(frozen=True, eq=False)
class Estimate:
    """s (K,) SI of each component, sigma (K,) of it, and value: -2 log of the restricted likelihood with the prior, less a constant."""

    s: np.ndarray
    sigma: np.ndarray
    value: float


def estimate(
    r: np.ndarray,
    J: np.ndarray,
    base: np.ndarray,
    V: list[np.ndarray | Sparse],
    usual: np.ndarray,
    priors: list[Prior | None],
    blocks: list[np.ndarray],
    start: np.ndarray | None = None,
    with_sigma: bool = False,
    steps: int = STEPS,
) -> Estimate:
    """Of residuals r (n,), columns J (n, p) scaled by their priors' sigmas, base covariance (n, n) and V, K of (n, n); usual (K,).

    blocks: row numbers of each block.  start: s (K,) of an earlier search.
    """
    parts = [(r[b], J[b], base[np.ix_(b, b)], [_block(v, b) * u**2 for v, u in zip(V, usual, strict=True)]) for b in blocks]
    begin = np.full(len(V), 0.5) if start is None else np.maximum((start / usual) ** 2, 0.05)

    searched = [parts[i] for i in np.linspace(0, len(parts) - 1, min(len(parts), SEARCHED)).round().astype(int)]

    def cost(x: np.ndarray, of: list = searched, slope: bool = True) -> tuple[float, np.ndarray]:
        value, gradient = _cost(x, of, J.shape[1], slope)
        for k, prior in enumerate(priors):
            if prior is None:
                continue
            least = max(float(x[k]), 1e-12)
            apart, spread = prior.apart(float(np.sqrt(least) * usual[k]))
            value += apart**2
            gradient[k] += apart / spread / least
        return value, gradient

    def cost_of_root(root: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = cost(root**2)
        return value, gradient * 2 * root

    least = np.array([0.0 if prior is None else 1e-6 for prior in priors])
    # A component of twenty times its usual size is twenty steps away, as a variance four hundred; but at zero a root's slope is none, and
    # only the variance's says whether the component is there.
    near = _lowest(cost_of_root, np.sqrt(begin), np.sqrt(least), steps).x ** 2
    found = _lowest(cost, near, least, steps)
    x = np.where(found.x < NOTHING, 0.0, found.x)
    s = np.sqrt(x) * usual
    value = float(found.fun) if len(searched) == len(parts) else cost(found.x, parts, False)[0]
    return Estimate(s, _sigma(cost, found.x) * usual if with_sigma else np.full(len(s), np.nan), value)


def _block(V: np.ndarray | Sparse, rows: np.ndarray) -> np.ndarray:
    return V.block(rows) if isinstance(V, Sparse) else V[np.ix_(rows, rows)]


def _lowest(cost: Callable, begin: np.ndarray, least: np.ndarray, steps: int) -> OptimizeResult:
    from scipy.optimize import minimize

    bounds = [(float(low), None) for low in least]
    return minimize(cost, begin, jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": steps, "ftol": 1e-6})


def _cost(x: np.ndarray, parts: list, p: int, slope: bool) -> tuple[float, np.ndarray]:
    information, pull, value = np.eye(p), np.zeros(p), 0.0
    kept = []
    for r, J, base, V in parts:
        factor = np.linalg.cholesky(base + sum(v * xk for v, xk in zip(V, x, strict=True)))
        white = solve_lower(factor, np.column_stack([J, r]))
        information += white[:, :p].T @ white[:, :p]
        pull += white[:, :p].T @ white[:, p]
        value += 2 * float(np.sum(np.log(np.diag(factor)))) + float(white[:, p] @ white[:, p])
        kept.append((factor, white))
    root = np.linalg.cholesky(information)
    beta = np.linalg.solve(information, pull)
    value += 2 * float(np.sum(np.log(np.diag(root)))) - float(pull @ beta)
    gradient = np.zeros(len(x))
    if not slope:
        return value, gradient
    for (_, _, _, V), (factor, white) in zip(parts, kept, strict=True):
        inverse = inverse_lower(factor)
        taken = solve_lower(root, white[:, :p].T @ inverse)  # (p, n): P = C^-1 less what the columns take up
        P = inverse.T @ inverse - taken.T @ taken
        y = inverse.T @ (white[:, p] - white[:, :p] @ beta)
        for k, v in enumerate(V):
            gradient[k] += float(np.sum(P * v)) - float(y @ v @ y)
    return value, gradient


def _sigma(cost: object, x: np.ndarray) -> np.ndarray:
    """(K,) of the square root of x, from the curvature of all together; of one at zero, the size at which the likelihood has lost a
    sigma."""
    assert callable(cost)
    here, steps = cost(x)[1], np.maximum(0.3 * x, 0.02)
    curvature = np.array([(cost(x + step * unit)[1] - here) / step for step, unit in zip(steps, np.eye(len(x)), strict=True)])
    curvature = (curvature + curvature.T) / 2
    sigma = np.full(len(x), np.inf)
    there = np.flatnonzero((x > NOTHING) & (np.diag(curvature) > 0))
    # Each is less well known beside the others than if they were known.
    variance = 2 * np.diag(np.linalg.pinv(curvature[np.ix_(there, there)], hermitian=True))
    alone = 2 / np.diag(curvature)[there]
    sigma[there] = np.sqrt(np.maximum(variance, alone)) / (2 * np.sqrt(x[there]))
    for k in np.flatnonzero((x <= NOTHING) & (np.diag(curvature) > 0)):
        slope, bend = max(here[k], 0.0), curvature[k, k]
        # slope x + bend x^2 / 2 = 1
        sigma[k] = np.sqrt((np.sqrt(slope**2 + 2 * bend) - slope) / bend)
    return sigma
