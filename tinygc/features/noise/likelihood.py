"""The likelihood of the noise terms, over all scales together.

Contrasts z of windows are Gaussian with covariance C = sum s_k^2 V_k, V_k that of a term of size 1 (``unit_covariance``):

    -2 log L = sum over groups  n log|C| + tr(C^-1 S),    S = sum of z z' over the n windows.

The contrasts of a window do not contain its mean, nor do those of the coarsest vector contain the mean of the rest (restricted likelihood,
Patterson & Thompson 1971).  Windows and levels are taken as independent, which
they are for white noise.  For walks and flicker they are nearly so, like wavelet coefficients; ``dependence`` has what that does to sigmas.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tinygc.features.noise.scales import Group

#: steps of Fisher scoring in ln s^2; change of -2 log L at which it ends
STEPS, ENDS = 40, 1e-4
#: of a size: its logarithm is flat over so many decades; and the variance of ln s^2 over them
DECADES = 3.0
PRIOR_VARIANCE = (2 * DECADES * np.log(10)) ** 2 / 12
#: the trace of the sensor's filter in means that are longer than its memory.  It takes from the ends of a mean what it adds to the next
#: mean, whatever its order: white noise loses like a quantisation of negative variance, N^2 times the filter's time
FILTER = "F"
#: step of ln T for the derivative of the covariance of a Gauss-Markov term
LOG_STEP = 1e-3


def autocovariance(name: str, lag: np.ndarray, mean_s: float, correlation_s: float = 1.0) -> np.ndarray:
    """Return the covariance (n,) of two means of length mean_s, lag (n,) lengths apart, of a term of size 1.

    Of a term that is not stationary it is known up to a constant, which contrasts do not contain.

    Densities as in ``tinygc.noise.figures``; the second difference of the twice integrated covariance over the length.
    """
    h = np.abs(np.asarray(lag, dtype=float))
    if name == "N":
        return np.where(h == 0, 1 / mean_s, 0.0)
    if name in ("Q", FILTER):  # white angle at each sample: a mean is the difference of its ends
        return np.select([h == 0, h == 1], [2 / mean_s**2, -1 / mean_s**2], 0.0) * (1 if name == "Q" else -1)

    def twice(x: np.ndarray) -> np.ndarray:
        x = np.abs(x)
        if name == "B":
            return np.asarray(-(x**2) * (np.log(np.maximum(x, 1e-300)) / 2 - 0.75) / np.pi)
        if name == "K":
            return np.asarray(-mean_s * x**3 / 12)
        time = correlation_s / mean_s
        return np.asarray(time**2 * np.expm1(-x / time) + time * x)

    return twice(h + 1) - 2 * twice(h) + twice(h - 1)


def line_autocovariance(hz: float, lag: np.ndarray, mean_s: float) -> np.ndarray:
    """Return that of a line of rms 1."""
    return np.cos(2 * np.pi * hz * mean_s * np.asarray(lag)) * np.sinc(hz * mean_s) ** 2


def unit_covariance(name: str, groups: Sequence[Group], period_s: float, correlation_s: float = 1.0, hz: float = 0.0) -> list[np.ndarray]:
    """Return the covariance (d, d) of each group's contrasts for a term of size 1.

    A ramp is one slope for a whole rest: all windows have the same part of it, in which they are not independent.  That matters little,
    because the coarsest vector sees it by far the best.
    """
    found = []
    for group in groups:
        mean_s = group.size * period_s
        if name == "R":
            t = group.t() * mean_s
            found.append(np.outer(t, t))
            continue
        lag = np.abs(group.at[:, None] - group.at[None])
        every = np.arange(int(lag.max()) + 1)
        values = line_autocovariance(hz, every, mean_s) if name == "line" else autocovariance(name, every, mean_s, correlation_s)
        found.append(group.basis.T @ values[lag] @ group.basis)
    return found


#: covariances of all groups for one term, by stacks of groups with equally many contrasts: (g, d, d) each
Stacked = list[np.ndarray]


@dataclass(frozen=True, eq=False)
class Stack:
    """Groups with d contrasts each: S (g, d, d); count (g,); which: places of the groups."""

    S: np.ndarray
    count: np.ndarray
    which: list[int]


def stacks_of(groups: Sequence[Group]) -> list[Stack]:
    """Put groups of the same shape together: their small matrices are inverted in one call."""
    width = np.array([len(group.S) for group in groups])
    found = []
    for d in np.unique(width):
        which = np.flatnonzero(width == d).tolist()
        found.append(Stack(np.stack([groups[k].S for k in which]), np.array([groups[k].count for k in which]), which))
    return found


def stacked(V: Sequence[np.ndarray], stacks: Sequence[Stack]) -> Stacked:
    """Stack the covariances of all groups like the groups."""
    return [np.stack([V[k] for k in stack.which]) for stack in stacks]


@dataclass(frozen=True, eq=False)
class Fitted:
    """x (K,): variances s^2; value: -2 log L; information (K + f, K + f): of ln s^2, and of ln T of a Gauss-Markov term last."""

    x: np.ndarray
    value: float
    information: np.ndarray
    correlation_s: float = np.nan

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of ln s^2 (and ln T), from the expected information and the width of the prior."""
        return np.asarray(np.linalg.inv(self.information + np.eye(len(self.information)) / PRIOR_VARIANCE))


def cost(x: np.ndarray, V: Sequence[Stacked], stacks: Sequence[Stack]) -> tuple[float, np.ndarray, np.ndarray]:
    """Return -2 log L of variances x (K,), and its derivatives by each matrix of V (K', …): slope (K',), expected curvature (K', K').

    Matrices beyond the first K count in the derivatives alone.  Infinite where C is not positive.
    """
    terms = len(V)
    value, slope, curvature = 0.0, np.zeros(terms), np.zeros((terms, terms))
    for s, stack in enumerate(stacks):
        every = np.stack([own[s] for own in V])
        C = np.tensordot(x, every[: len(x)], axes=1)
        try:
            factor = np.linalg.cholesky(C)
        except np.linalg.LinAlgError:
            return np.inf, slope, curvature
        inverse = np.linalg.inv(factor)
        inverse = np.swapaxes(inverse, 1, 2) @ inverse
        A = inverse @ every
        seen = inverse @ stack.S
        log_size = 2 * np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
        value += float(stack.count @ log_size + np.trace(seen, axis1=1, axis2=2).sum())
        turned = np.ascontiguousarray(np.swapaxes(A, 2, 3)).reshape(terms, -1)
        slope += np.trace(A, axis1=2, axis2=3) @ stack.count - turned @ seen.ravel()
        curvature += (A * stack.count[:, None, None]).reshape(terms, -1) @ turned.T
    return value, slope, curvature


def fit(names: Sequence[str], V: dict[str, Stacked], stacks: Sequence[Stack], start: np.ndarray) -> Fitted:
    """Maximise the likelihood over the variances (K,) of terms by Fisher scoring in their logarithms."""
    own = [V[name] for name in names]
    return _scored(np.log(start), lambda z: own, stacks)


def fit_with_time(
    names: Sequence[str],
    V: dict[str, Stacked],
    stacks: Sequence[Stack],
    start: np.ndarray,
    correlation_s: float,
    bounds_s: tuple[float, float],
    unit: Callable[[str, float], Stacked],
) -> Fitted:
    """Maximise it also over the correlation time of a Gauss-Markov term, the last of ``names``; start (K,): variances; unit: returns its
    covariances for a time."""

    def matrices(z: np.ndarray) -> list[Stacked]:
        here, later = (unit("G", float(np.exp(z[-1] + step))) for step in (0.0, LOG_STEP))
        change = [np.exp(z[-2]) * (b - a) / LOG_STEP for a, b in zip(here, later, strict=True)]
        return [*(V[name] for name in names[:-1]), here, change]

    return _scored(np.append(np.log(start), np.log(correlation_s)), matrices, stacks, np.log(bounds_s))


def _scored(
    z: np.ndarray,
    matrices: Callable[[np.ndarray], list[Stacked]],
    stacks: Sequence[Stack],
    time_bounds: np.ndarray | None = None,
) -> Fitted:
    """Fisher scoring over z: ln s^2 (K,), then ln T where ``time_bounds`` are given."""
    sizes = len(z) - (time_bounds is not None)

    def at(z: np.ndarray) -> tuple[float, np.ndarray, np.ndarray]:
        x = np.exp(z[:sizes])
        value, slope, curvature = cost(x, matrices(z), stacks)
        scale = np.append(x, 1.0) if time_bounds is not None else x
        return value, slope * scale, curvature * np.outer(scale, scale)

    value, slope, curvature = at(z)
    damping = 0.0
    for _ in range(STEPS):
        held = np.diag(np.diag(curvature)) * damping + 1e-9 * np.eye(len(z)) * max(float(np.diag(curvature).max()), 1e-300)
        step = np.clip(-np.linalg.solve(curvature + held, slope), -3, 3)
        tried = z + step
        if time_bounds is not None:
            tried[-1] = np.clip(tried[-1], *time_bounds)
        tried[:sizes] = np.clip(tried[:sizes], -300, 100)
        new = at(tried)
        if new[0] <= value + 1e-9:
            gained = value - new[0]
            z, (value, slope, curvature) = tried, new
            damping /= 4
            if gained < ENDS:
                break
        else:
            damping = max(4 * damping, 0.5)
            if damping > 1e6:
                break
    return Fitted(np.exp(z[:sizes]), value, curvature / 2, float(np.exp(z[-1])) if time_bounds is not None else np.nan)
