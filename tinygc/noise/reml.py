"""Variance components by restricted maximum likelihood (Patterson & Thompson 1971), with priors on their sizes.

    -2 log L(s) = log|C| + log|J' C^-1 J + D^-1| + r' P r + prior,      C = C_0 + sum s_k^2 V_k,

with r the residuals, J the columns of all fitted parameters, D their prior.  In a long session C is split into blocks of neighbouring
turns: correlations beyond a block add little information, and the cost of the full matrix grows as the cube of the session.

Explain, fit and the temperature feature call ``estimate``.  Where a covariance has a structure that makes the same likelihood cheaper, its
feature writes it in that form, and a test holds it to this one (tests/test_noise_physics.py): an array's components are variances of
single rows.  The spreads of many units are one variance each.  One estimate is of another
kind: the bias instability of stills has innovations with outliers, and the posterior mean over a grid in place of a maximum
(``closure.floor``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from session.base.solving import inverse
from tinygc.closure.least_squares import inverse_lower, solve_lower
from tinygc.noise.whitening import Sparse

#: greatest number of steps of a search
SCORING_STEPS = 24
#: drop of -2 log L below which a search ends; a tenth of a sigma away, it is 0.01
SETTLED = 1e-6
#: share of its own information that is added to each component's: components that are alike take a step together
ALIKE = 1e-9
#: number of blocks, spread over a long session, used in the search; the likelihood uses all (benchmarks/whole_process.py)
SEARCHED = 3
#: variance relative to a component's usual one, below which the component is absent
NOTHING = 1e-4
#: step of the curvature's differences, relative to a variance: small against its relative sigma, large against rounding
CURVED = 1e-3


class Prior(NamedTuple):
    """Lognormal prior of a size s: its median and its spread (ln); a separate spread upwards, if it differs."""

    median: float
    spread: float
    spread_above: float | None = None

    def apart(self, s: float) -> tuple[float, float]:
        """ln(s / median) in units of the spread, and the spread on that side."""
        off = float(np.log(s / self.median))
        spread = self.spread if self.spread_above is None or off < 0 else self.spread_above
        return off / spread, spread


class Cost(NamedTuple):
    """-2 log of the restricted likelihood with the prior, its gradient (K,) by the variances, and the average information (K, K)."""

    value: float
    gradient: np.ndarray
    information: np.ndarray


@dataclass(frozen=True, eq=False)
class ComponentEstimate:
    """Sizes s (K,) of the components, SI; their sigma (K,); value: -2 log of the restricted likelihood with the prior, up to a constant."""

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
    steps: int = SCORING_STEPS,
) -> ComponentEstimate:
    """Estimate the sizes from residuals r (n,), columns J (n, p) scaled by their priors' sigmas, base covariance (n, n) and V.

    V: K matrices (n, n); usual (K,): usual sizes.  blocks: row numbers of each block.  start: s (K,) of an earlier search.
    """
    parts = [(r[b], J[b], base[np.ix_(b, b)], [_block(v, b) * u**2 for v, u in zip(V, usual, strict=True)]) for b in blocks]
    begin = np.full(len(V), 0.5) if start is None else np.maximum((start / usual) ** 2, 0.05)

    searched = [parts[i] for i in np.linspace(0, len(parts) - 1, min(len(parts), SEARCHED)).round().astype(int)]

    def cost(x: np.ndarray, of: list = searched, slope: bool = True) -> Cost:
        value, gradient, information = _cost(x, of, J.shape[1], slope)
        for k, prior in enumerate(priors):
            if prior is None:
                continue
            apart, spread = prior.apart(float(np.sqrt(x[k]) * usual[k]))
            value += apart**2
            gradient[k] += apart / spread / x[k]
            information[k, k] += (1 / (2 * spread) + max(-apart, 0.0)) / spread / x[k] ** 2
        return Cost(value, gradient, information)

    least = np.array([0.0 if prior is None else 1e-6 for prior in priors])
    lowest, found = _lowest(cost, np.maximum(begin, least), least, steps)
    s = np.sqrt(np.where(lowest < NOTHING, 0.0, lowest)) * usual
    value = found.value if len(searched) == len(parts) else cost(lowest, parts, False).value
    return ComponentEstimate(s, _sigma(cost, lowest) * usual if with_sigma else np.full(len(s), np.nan), value)


def _block(V: np.ndarray | Sparse, rows: np.ndarray) -> np.ndarray:
    return V.block(rows) if isinstance(V, Sparse) else V[np.ix_(rows, rows)]


def _lowest(cost: Callable[[np.ndarray], Cost], x: np.ndarray, least: np.ndarray, steps: int) -> tuple[np.ndarray, Cost]:
    """Variances (K,) of the lowest cost found from x, none below ``least``: scoring by the average of expected and
    observed information (Gilmour, Thompson & Cullis 1995), damped where a step does not lower the cost."""
    found, damp = cost(x), 0.0
    for _ in range(steps):
        free = ((x > least) | (found.gradient < 0)) & (np.diag(found.information) > 0)
        information = found.information[np.ix_(free, free)]
        tried = x.copy()
        tried[free] -= np.linalg.solve(information + (damp + ALIKE) * np.diag(np.diag(information)), found.gradient[free])
        tried = np.maximum(tried, least)
        there = cost(tried)
        if not there.value < found.value:  # or where it is no number
            if found.value - there.value > -SETTLED:
                break
            damp = max(10 * damp, 0.1)
            continue
        drop, damp = found.value - there.value, damp / 10
        x, found = tried, there
        if drop < SETTLED:
            break
    return x, found


def _cost(x: np.ndarray, parts: list, p: int, slope: bool) -> tuple[float, np.ndarray, np.ndarray]:
    """``Cost`` without the prior; its information leaves out what blocks tell together."""
    within, pull, value = np.eye(p), np.zeros(p), 0.0
    kept = []
    for r, J, base, V in parts:
        factor = np.linalg.cholesky(base + sum(v * xk for v, xk in zip(V, x, strict=True)))
        inverse = inverse_lower(factor)
        white = inverse @ np.column_stack([J, r])
        within += white[:, :p].T @ white[:, :p]
        pull += white[:, :p].T @ white[:, p]
        value += 2 * float(np.sum(np.log(np.diag(factor)))) + float(white[:, p] @ white[:, p])
        kept.append((inverse, white))
    root = np.linalg.cholesky(within)
    beta = np.linalg.solve(within, pull)
    value += 2 * float(np.sum(np.log(np.diag(root)))) - float(pull @ beta)
    gradient, information = np.zeros(len(x)), np.zeros((len(x), len(x)))
    if not slope:
        return value, gradient, information
    for (_, _, _, V), (inverse, white) in zip(parts, kept, strict=True):
        taken = solve_lower(root, white[:, :p].T @ inverse)  # (p, n): P = C^-1 less the part absorbed by the columns
        P = inverse.T @ inverse - taken.T @ taken
        y = inverse.T @ (white[:, p] - white[:, :p] @ beta)
        Vy = np.stack([v @ y for v in V], axis=1)
        gradient += [np.vdot(P, v) for v in V] - y @ Vy
        information += Vy.T @ P @ Vy
    return value, gradient, information


def _sigma(cost: Callable, x: np.ndarray) -> np.ndarray:
    """Sigma (K,) of the square root of x, from the joint curvature; at zero, the size at which the likelihood has dropped by one sigma,
    the others as they are."""
    sigma = np.full(len(x), np.inf)
    axes = np.diag(np.maximum(CURVED * x, 0.0))
    curvature = np.array([(cost(x + step).gradient - cost(x - step).gradient) / (2 * step.max() or 1.0) for step in axes])
    there = np.flatnonzero((x > NOTHING) & (np.diag(curvature) > 0))
    joint = curvature[np.ix_(there, there)]
    # The joint sigma of each is at least its sigma with the others known.
    variance = np.maximum(2 * np.diag(inverse(joint)), 2 / np.diag(joint))
    sigma[there] = np.sqrt(variance / x[there]) / 2
    for k in np.flatnonzero(x <= NOTHING):
        sigma[k] = _one_sigma_from_zero(cost, x, int(k))
    return sigma


def _one_sigma_from_zero(cost: Callable[[np.ndarray], Cost], x: np.ndarray, k: int) -> float:
    """Size of component k at which -2 log L has risen by one, to a thousandth; infinite where it does not rise."""
    lowest, other = cost(x).value, np.arange(len(x)) == k

    def risen(size: float) -> tuple[float, float]:
        """By how much more than one, and its slope."""
        there = cost(x + size**2 * other)
        return there.value - lowest - 1, 2 * size * float(there.gradient[k])

    high = next((size for size in 2.0 ** np.arange(-4, 10) if risen(size)[0] > 0), np.inf)
    if not np.isfinite(high):
        return high
    size = high / 2
    for _ in range(SCORING_STEPS):
        over, slope = risen(size)
        step = float(np.clip(size - over / slope, size / 2, high)) - size if slope > 0 else (high - size) / 2
        size += step
        if abs(step) <= 1e-3 * size:
            break
    return size
