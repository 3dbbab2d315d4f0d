"""Solve weighted rows: what they determine, with its covariance as a sum of named sources, and what they leave open.

Columns are scaled to length one.  A direction of the parameters along which the scaled prediction changes by less than ``BAR`` of what the
best observed one changes is *not determined*: no finite sigma is of it, nor of any function that it moves.  A pseudo-inverse would give it
variance 0.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from statistics import NormalDist
from typing import Annotated, Literal

import numpy as np

from session.base.records import Key
from session.base.results import Array, Maybe, Number

#: singular value of columns of length one, of the largest, below which a direction is not determined; its square is 10^4 roundings
BAR = 1e-6
#: part of a function's slope that may lie along directions that are not determined: what rounding and difference quotients leave there
TOUCHED = 1e-3


@dataclass(frozen=True, eq=False)
class Solution:
    """Least squares of p numbers.

    shortest (p,) or (p, k): of all solutions the one whose scaled numbers are smallest; it predicts as well as any.  spread (p, p): the
    covariance over the directions that are determined, for rows of variance one.  open (p, p - rank): changes of the numbers, of length one
    when scaled, that no row sees; size (p,): length of the columns.
    """

    shortest: np.ndarray
    spread: np.ndarray
    open: np.ndarray
    size: np.ndarray

    @property
    def rank(self) -> int:
        """How many directions are determined."""
        return len(self.size) - self.open.shape[1]

    @property
    def is_open(self) -> np.ndarray:
        """(p,) bool: numbers that are not determined."""
        found: np.ndarray = np.linalg.norm(self.open * self.size[:, None], axis=1) > TOUCHED
        return found

    @property
    def value(self) -> np.ndarray:
        """The numbers, NaN where they are not determined."""
        found = self.shortest.copy()
        found[self.is_open] = np.nan
        return found

    @property
    def covariance(self) -> np.ndarray:
        """(p, p) for rows of variance one; of numbers that are not determined the variance is infinite, the covariances NaN."""
        return _marked(self.spread, self.is_open)

    def variance(self, slope: np.ndarray) -> float:
        """Of a function of the numbers with slopes (p,), for rows of variance one; infinite where a direction that is not determined moves
        it."""
        moved = np.linalg.norm(slope @ self.open) if self.open.size else 0.0
        if moved > TOUCHED * np.linalg.norm(slope / self.size):
            return float("inf")
        return float(max(slope @ self.spread @ slope, 0.0))


def solve(design: np.ndarray, values: np.ndarray | None = None) -> Solution:
    """Least squares of values (n,) or (n, k) by columns (n, p), both divided by the rows' sigmas; without values the spread alone.

    A column of zeros is not determined.
    """
    size = np.linalg.norm(design, axis=0)
    size[size == 0] = 1.0
    left, strength, right = np.linalg.svd(design / size, full_matrices=False)
    kept = strength > BAR * strength.max(initial=0.0)
    seen = right[kept].T / strength[kept]
    found = seen @ (left.T[kept] @ (np.zeros(len(design)) if values is None else values))
    # Where rows are fewer than numbers, the directions beyond them are those across all that are seen.
    across = np.linalg.svd(right[kept], full_matrices=True)[2][kept.sum() :].T if kept.sum() < len(size) else np.zeros((len(size), 0))
    whole = size.reshape(-1, *[1] * (found.ndim - 1))
    return Solution(found / whole, seen @ seen.T / np.outer(size, size), across / size[:, None], size)


def inverse(information: np.ndarray) -> np.ndarray:
    """Covariance (…, p, p) of an information; of numbers that are not determined the variance is infinite, the covariances NaN."""
    each = np.diagonal(information, axis1=-2, axis2=-1)
    size = np.sqrt(np.where(each > 0, each, 1.0))
    both = size[..., :, None] * size[..., None, :]
    strength, axes = np.linalg.eigh((information + np.swapaxes(information, -2, -1)) / 2 / both)
    kept = strength > BAR**2 * strength.max(axis=-1, initial=0.0, keepdims=True)
    spread = np.einsum("...ij,...j,...kj->...ik", axes, np.where(kept, 1 / np.where(kept, strength, 1.0), 0.0), axes)
    return _marked(spread / both, np.sqrt(np.sum(axes**2 * ~kept[..., None, :], axis=-1)) > TOUCHED)


def _marked(spread: np.ndarray, is_open: np.ndarray) -> np.ndarray:
    found = np.where(is_open[..., :, None] | is_open[..., None, :], np.nan, spread)
    every = np.arange(found.shape[-1])
    found[..., every, every] = np.where(is_open, np.inf, spread[..., every, every])
    return found


def root(covariance: np.ndarray) -> np.ndarray:
    """(P, P) symmetric R, R R = covariance, of the nearest one without eigenvalues below zero: columns of one sigma each."""
    size, axes = np.linalg.eigh((covariance + covariance.T) / 2)
    return np.asarray(axes * np.sqrt(np.maximum(size, 0.0)) @ axes.T)


def unit_columns(columns: np.ndarray) -> np.ndarray:
    """Those of the columns (n, P) that are not zero, each of length one."""
    size = np.linalg.norm(columns, axis=0)
    return columns[:, size > 0] / size[size > 0]


# Lower triangular systems in NumPy: importing ``scipy.linalg`` takes longer than a fit.

#: largest system that is solved directly; larger ones are split into halves joined by a matrix product
COLUMNS_AT_ONCE = 48


def solve_lower(factor: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve ``factor @ x = right`` for x: factor (..., n, n) lower triangular; right (..., n, m), or (n,) of a single system."""
    if right.ndim == 1:
        return solve_lower(factor, right[:, None])[:, 0]
    count = factor.shape[-1]
    if count <= COLUMNS_AT_ONCE:
        # Reversed it is upper triangular, so elimination has nothing to do and ``solve`` only substitutes.
        return np.linalg.solve(factor[..., ::-1, ::-1], right[..., ::-1, :])[..., ::-1, :]
    half = count // 2
    first = solve_lower(factor[..., :half, :half], right[..., :half, :])
    last = solve_lower(factor[..., half:, half:], right[..., half:, :] - factor[..., half:, :half] @ first)
    return np.concatenate([first, last], axis=-2)


def inverse_lower(factor: np.ndarray) -> np.ndarray:
    """Inverse (n, n) of a lower triangular factor (n, n), at half the work of ``solve_lower`` on a unit matrix."""
    count = len(factor)
    if count <= COLUMNS_AT_ONCE:
        return solve_lower(factor, np.eye(count))
    half, inverse = count // 2, np.zeros_like(factor)
    first = inverse[:half, :half] = inverse_lower(factor[:half, :half])
    last = inverse[half:, half:] = inverse_lower(factor[half:, half:])
    inverse[half:, :half] = -last @ (factor[half:, :half] @ first)
    return inverse


# Bases of columns, after what is fitted in any case has been projected out.

#: a direction of which less than this is left by the nuisance columns is unobservable: 0.01 %, less than columns are linear to
UNSEEN = 1e-4


def orthonormal(columns: np.ndarray, unseen: float = 1e-9, scaled: bool = True) -> np.ndarray:
    """Orthonormal basis (n, r) of columns (n, P): directions with a singular value above ``unseen``, of columns of unit length if
    scaled."""
    u, s, _ = np.linalg.svd(unit_columns(columns) if scaled else columns, full_matrices=False)
    return u[:, s > unseen]


def left_of(q: np.ndarray, columns: np.ndarray, unseen: float = UNSEEN, seen: float | None = None) -> np.ndarray:
    """Orthonormal basis of the columns after projecting out q: directions of which more than ``unseen`` is left; or, of whitened columns
    of a plausible change each, those that are more than ``seen`` sigmas."""
    columns = unit_columns(columns) if seen is None else columns
    return orthonormal(columns - q @ (q.T @ columns), unseen if seen is None else seen, scaled=False)


# A covariance as the sum of named sources, with the degrees of freedom of each size, and the coverage factor of their sum.
#
#     u^2 = sum u_i^2          nu_eff = u^4 / sum (u_i^4 / nu_i)          U = k u,  k = t_p(nu_eff)
#
# (GUM, JCGM 100:2008, 5.1.2 and annex G.4, Welch–Satterthwaite.)  The sources' errors are independent of each other.

#: probability that an expanded uncertainty covers
COVERAGE = 0.95


#: evaluated from the scatter of this recording's data, or from anything else (GUM 2.3.2, 2.3.3)
Kind = Literal["A", "B"]


@dataclass(frozen=True, eq=False)
class Source:
    """One source of variance of P parameters.

    name: what it is, in words; kind; freedom: degrees of freedom of its size, infinite where that is taken as known; covariance (P, P), in
    the parameters' units.
    """

    written = ("name", "kind", "freedom", "variances")
    name: Annotated[str, Key("source")]
    kind: Annotated[Kind, Key("type")]
    freedom: Annotated[float, Maybe(Number(0)), Key("degrees_of_freedom")]
    covariance: np.ndarray

    def variance(self, slope: np.ndarray) -> np.ndarray:
        """(Q,) of quantities with this derivative (Q, P) by the parameters."""
        return np.einsum("qi,ij,qj->q", slope, self.covariance, slope)

    @property
    def variances(self) -> Annotated[np.ndarray, Array((None,)), Key("variance")]:
        """(P,)."""
        return np.diag(self.covariance)

    def through(self, response: np.ndarray) -> Source:
        """The source of what responds (Q, P) to its errors."""
        return replace(self, covariance=response @ self.covariance @ response.T)

    def of(self, part: slice) -> Source:
        """The source of some of the parameters."""
        return replace(self, covariance=self.covariance[part, part])


def freedom_of(size: float, sigma: float) -> float:
    """Degrees of freedom, 1 or more, of a variance whose root is known as ``size`` with a sigma: (size / sigma)^2 / 2 (GUM G.4.2)."""
    return float("inf") if sigma == 0 else float(np.maximum(1.0, (size / sigma) ** 2 / 2))


def total(sources: Iterable[Source]) -> np.ndarray:
    """(P, P): sum of their covariances, in their order."""
    first, *others = (source.covariance for source in sources)
    found = np.array(first, dtype=float)
    for each in others:
        found = found + each
    return found


def known_sources(sources: Sequence[Source], covariance: np.ndarray) -> tuple[Source, ...]:
    """The sources of a covariance (P, P); where they are not separated, one of them all whose size is taken as known."""
    matching = sources and sources[0].covariance.shape == covariance.shape and np.allclose(total(sources), covariance, rtol=1e-6, atol=0)
    return tuple(sources) if matching else (Source("all together", "A", float("inf"), covariance),)


def effective_freedom(variances: Sequence[float], freedoms: Sequence[float]) -> float:
    """Degrees of freedom of a sum of independent variances (Welch–Satterthwaite, GUM G.2b); infinite where all of them are known."""
    v, nu = np.asarray(variances, dtype=float), np.asarray(freedoms, dtype=float)
    spread = float(np.sum(np.where(np.isfinite(nu), v**2 / np.where(np.isfinite(nu), nu, 1.0), 0.0)))
    return float(np.sum(v)) ** 2 / spread if spread > 0 else float("inf")


def coverage_factor(freedom: float, probability: float = COVERAGE) -> float:
    """k of an expanded uncertainty with this probability, two-sided; the effective degrees of freedom are cut to a whole number (GUM
    G.4.1)."""
    upper = (1 + probability) / 2
    if freedom == np.inf:
        return NormalDist().inv_cdf(upper)
    from scipy.special import stdtrit  # late: only a certificate and a budget ask for it

    return float(stdtrit(max(1.0, np.floor(freedom)), upper))
