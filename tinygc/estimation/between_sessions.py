"""One number of a unit over its sessions: level, drift, steps, and the scatter from session to session beyond each session's own error.

    value_j = level + drift t_j + sum of steps before j + scatter_j + error_j        scatter ~ N(0, s^2), error_j ~ N(0, own_j), as stated

Contrasts K' value, K orthogonal to the columns of level, drift and steps, hold all of s.  In the axes of K' diag(own) K they are
independent, z_i ~ N(0, lambda_i + s^2), so that restricted likelihood and pivot are sums over m = n - p numbers:

    -2 log L(s) = sum log(lambda_i + s^2) + z_i^2 / (lambda_i + s^2)          Q(s) = sum z_i^2 / (lambda_i + s^2) ~ chi-square of m

The estimate of s is the former's (tests hold it to ``inference.noise``).  Intervals are the latter's: Q is exact at the true s whatever the
own errors are (the Q profile, Viechtbauer 2007).  Every other interval is over the distribution of s that Q gives, with the coefficients
normal given s.  Without own errors that is Student's t with m degrees of freedom; without scatter, the normal of known errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from tinygc.inference.choose import chance_of_any, each_alone
from tinygc.inference.solve import COVERAGE, solve

#: the share of a normal variable within one sigma
ONE_SIGMA = 0.6826894921370859
#: probability that a history without a shock, a drift or an effect of temperature has any by chance, over all that is looked at
CHANCE = 0.05
#: numbers of a unit that are looked at: the gyroscope's twelve and the accelerometer's nine, also where only some of them are known
LOOKED_AT = 21
#: fewest sessions for a drift and a scatter: two degrees of freedom are left to the scatter
FEWEST_WITH_DRIFT = 4
#: fewest sessions for an effect of temperature as well
FEWEST_WITH_TEMPERATURE = 5
#: K: sessions that differ by less determine no effect of temperature
LEAST_WARMTH_K = 2.0
#: candidates for a step, the largest by the scatter without it, whose p-values are computed: with equal own errors the first is the best
TRIED = 3
#: least share of the sample's variance that counts as scatter: a few sessions may agree by chance
LEAST_SCATTER = 0.1
#: quadrature over the distribution of s: probabilities in even steps of their logit, down to those of the smallest p-values
_LOGIT = np.arange(-36.0, 18.0, 0.3)
_SHARES = 1 / (1 + np.exp(-_LOGIT))
_WEIGHTS = np.exp(-_LOGIT) * _SHARES**2 / np.sum(np.exp(-_LOGIT) * _SHARES**2)
_MOST_STEPS = 60
_TINY = 1e-300


def contrasts(values: np.ndarray, own: np.ndarray, design: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Variances lambda (m,) and contrasts z (m,) of values (n,) with own variances (n,), free of the columns (n, p), whose rank is p."""
    K = np.linalg.qr(design, mode="complete")[0][:, design.shape[1] :]
    variance, axes = np.linalg.eigh(K.T @ (own[:, None] * K))
    return np.maximum(variance, 0.0), axes.T @ (K.T @ values)


def scatter_variance(variance: np.ndarray, z: np.ndarray) -> float:
    """s^2 of the largest restricted likelihood, by Fisher's scoring; at least 0."""
    found = max(float(np.mean(z**2 - variance)), 0.0)
    for _ in range(_MOST_STEPS):
        if not (variance + found).min() > 0:
            break
        weight = (variance + found) ** -2
        before, found = found, max(float(np.sum(weight * (z**2 - variance)) / np.sum(weight)), 0.0)
        if abs(found - before) <= 1e-12 * (found + variance.max()):
            break
    return found


def _variance_where(variance: np.ndarray, z: np.ndarray, pivot: np.ndarray) -> np.ndarray:
    """s^2 (K,) at which Q is each of ``pivot`` (K,); 0 where Q stays below it.  Newton from below: Q is convex and falls."""
    found = np.maximum(np.sum(z**2) / pivot - variance.max(), 0.0)
    for _ in range(_MOST_STEPS):
        total = np.maximum(variance + found[:, None], _TINY)
        over = np.sum(z**2 / total, axis=1) - pivot
        step = np.where(over > 0, over / np.maximum(np.sum(z**2 / total**2, axis=1), _TINY), 0.0)
        found = found + step
        if np.all(step <= 1e-12 * found):
            break
    return found


@dataclass(frozen=True, eq=False)
class Between:
    """A number over n sessions: values (n,), own variances (n,), design (n, p) with fewer columns than rows."""

    values: np.ndarray
    own: np.ndarray
    design: np.ndarray

    @cached_property
    def _contrasts(self) -> tuple[np.ndarray, np.ndarray]:
        return contrasts(self.values, self.own, self.design)

    @property
    def freedom(self) -> int:
        """Degrees of freedom left to the scatter."""
        return self.design.shape[0] - self.design.shape[1]

    @cached_property
    def scatter(self) -> float:
        """s, by restricted likelihood."""
        return float(np.sqrt(scatter_variance(*self._contrasts)))

    @property
    def counted(self) -> float:
        """The scatter that counts for other sessions: s, of ``freedom`` degrees of freedom, and at least ``LEAST_SCATTER`` of the sample's
        variance."""
        variance, z = self._contrasts
        total = variance + self.scatter**2
        weight = total**-2 if total.min() > 0 else np.ones_like(total)
        sample = float(np.sum(weight * z**2) / np.sum(weight))
        return float(np.sqrt(max(self.scatter**2, LEAST_SCATTER * sample)))

    @cached_property
    def scatter_interval(self) -> tuple[float, float]:
        """Interval of s with ``COVERAGE``; where it begins at 0, 0 and the upper limit with that coverage.

        Sessions that agree better than their own errors determine s no less than ordinary ones, whose Q(0) is m.
        """
        from scipy.special import chdtri

        variance, z = self._contrasts
        tail = (1 - COVERAGE) / 2
        low, high = np.sqrt(_variance_where(variance, z, chdtri(self.freedom, np.array([tail, 1 - tail]))))
        if low > 0:
            return float(low), float(high)
        usual = np.sum(z**2 / np.maximum(variance, _TINY)) / self.freedom
        z = z / np.sqrt(min(usual, 1.0)) if usual > 0 else np.sqrt(variance)
        return 0.0, float(np.sqrt(_variance_where(variance, z, chdtri(self.freedom, np.array([COVERAGE])))[0]))

    def weighted(self, square: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For s^2 (K,): the map (K, p, n) from the values to the weighted coefficients, and these coefficients' covariance (K, p, p)."""
        total = np.maximum(self.own + np.asarray(square)[:, None], _TINY)
        scale = total.min(axis=1)[:, None]  # weights of order one, whatever the unit
        weight = scale / total
        covariance = np.linalg.inv(np.einsum("np,kn,nq->kpq", self.design, weight, self.design, optimize=True))
        return np.einsum("kpq,nq,kn->kpn", covariance, self.design, weight, optimize=True), covariance * scale[..., None]

    def squares_at(self, share: np.ndarray) -> np.ndarray:
        """Quantiles of s^2 at shares (K,) of the distribution that the pivot gives, from the largest to the least."""
        from scipy.special import gammaincinv

        return _variance_where(*self._contrasts, np.maximum(2 * gammaincinv(self.freedom / 2, share), _TINY))

    @cached_property
    def _nodes(self) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients (K, p) and their covariance (K, p, p) at the quadrature's values of s."""
        to_coefficients, covariance = self.weighted(self.squares_at(_SHARES))
        return to_coefficients @ self.values, covariance

    @cached_property
    def coefficients(self) -> np.ndarray:
        """(p,) at the estimated s."""
        return (self.weighted(np.array([self.scatter**2]))[0] @ self.values)[0]

    def _mixture(self, slope: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        coefficients, covariance = self._nodes
        return coefficients @ slope, np.sqrt(np.maximum(np.einsum("p,kpq,q->k", slope, covariance, slope), _TINY))

    def interval(self, slope: np.ndarray, coverage: float = COVERAGE) -> tuple[float, float]:
        """Interval of slope (p,) times the coefficients."""
        from scipy.optimize import brentq
        from scipy.special import ndtr

        middle, sigma = self._mixture(slope)

        def below(x: float, share: float) -> float:
            return float(_WEIGHTS @ ndtr((x - middle) / sigma)) - share

        ends = float(np.min(middle - 9 * sigma)), float(np.max(middle + 9 * sigma))
        low, high = (
            brentq(below, *ends, args=(share,), xtol=1e-9 * sigma[-1], rtol=1e-12) for share in ((1 - coverage) / 2, (1 + coverage) / 2)
        )
        return low, high

    def sigma(self, slope: np.ndarray) -> float:
        """Half of the interval that covers 68 %."""
        low, high = self.interval(slope, ONE_SIGMA)
        return (high - low) / 2

    def p_value(self, slope: np.ndarray) -> float:
        """Probability, two-sided, of slope times the coefficients as far from 0 by chance."""
        from scipy.special import ndtr

        middle, sigma = self._mixture(slope)
        return float(min(1.0, 2 * min(_WEIGHTS @ ndtr(-middle / sigma), _WEIGHTS @ ndtr(middle / sigma))))


@dataclass(frozen=True, eq=False)
class Course:
    """One number, by n sessions together.

    model: its columns are the level (at the last session), steps in their order, then the drift from ``FEWEST_WITH_DRIFT`` sessions on, and
    the effect of temperature where that is significant.  steps: changes that stay, each by the session before it, counted from 0, with its
    p-value, which is corrected for all that was looked at.  warming: level, drift and temperature, None where temperature is unknown.
    """

    model: Between
    steps: dict[int, float] = field(default_factory=dict)
    has_drift: bool = False
    warming: Between | None = None
    warms: bool = False

    @property
    def drift_column(self) -> np.ndarray:
        """(p,) that takes the drift from the model's coefficients; all 0 where it has none."""
        return self.step_column(len(self.steps)) if self.has_drift else np.zeros(self.model.design.shape[1])

    def step_column(self, number: int) -> np.ndarray:
        """(p,) that takes a step's size from the model's coefficients."""
        return np.eye(self.model.design.shape[1])[1 + number]

    @cached_property
    def drift_p(self) -> float:
        """Probability of as much drift by chance; 1 where the model has none."""
        return self.model.p_value(self.drift_column) if self.has_drift else 1.0

    @property
    def drifts(self) -> bool:
        """Whether the drift is significant among all numbers that are looked at."""
        return self.drift_p < CHANCE / LOOKED_AT


def course(values: np.ndarray, own: np.ndarray, at: np.ndarray, warmth: np.ndarray | None = None) -> Course:
    """Estimate the course of values (n,), own variances (n,), n of at least 2, at increasing times at (n,): years, or their order.

    A drift is in the model whether it is significant or not: else one that is not would pass for scatter.  warmth (n,): temperatures in °C,
    where all sessions have one.
    """
    level, time = np.ones_like(at), at - at[-1]
    if len(values) < FEWEST_WITH_DRIFT or time[0] == 0:
        return Course(Between(values, own, level[:, None]))
    warming, columns = None, [time]
    if warmth is not None and len(values) >= FEWEST_WITH_TEMPERATURE and np.ptp(warmth) >= LEAST_WARMTH_K:
        warmer = warmth - warmth[-1]
        design = np.column_stack([level, time, warmer])
        if solve(design).rank == design.shape[1]:
            warming = Between(values, own, design)
            columns += [warmer] if warming.p_value(np.eye(3)[2]) < CHANCE / LOOKED_AT else []
    steps = _steps(values, own, lambda jumps: np.column_stack([level, *jumps, *columns]))
    design = np.column_stack([level, *(jump(len(values), before) for before in steps), *columns])
    return Course(Between(values, own, design), steps, True, warming, len(columns) > 1)


def jump(count: int, before: int) -> np.ndarray:
    """(n,) column of a step after session ``before``: -1 up to there and 0 after it, so that the level is the last session's."""
    return np.where(np.arange(count) <= before, -1.0, 0.0)


def candidates(values: np.ndarray, own: np.ndarray, design: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Size and sigma (n - 1,) of a further step after each session, at the scatter of the design (n, p); nan where it is not determined."""
    total = np.maximum(own + Between(values, own, design).scatter ** 2, _TINY)
    least = total.min()
    root = np.sqrt(least / total)[:, None]  # weights of order one, whatever the unit
    jumps = np.column_stack([jump(len(values), before) for before in range(len(values) - 1)])
    pull, information = each_alone(root[:, 0] * values, root * design, root * jumps)
    return pull / information, np.sqrt(least / information)


def _steps(values: np.ndarray, own: np.ndarray, design_of: Callable[[list[np.ndarray]], np.ndarray]) -> dict[int, float]:
    """Add the most significant step, one after the other, while it is significant over all intervals and numbers (Sidak)."""
    count, looks = len(values), (len(values) - 1) * LOOKED_AT
    found: dict[int, float] = {}

    def p_value(before: int) -> float:
        trial = design_of([jump(count, each) for each in (*found, before)])
        return Between(values, own, trial).p_value(np.eye(trial.shape[1])[1 + len(found)])

    while count - (design := design_of([jump(count, each) for each in found])).shape[1] >= 2:
        size, sigma = candidates(values, own, design)
        score = np.nan_to_num(np.abs(size) / sigma, nan=-1.0)
        tried = {int(before): p_value(int(before)) for before in np.argsort(-score)[:TRIED] if score[before] >= 0}
        best = min(tried, key=tried.__getitem__, default=None)
        if best is None or (corrected := chance_of_any(tried[best], looks)) >= CHANCE:
            break
        found[best] = corrected
    return found
