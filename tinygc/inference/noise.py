"""Noise: the covariances of its components for size one, and their sizes by restricted maximum likelihood.

    -2 log L(s) = log|C| + log|J' C^-1 J + D^-1| + r' C^-1 (r - J b) + prior,      C = C_0 + sum s_k^2 V_k

(Patterson & Thompson 1971), with r the residuals, J the columns of all fitted parameters, D their prior, b its optimum.  In a long session
C is split into blocks of neighbouring turns: correlations beyond a block add little information, and the cost of the full matrix grows as
the cube of the session.

``lowest`` is the one search; where a covariance has a structure that makes the same likelihood cheaper, the caller gives its cost, and a
test holds it to ``estimate``.  One estimate is of another kind: the bias instability of stills has innovations with outliers, and the
posterior mean over a grid in place of a maximum (``closure.floor``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tinygc.inference.solve import inverse, inverse_lower, solve_lower

# Covariances of noise of size one.

#: correlation times of the octaves, s: from a still to a working hour
TIMES_S = 2.0 ** np.arange(-1, 12)


#: rows that are computed at once: intermediate results stay in the processor's cache
ROWS_TOGETHER = 128


def wander_covariance(t_s: np.ndarray, span_s: np.ndarray | float = 0.0, *, instability_rps: float) -> np.ndarray:
    """(N, N) (rad/s)^2 covariance of one axis' bias at moments t_s (N,), each averaged over span_s (N,) around it.

    Exact: the covariance exp(-|t - s| / time) of each octave, integrated over both spans.
    """
    octave = instability_rps**2 * np.log(2) / np.pi
    span = np.broadcast_to(np.asarray(span_s, dtype=float), t_s.shape)
    total = np.zeros((len(t_s), len(t_s)))
    for first in range(0, len(t_s), ROWS_TOGETHER):
        some = slice(first, first + ROWS_TOGETHER)  # with all moments up to them: the rest is symmetric
        other = slice(0, some.stop)
        gap = np.abs(t_s[some, None] - t_s[other]) - (span[some, None] + span[other]) / 2
        row, column = np.nonzero(gap < 0)
        decay, found = np.exp(-np.maximum(gap, 0.0) / TIMES_S[-1]), total[some, other]
        for time in TIMES_S[::-1]:
            x = span / time
            ends = np.where(x > 0, -np.expm1(-x) / np.where(x > 0, x, 1.0), 1.0)
            part = decay * ends[other]
            part *= ends[some, None]
            part[row, column] = _over_both(t_s / time, x, row + first, column)
            found += part
            decay *= decay  # of half the time
        total[:first, some] = found[:, :first].T
    total *= octave
    return total


def _over_both(t: np.ndarray, span: np.ndarray, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Mean of exp(-|t - s|) over the spans i and j, which overlap; t and span in correlation times."""
    span = np.where(span > 0, span, 1e-4)  # a moment within another's span: exact to 1e-9

    def twice_integrated(u: np.ndarray) -> np.ndarray:
        return np.expm1(-np.abs(u)) + np.abs(u)

    apart, half, other = t[i] - t[j], span[i] / 2, span[j] / 2
    outer = twice_integrated(apart + half + other) + twice_integrated(apart - half - other)
    return (outer - twice_integrated(apart - half + other) - twice_integrated(apart + half - other)) / (span[i] * span[j])


@dataclass(frozen=True, eq=False)
class Sparse:
    """Sparse matrix (n, n): ``values`` (m,) at ``rows`` and ``columns`` (m,), each position once; zero elsewhere."""

    size: int
    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray

    @classmethod
    def of(cls, dense: np.ndarray) -> Sparse:
        """Convert a dense matrix (n, n)."""
        rows, columns = np.nonzero(dense)
        return cls(len(dense), rows, columns, dense[rows, columns])

    @classmethod
    def of_diagonal(cls, diagonal: np.ndarray) -> Sparse:
        """Build a diagonal matrix from its diagonal (n,)."""
        at = np.flatnonzero(diagonal)
        return cls(len(diagonal), at, at, diagonal[at])

    def block(self, of: np.ndarray) -> np.ndarray:
        """Dense block (k, k) of the rows and columns with these numbers (k,)."""
        place = np.full(self.size, -1)
        place[of] = np.arange(len(of))
        row, column = place[self.rows], place[self.columns]
        inside = (row >= 0) & (column >= 0)
        dense = np.zeros((len(of), len(of)))
        dense[row[inside], column[inside]] = self.values[inside]
        return dense

    def add_to(self, total: np.ndarray, times: float = 1.0) -> None:
        """Add so many times itself to a dense matrix (n, n), in place."""
        total[self.rows, self.columns] += times * self.values

    def dense(self) -> np.ndarray:
        """Convert to a dense matrix (n, n)."""
        return self.block(np.arange(self.size))


@dataclass(frozen=True, eq=False)
class Striped:
    """Symmetric matrix (n, n) of which no more is kept than the lower half of its first m rows, the others being zero: stripes of rows
    (k, …), each up to its last column."""

    size: int
    stripes: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, dense: np.ndarray, size: int) -> Striped:
        """Keep the lower half of a symmetric matrix (m, m), as the first rows of a larger one."""
        edges = [*range(0, len(dense), ROWS_TOGETHER), len(dense)]
        return cls(size, tuple(dense[start:stop, :stop].copy() for start, stop in pairwise(edges)))

    def block(self, of: np.ndarray) -> np.ndarray:
        """Dense block (k, k) of the rows and columns with these numbers (k,)."""
        found = np.zeros((len(of), len(of)))
        for stripe in self.stripes:
            stop = stripe.shape[1]
            start = stop - len(stripe)
            own, left = np.flatnonzero((of >= start) & (of < stop)), np.flatnonzero(of < stop)
            part = stripe[np.ix_(of[own] - start, of[left])]
            found[np.ix_(own, left)] = part
            found[np.ix_(left, own)] = part.T
        return found

    def add_to(self, total: np.ndarray, times: float = 1.0) -> None:
        """Add so many times itself to a dense matrix (n, n), in place."""
        for stripe in self.stripes:
            stop = stripe.shape[1]
            start = stop - len(stripe)
            total[start:stop, :stop] += times * stripe
            total[:start, start:stop] += times * stripe[:, :start].T

    def dense(self) -> np.ndarray:
        """Convert to a dense matrix (n, n)."""
        total = np.zeros((self.size, self.size))
        self.add_to(total)
        return total


#: a covariance of size one
Unit = np.ndarray | Sparse | Striped


@dataclass(frozen=True, eq=False)
class Banded:
    """Covariance (n, n) that is sparse but for m directions (n, m) in which it is wide: of many rows, a fraction of the dense one."""

    sparse: Sparse
    along: np.ndarray

    def block(self, of: np.ndarray) -> np.ndarray:
        """Dense block (k, k) of the rows and columns with these numbers (k,)."""
        return self.sparse.block(of) + self.along[of] @ self.along[of].T

    def add_to(self, total: np.ndarray) -> None:
        """Add it to a dense matrix (n, n), in place."""
        self.sparse.add_to(total)
        for first in range(0, len(total), ROWS_TOGETHER):
            total[first : first + ROWS_TOGETHER] += self.along[first : first + ROWS_TOGETHER] @ self.along.T

    def dense(self) -> np.ndarray:
        """Convert to a dense matrix (n, n)."""
        total = np.zeros((self.sparse.size, self.sparse.size))
        self.add_to(total)
        return total


# The sizes of components, by restricted maximum likelihood.

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
#: first size, of a component's usual one, that is tried for the sigma of one that is absent; times the step beyond is doubled at most
FIRST_SIZE, WIDENED = 0.5, 8
#: step of the curvature's differences, relative to a variance: small against its relative sigma, large against rounding
CURVED = 1e-3


#: of a block: residuals (n,), columns (n, p), base covariance (n, n), and that of each component
Part = tuple[np.ndarray, np.ndarray, np.ndarray, list[np.ndarray]]


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
    base: np.ndarray | Banded,
    V: list[Unit],
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
    parts = [(r[b], J[b], block_of(base, b), [block_of(v, b) * u**2 for v, u in zip(V, usual, strict=True)]) for b in blocks]
    return estimate_parts(parts, usual, priors, start, with_sigma, steps)


def estimate_parts(
    parts: list[Part],
    usual: np.ndarray,
    priors: list[Prior | None],
    start: np.ndarray | None = None,
    with_sigma: bool = False,
    steps: int = SCORING_STEPS,
    most_searched: int = SEARCHED,
) -> ComponentEstimate:
    """``estimate`` from the parts of each block, V in units of the usual variances; the search is over ``most_searched`` of the blocks."""
    begin = np.full(len(usual), 0.5) if start is None else np.maximum((start / usual) ** 2, 0.05)
    searched = [parts[i] for i in np.linspace(0, len(parts) - 1, min(len(parts), most_searched)).round().astype(int)]

    def cost(x: np.ndarray, of: list = searched, slope: bool = True) -> Cost:
        value, gradient, information = _cost(x, of, parts[0][1].shape[1], slope)
        for k, prior in enumerate(priors):
            if prior is None:
                continue
            apart, spread = prior.apart(float(np.sqrt(x[k]) * usual[k]))
            value += apart**2
            gradient[k] += apart / spread / x[k]
            information[k, k] += (1 / (2 * spread) + max(-apart, 0.0)) / spread / x[k] ** 2
        return Cost(value, gradient, information)

    least = np.array([0.0 if prior is None else 1e-6 for prior in priors])
    x, found = lowest(cost, np.maximum(begin, least), least, steps=steps)
    s = np.sqrt(np.where(x < NOTHING, 0.0, x)) * usual
    value = found.value if len(searched) == len(parts) else cost(x, parts, False).value
    return ComponentEstimate(s, _sigma(cost, x) * usual if with_sigma else np.full(len(s), np.nan), value)


def block_of(V: Unit | Banded, rows: np.ndarray) -> np.ndarray:
    """Rows and columns ``rows`` (m,) of a matrix: (m, m)."""
    return V[np.ix_(rows, rows)] if isinstance(V, np.ndarray) else V.block(rows)


def lowest(
    cost: Callable[[np.ndarray], Cost],
    x: np.ndarray,
    least: np.ndarray | float = 0.0,
    most: np.ndarray | float = np.inf,
    steps: int = SCORING_STEPS,
    farthest: float = np.inf,
    settled: float = SETTLED,
) -> tuple[np.ndarray, Cost]:
    """Numbers x (K,) of the lowest cost found from a start, each between ``least`` and ``most``, moved by ``farthest`` in a step at most; a
    step that lowers the cost by less than ``settled`` is the last.

    Scoring by the average of expected and observed information (Gilmour, Thompson & Cullis 1995), damped where a step does not lower the
    cost.  The numbers are variances, their logarithms, or whatever else ``cost`` takes.
    """
    found, damp = cost(x), 0.0
    for _ in range(steps):
        free = ((x > least) | (found.gradient < 0)) & ((x < most) | (found.gradient > 0)) & (np.diag(found.information) > 0)
        information = found.information[np.ix_(free, free)]
        tried = x.copy()
        step = np.linalg.solve(information + (damp + ALIKE) * np.diag(np.diag(information)), found.gradient[free])
        tried[free] -= np.clip(step, -farthest, farthest)
        tried = np.clip(tried, least, most)
        there = cost(tried)
        if not there.value < found.value:  # or where it is no number
            if found.value - there.value > -settled:
                break
            damp = max(10 * damp, 0.1)
            continue
        drop, damp = found.value - there.value, damp / 10
        x, found = tried, there
        if drop < settled:
            break
    return x, found


def _cost(x: np.ndarray, parts: list, p: int, slope: bool) -> tuple[float, np.ndarray, np.ndarray]:
    """``Cost`` without the prior; its information leaves out what blocks share."""
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
    least = cost(x).value

    def rise(own: np.ndarray, size: float) -> float:
        return float(cost(x + size**2 * own).value) - least

    for k in np.flatnonzero(x <= NOTHING):
        sigma[k] = where_risen(partial(rise, np.arange(len(x)) == k), 0.0, FIRST_SIZE, 1.0)
    return sigma


def where_risen(rise: Callable[[float], float], low: float, step: float, by: float, near: float = 1e-3) -> float:
    """Size above ``low``, where -2 log L is least, at which it has risen ``by`` so much, to this share of the size; infinite where it does
    not.

    rise: by how much it has risen at a size, all else estimated again or held, as the caller has it; step: the first size tried beyond low.
    """
    begin, high = low, low + step
    under, over = -by, rise(high) - by
    for _ in range(WIDENED):
        if over >= 0:
            break
        low, under, high = high, over, high + 2 * (high - low)
        over = rise(high) - by
    if over < 0:
        return float("inf")
    for _ in range(SCORING_STEPS):  # regula falsi in squares, in which a rise is nearly linear, an end that stays counting half
        square = ((low - begin) ** 2 * over - (high - begin) ** 2 * under) / (over - under)
        middle = begin + float(np.sqrt(square))
        at = rise(middle) - by
        if abs(at) <= 2 * near * by:
            break
        if at >= 0:
            high, over, under = middle, at, under / 2
        else:
            low, under, over = middle, at, over / 2
    return float(middle)
