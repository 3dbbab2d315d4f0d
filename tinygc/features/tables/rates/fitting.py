"""The fit of one hypothesis to the points of a sensor: coefficients, shape parameters, limits of the output, and their covariance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from typing import ClassVar, Self, TypeVar

import numpy as np

from session.base.numeric import rms_of
from tinygc.features.tables.rates.laws import Hypothesis
from tinygc.features.tables.rates.points import Points
from tinygc.inference.choose import of_any_scale
from tinygc.inference.solve import Solution, solve

#: shares of the output's span within which readings at an end count as one plateau, where a fit begins
PLATEAUS = (0.002, 0.02)
#: passes between which points lie at a limit, and the coefficients
PASSES = 6
#: least degrees of freedom of repeats that test a law, and the probability below which they refute it
LEAST_REPEATS, REFUTED = 3, 0.05
#: rise of chi-square, in the noise's variance, up to which a value is not excluded (95 %), and values that are tried of a number
PROFILE_95, PROFILED = 3.84, 181
#: step of a central difference, of the shape parameter's size, which counts as this at least
STEP, LEAST_SHAPE = 1e-5, 1e-3
#: fits of one hypothesis, from different starts, that are refined; steps of each; residuals, in those of its start, where it is no fit
REFINED, MOST_STEPS, WORSE = 2, 60, 10.0
ONE = np.ones(1)
F = TypeVar("F", bound="Fit")


@dataclass(frozen=True)
class LackOfFit:
    """F test of a law against repeats of its rates, offsets of curves apart.

    p_value: that the law leaves so much by chance; noise: of a repeat, in the output's unit or as factor on the stated sigmas, with
    ``freedom`` degrees of freedom; variance_inflation: scatter of the rates' means about the law, over the noise of the fit, where the law
    is refuted, else 1.
    """

    p_value: float
    noise: float
    freedom: int
    variance_inflation: float


@dataclass(frozen=True)
class Number:
    """A number of a law: value and sigma, both None where the points do not determine it; between: which values fit as well."""

    name: str
    value: float | None
    sigma: float | None
    unit: str
    between: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class Fit:
    """A hypothesis fitted to points, or, without its numbers, where a fit begins (``linear``).

    shape (P,); offsets (C,): of the curves; coefficients (K,): of the law's columns and of the extras; limits: (lower, upper) of the
    output, infinite where there is none; weights (q,): of ``own`` columns, all but the first ``free`` with a prior variance of ``ratio``
    times that of the noise; penalty: -2 log evidence that these cost.
    """

    points: Points
    hypothesis: Hypothesis
    shape: tuple[float, ...] = ()
    offsets: np.ndarray = field(default_factory=lambda: np.zeros(0))
    coefficients: np.ndarray = field(default_factory=lambda: np.zeros(0))
    limits: tuple[float, float] = (-np.inf, np.inf)
    weights: np.ndarray = field(default_factory=lambda: np.zeros(0))
    ratio: float = 1.0
    penalty: float = 0.0
    free: ClassVar[int] = 0

    def own(self, rate: np.ndarray) -> np.ndarray:
        """(M, q) columns at rates (M,) °/s that only a curve has (``curve.py``)."""
        return np.zeros((len(rate), 0))

    def unlimited(self, rate: np.ndarray, points: Points | None = None) -> np.ndarray:
        """(M,) output less offset at rates (M,) °/s, without the limits; points: which these are, None for any rates."""
        rate = np.asarray(rate, dtype=float)
        found: np.ndarray = self.hypothesis.columns(rate, self.shape, points) @ self.coefficients + self.own(rate) @ self.weights
        return found

    def at(self, rate: np.ndarray, offset: float | None = None) -> np.ndarray:
        """(M,) output at rates (M,) °/s; offset: the mean of the curves' by default."""
        return np.clip(self.unlimited(rate) + (self.offset if offset is None else offset), *self.limits)

    @property
    def offset(self) -> float:
        """Mean offset of the curves."""
        return float(self.offsets.mean())

    @cached_property
    def predicted(self) -> np.ndarray:
        """(N,) at the points."""
        points = self.points
        return np.clip(self.offsets[points.curve] + self.unlimited(points.rate_dps, points), *self.limits)

    @property
    def residuals(self) -> np.ndarray:
        """(N,) output less prediction, in the output's unit."""
        return self.points.output - self.predicted

    @property
    def rms(self) -> float:
        """Root mean square of the residuals."""
        return rms_of(self.residuals)

    @property
    def at_limits(self) -> tuple[np.ndarray, np.ndarray]:
        """(N,) whether a point lies at the lower limit, and at the upper one."""
        return self.predicted <= self.limits[0], self.predicted >= self.limits[1]

    @property
    def is_limited(self) -> np.ndarray:
        """(N,) whether a point lies at a limit."""
        low, high = self.at_limits
        return low | high

    @property
    def parameters(self) -> int:
        """How many numbers without a prior were estimated."""
        return int(np.sum(self.prior_scale == 0))

    @cached_property
    def chi_square(self) -> float:
        """Sum of squared residuals, each over its sigma where these are known, and of what priors miss."""
        return float(np.sum((self.residuals / self.points.weight) ** 2) + np.sum((self.prior_scale * self.vector) ** 2))

    @property
    def squares(self) -> float:
        """``chi_square``, at least that of rounding."""
        return max(self.chi_square, self.points.floor)

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the noise: points less parameters, and those of stated sigmas."""
        return len(self.points) - self.parameters + self.points.stated

    @property
    def noise(self) -> float:
        """Size of the noise: sigma of a point at no limit, or the factor on reported ones; NaN where nothing is free."""
        freedom = self.freedom - int(self.is_limited.sum()) + self.hypothesis.lower + self.hypothesis.upper
        squares = self.chi_square - self._clipped + self.points.stated
        return float(np.sqrt(squares / freedom)) if freedom > 0 else float("nan")

    @property
    def _clipped(self) -> float:
        """Sum of squared whitened residuals of the points at the limits."""
        return float(np.sum((self.residuals / self.points.weight)[self.is_limited] ** 2))

    # All parameters as one vector: offsets, coefficients, shape, the limits that there are, weights.

    @cached_property
    def vector(self) -> np.ndarray:
        """(p,) all estimated numbers."""
        limits = np.array(self.limits)
        return np.concatenate([self.offsets, self.coefficients, self.shape, limits[np.isfinite(limits)], self.weights])

    @property
    def prior_scale(self) -> np.ndarray:
        """(p,) 1 / prior sigma of each number, in sigmas of the noise; 0 for what has none."""
        known = len(self.weights) - self.free
        one = 1 / np.sqrt(self.ratio) / np.median(self.points.weight)
        return np.concatenate([np.zeros(len(self.vector) - known), np.full(known, one)])

    def moved(self, vector: np.ndarray) -> Self:
        """The same hypothesis with other numbers."""
        limits = np.array(self.limits)
        sizes = len(self.offsets), len(self.coefficients), len(self.shape), int(np.isfinite(limits).sum())
        offsets, coefficients, shape, limits[np.isfinite(limits)], weights = np.split(vector, np.cumsum(sizes))
        low, high = limits.tolist()
        return replace(self, offsets=offsets, coefficients=coefficients, shape=tuple(shape.tolist()), limits=(low, high), weights=weights)

    @cached_property
    def jacobian(self) -> np.ndarray:
        """(N, p) derivatives of the whitened predictions."""
        points, of, free = self.points, self.hypothesis, ~self.is_limited[:, None]

        def columns(shape: np.ndarray) -> np.ndarray:
            return of.columns(points.rate_dps, tuple(shape.tolist()), points)

        shape = np.array(self.shape)
        slopes = [
            (columns(shape + step) - columns(shape - step)) @ self.coefficients / (2 * step.sum())
            for step in np.diag(STEP * np.maximum(np.abs(shape), LEAST_SHAPE))
        ]
        linear = np.column_stack([np.eye(len(points.curves))[points.curve], columns(shape), *slopes]) * free
        limits = [side.astype(float) for side, there in zip(self.at_limits, np.isfinite(self.limits), strict=True) if there]
        return np.column_stack([linear, *limits, self.own(points.rate_dps) * free]) / points.weight[:, None]

    @cached_property
    def _rows(self) -> tuple[np.ndarray, np.ndarray]:
        """(M, p) derivatives and (M,) residuals, whitened: of the points, then of the priors.

        Points at the limits miss these by more than the noise where the limits are soft, and count less for it.
        """
        known, limited = np.flatnonzero(self.prior_scale), self.is_limited
        prior = np.diag(self.prior_scale)[known]
        spare = int(limited.sum()) - self.hypothesis.lower - self.hypothesis.upper
        more = max(float(np.sqrt(self._clipped / spare)) / max(self.noise, 1e-300), 1.0) if spare > 0 else 1.0
        less = np.where(limited, 1 / more, 1.0)
        residuals = np.append(less * self.residuals / self.points.weight, -prior @ self.vector)
        return np.concatenate([self.jacobian * less[:, None], prior]), residuals

    @cached_property
    def solution(self) -> Solution:
        """What the points determine of ``vector``, for noise of variance one (``tinygc.inference.solve``)."""
        return solve(self._rows[0])

    @property
    def variance(self) -> float:
        """Of the noise, wider where repeats refute the law."""
        lack = self.lack_of_fit
        return self.noise**2 * (1.0 if lack is None else lack.variance_inflation)

    @cached_property
    def covariance(self) -> np.ndarray:
        """(p, p) of ``vector``; of numbers that the points do not determine the variance is infinite."""
        return self.solution.covariance * self.variance

    @cached_property
    def lack_of_fit(self) -> LackOfFit | None:
        """Whether the law leaves more than repeats of a rate do; None where too few rates were repeated."""
        rates = np.unique(self.points.distinct)
        repeated = (self.points.distinct[:, None] == rates[None, :]) / self.points.weight[:, None]
        jacobian, residuals = self._rows
        free, left = [], []
        for columns in (
            jacobian,
            np.column_stack([jacobian, np.concatenate([repeated, np.zeros((len(jacobian) - len(repeated), len(rates)))])]),
        ):
            found = solve(columns, residuals)
            free.append(len(residuals) - found.rank)
            left.append(max(float(np.sum((residuals - columns @ found.shortest) ** 2)), self.points.floor))
        between = free[0] - free[1]
        if free[1] < LEAST_REPEATS or not between:
            return None
        from scipy.special import fdtrc

        scatter, repeats = max(left[0] - left[1], 0.0) / between, left[1] / free[1]
        p_value = float(fdtrc(between, free[1], scatter / repeats))
        inflation = max(scatter / self.noise**2, 1.0) if p_value < REFUTED else 1.0
        return LackOfFit(p_value, float(np.sqrt(repeats)), free[1], inflation)

    @cached_property
    def profile(self) -> list[Fit]:
        """Fits that leave as little with other values of a shape parameter that is not determined (95 %); this one alone where all are."""
        found, at = [self], len(self.offsets) + len(self.coefficients)
        least, most = self.hypothesis.of.bounds(float(np.abs(self.points.rate_dps).max()))
        more = max(PROFILE_95 * self.noise**2, self.points.floor)
        for number in np.flatnonzero(self.solution.is_open[at : at + len(self.shape)]):
            for value in np.linspace(least[number], most[number], PROFILED):
                shape = tuple(np.where(np.arange(len(self.shape)) == number, value, self.shape).tolist())
                others = (other for _, other in linear(replace(self, shape=shape), *self.at_limits))
                found += [other for other in others if other.chi_square < self.chi_square + more]
        return found

    @property
    def numbers(self) -> list[Number]:
        """The numbers that have a name, with their sigmas."""
        found, at = [], len(self.offsets) + len(self.coefficients)
        # a curve's weights come last, and have no names
        for n, (name, unit, value, variance) in enumerate(zip(self.names, self.units, self.vector, np.diag(self.covariance), strict=False)):
            if np.isfinite(variance):
                found.append(Number(name, float(value), float(np.sqrt(variance)), unit))
            else:
                values = [each.vector[n] for each in self.profile] if at <= n < at + len(self.shape) else []
                found.append(Number(name, None, None, unit, (float(min(values)), float(max(values))) if values else None))
        return found

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the numbers in ``vector``."""
        of = self.hypothesis
        offsets = [f"V0[{number}]" for number in range(len(self.offsets))] if len(self.offsets) > 1 else ["V0"]
        limits = ["V−"] * of.lower + ["V+"] * of.upper
        return (*offsets, *(each.name for each in of.coefficients), *(shape.name for shape in of.of.shapes), *limits)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the numbers in ``vector``."""
        of, unit = self.hypothesis, self.points.unit
        own = *(over_rate(unit, each.power) for each in of.coefficients), *(shape.unit for shape in of.of.shapes)
        return (*[unit] * len(self.offsets), *own, *[unit] * (of.lower + of.upper))


def over_rate(unit: str, power: int) -> str:
    """A unit over a power of °/s; of an output in °/s what is left of both."""
    if unit == "°/s" and power:
        return "1" if power == 1 else f"1/{_power(power - 1)}"
    return f"{unit}/{_power(power)}" if power else unit


def _power(power: int) -> str:
    return f"(°/s){['', '²', '³', '⁴', '⁵'][power - 1]}"


def fit(points: Points, hypothesis: Hypothesis) -> Fit | None:
    """The best fit of a hypothesis; None where the points do not determine it."""
    found = [
        first
        for low, high in product(plateaus(points, hypothesis.lower, False), plateaus(points, hypothesis.upper, True))
        for shape in hypothesis.of.starts(float(np.abs(points.rate_dps).max()))
        for _, first in linear(Fit(points, hypothesis, shape), low, high)
    ]
    found = sorted(found, key=lambda each: each.chi_square)[: REFINED if hypothesis.of.shapes else 1]
    return min(map(_refined, found), key=lambda each: each.chi_square, default=None)


def plateaus(points: Points, there: bool, upper: bool) -> Iterator[np.ndarray]:
    """(N,) which points may lie at a limit, one guess after the other; none where there is no limit."""
    output = points.output if upper else -points.output
    if not there:
        yield np.zeros(len(points), dtype=bool)
        return
    seen = set()
    for share in (0.0, *PLATEAUS):
        which = output >= output.max() - share * points.span
        if int(which.sum()) not in seen:
            seen.add(int(which.sum()))
            yield which


def linear(start: F, low: np.ndarray, high: np.ndarray, ratios: np.ndarray = ONE, width: float = 1.0) -> Iterator[tuple[float, F]]:
    """The numbers that enter linearly, and the limits, of a fit that begins at ``start``, by least squares over the points that lie at no
    limit: -2 log evidence (``tinygc.inference.choose.of_any_scale``) and the fit, for each ratio (R,) of its weights' variance to that of
    the noise.

    low, high (N,) bool: points at the limits, where a guess begins; width: squares that a straight line leaves.  Nothing where the points
    do not determine them: two more than there are numbers, as many rates, and a point at each limit.
    """
    points, of, sigma, count = start.points, start.hypothesis, start.points.weight, len(start.points.curves)
    own, ends, stated = start.own(points.rate_dps), int(of.lower) + of.upper, points.stated
    fixed = np.column_stack([np.eye(count)[points.curve], of.columns(points.rate_dps, start.shape, points), own[:, : start.free]])
    f, numbers = own[:, start.free :], fixed.shape[1] + len(start.shape) + ends
    if len(points) < numbers + 2 or not np.isfinite(fixed).all():
        return
    y, variance, limits = np.column_stack([points.output, f]) / sigma[:, None], ratios[:, None] * np.median(sigma) ** 2, start.limits
    for _ in range(PASSES):
        free = ~(low | high)
        if (of.lower and not low.any()) or (of.upper and not high.any()) or free.sum() < fixed.shape[1]:
            return
        limits = float(points.output[low].mean()) if of.lower else -np.inf, float(points.output[high].mean()) if of.upper else np.inf
        straight = solve(fixed[free] / sigma[free, None], y[free])
        if start.free and straight.open.size:
            return
        left = y[free] - fixed[free] / sigma[free, None] @ straight.shortest
        u, s, v = np.linalg.svd(left[:, 1:], full_matrices=False)
        z = u.T @ left[:, 0]
        shrunk = 1 + variance * s**2  # (R, q)
        weights = (variance * s * z / shrunk) @ v
        clipped = np.where(low, limits[0], limits[1])[~free] - points.output[~free]
        squares = left[:, 0] @ left[:, 0] - z @ z + np.sum(z**2 / shrunk, axis=1) + np.sum((clipped / sigma[~free]) ** 2)
        penalty = np.sum(np.log(shrunk), axis=1)
        freedom = len(points) - numbers + stated
        scores = of_any_scale(np.maximum(squares, points.floor) + stated, freedom, fixed.shape[1] + ends, width) + penalty
        coefficients = straight.shortest[:, :1] - straight.shortest[:, 1:] @ weights.T  # (k, R)
        best = (fixed @ coefficients + f @ weights.T)[:, np.argmin(scores)]
        now = (best <= limits[0]) & of.lower, (best >= limits[1]) & of.upper
        if (now[0] == low).all() and (now[1] == high).all():
            break
        low, high = now
    least_rates = len(of.coefficients) + len(of.of.shapes) + 2
    if (of.lower and not low.any()) or (of.upper and not high.any()) or len(np.unique(points.distinct[~(low | high)])) < least_rates:
        return
    for number, ratio in enumerate(ratios.tolist()):
        offsets, rest, powers = np.split(coefficients[:, number], [count, fixed.shape[1] - start.free])
        more = {"weights": np.concatenate([powers, weights[number]]), "ratio": ratio, "penalty": float(penalty[number])}
        yield float(scores[number]), replace(start, offsets=offsets, coefficients=rest, limits=limits, **more)


def _refined(start: Fit) -> Fit:
    """The shape parameters at their optimum, all other numbers following them."""
    from scipy.optimize import least_squares

    points, (low, high) = start.points, start.at_limits
    if not start.shape:
        return start

    def trial(shape: np.ndarray) -> Fit | None:
        return next((found for _, found in linear(replace(start, shape=tuple(shape.tolist())), low, high)), None)

    def residuals(shape: np.ndarray) -> np.ndarray:
        found = trial(shape)
        return (start.residuals * WORSE if found is None else found.residuals) / scale

    scale = points.weight * (1.0 if points.is_known else points.span)
    least, most = start.hypothesis.of.bounds(float(np.abs(points.rate_dps).max()))
    begin = np.clip(start.shape, least + 1e-9 * (most - least), most - 1e-9 * (most - least))
    solved = least_squares(residuals, begin, bounds=(least, most), x_scale=np.maximum(np.abs(begin), 0.1 * most), max_nfev=MOST_STEPS)
    return min((start, trial(solved.x) or start), key=lambda each: each.chi_square)
