"""The fit of one hypothesis to the points of a sensor: coefficients, shape parameters, limits of the output, and their covariance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from session.base.numeric import rms_of
from tinygc.features.tables.rates.laws import EXTRAS, Hypothesis
from tinygc.features.tables.rates.points import Points
from tinygc.inference.solve import Solution, solve

#: readings behind stated sigmas count as so many degrees of freedom at most: the setting of the table adds noise that no std shows
STATED_FREEDOM = 20.0
#: shares of the output's span within which readings at an end count as one plateau, where a fit begins
PLATEAUS = (0.002, 0.02)
#: passes between which points lie at a limit, and the coefficients
PASSES = 6
#: least share of the output's span that a residual may count: no output is written with more digits
ROUNDING = 1e-7
#: least degrees of freedom of repeats that test a law, and the probability below which they refute it
LEAST_REPEATS, REFUTED = 3, 0.05
#: rise of chi-square, in the noise's variance, up to which a value is not excluded (95 %), and values that are tried of a number
PROFILE_95, PROFILED = 3.84, 181
#: step of a central difference, of the parameter's size
STEP = 1e-5
#: fits of one hypothesis, from different starts, that are refined; steps of each; residuals, in those of its start, where it is no fit
REFINED, MOST_STEPS, WORSE = 2, 60, 10.0


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
    """A hypothesis fitted to points.

    offsets (C,): of the curves; coefficients (K,): of the law's columns and of the extras; shape (P,); limits: (lower, upper) of the
    output, infinite where there is none; chi_square: sum of squared residuals over ``weight_sigma``; free: points less parameters.
    """

    points: Points
    hypothesis: Hypothesis
    offsets: np.ndarray
    coefficients: np.ndarray
    shape: tuple[float, ...]
    limits: tuple[float, float]

    def unlimited(self, rate: np.ndarray, points: Points | None = None) -> np.ndarray:
        """(M,) output less offset at rates (M,) °/s, without the limits; points: which these are, None for any rates."""
        return self.hypothesis.columns(np.asarray(rate, dtype=float), self.shape, points) @ self.coefficients

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
        return float(np.sum((self.residuals / weight_sigma(self.points)) ** 2) + np.sum((self.prior_scale * self.vector) ** 2))

    @property
    def freedom(self) -> float:
        """Degrees of freedom of the noise: points less parameters, and those of stated sigmas."""
        return len(self.points) - self.parameters + (STATED_FREEDOM if self.points.is_known else 0.0)

    @property
    def noise(self) -> float:
        """Size of the noise: sigma of a point at no limit, or the factor on stated ones; NaN where nothing is free."""
        stated, ends = STATED_FREEDOM if self.points.is_known else 0.0, self.hypothesis.lower + self.hypothesis.upper
        freedom = self.freedom - int(self.is_limited.sum()) + ends
        return float(np.sqrt((self.chi_square - self._clipped + stated) / freedom)) if freedom > 0 else float("nan")

    @property
    def _clipped(self) -> float:
        """Sum of squared whitened residuals of the points at the limits."""
        return float(np.sum((self.residuals / weight_sigma(self.points))[self.is_limited] ** 2))

    # All parameters as one vector: offsets, coefficients, shape, the limits that there are.

    @cached_property
    def vector(self) -> np.ndarray:
        """(p,) all estimated numbers."""
        limits = [limit for limit, there in zip(self.limits, (self.hypothesis.lower, self.hypothesis.upper), strict=True) if there]
        return np.array([*self.offsets, *self.coefficients, *self.shape, *limits])

    @property
    def occam(self) -> float:
        """-2 log evidence that numbers with a prior cost."""
        return 0.0

    @property
    def prior_scale(self) -> np.ndarray:
        """(p,) 1 / prior sigma of each number, in sigmas of the noise; 0 for what has none."""
        return np.zeros(len(self.vector))

    def moved(self, vector: np.ndarray) -> Fit:
        """The same hypothesis with other numbers."""
        curves, columns, shapes = len(self.offsets), len(self.coefficients), len(self.shape)
        limits = iter(vector[curves + columns + shapes :])
        lower = float(next(limits)) if self.hypothesis.lower else -np.inf
        upper = float(next(limits)) if self.hypothesis.upper else np.inf
        shape = tuple(float(value) for value in vector[curves + columns : curves + columns + shapes])
        return Fit(self.points, self.hypothesis, vector[:curves], vector[curves : curves + columns], shape, (lower, upper))

    @cached_property
    def jacobian(self) -> np.ndarray:
        """(N, p) derivatives of the whitened predictions."""
        found = []
        for number, value in enumerate(self.vector):
            step = STEP * max(abs(value), self._scale(number))
            sides = []
            for sign in (1, -1):
                other = self.vector.copy()
                other[number] += sign * step
                sides.append(self.moved(other).predicted)
            found.append((sides[0] - sides[1]) / (2 * step))
        return np.stack(found, axis=1) / weight_sigma(self.points)[:, None]

    def _scale(self, number: int) -> float:
        """Size of a parameter for a difference quotient where it is zero: what moves the output by a thousandth of its span."""
        columns = number - len(self.offsets)
        if not 0 <= columns < len(self.coefficients):
            return 1e-3 * span(self.points)
        column = self.hypothesis.columns(self.points.rate_dps, self.shape, self.points)[:, columns]
        return 1e-3 * span(self.points) / max(float(np.abs(column).max()), 1e-300)

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
        residuals = np.append(less * self.residuals / weight_sigma(self.points), -prior @ self.vector)
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
        repeated = (self.points.distinct[:, None] == rates[None, :]) / weight_sigma(self.points)[:, None]
        jacobian, residuals = self._rows
        free, left = [], []
        for columns in (
            jacobian,
            np.column_stack([jacobian, np.concatenate([repeated, np.zeros((len(jacobian) - len(repeated), len(rates)))])]),
        ):
            found = solve(columns, residuals)
            free.append(len(residuals) - found.rank)
            left.append(max(float(np.sum((residuals - columns @ found.shortest) ** 2)), floor(self.points)))
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
        more = max(PROFILE_95 * self.noise**2, floor(self.points))
        for number in np.flatnonzero(self.solution.is_open[at : at + len(self.shape)]):
            for value in np.linspace(least[number], most[number], PROFILED):
                shape = tuple(np.where(np.arange(len(self.shape)) == number, value, self.shape).tolist())
                other = _from(self.points, self.hypothesis, shape, *self.at_limits)
                found += [other] if other is not None and other.chi_square < self.chi_square + more else []
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
        law = self.hypothesis.of
        offsets = [f"V0[{number}]" for number in range(len(self.offsets))] if len(self.offsets) > 1 else ["V0"]
        coefficients = [name for name, _ in law.coefficients] + [EXTRAS[name].symbol.split()[0] for name in self.hypothesis.extras]
        coefficients += ["r"] * (self.hypothesis.apart >= 0)
        limits = ["V−"] * self.hypothesis.lower + ["V+"] * self.hypothesis.upper
        return (*offsets, *coefficients, *(shape.name for shape in law.shapes), *limits)

    @cached_property
    def units(self) -> tuple[str, ...]:
        """Units of the numbers in ``vector``."""
        law, unit = self.hypothesis.of, self.points.unit
        powers = [power for _, power in law.coefficients] + [EXTRAS[name].power for name in self.hypothesis.extras]
        powers += [0] * (self.hypothesis.apart >= 0)
        limits = self.hypothesis.lower + self.hypothesis.upper
        return (*[unit] * len(self.offsets), *(over_rate(unit, power) for power in powers), *(s.unit for s in law.shapes), *[unit] * limits)


def over_rate(unit: str, power: int) -> str:
    """A unit over a power of °/s; of an output in °/s what is left of both."""
    if unit == "°/s" and power:
        return "1" if power == 1 else f"1/{_power(power - 1)}"
    return f"{unit}/{_power(power)}" if power else unit


def _power(power: int) -> str:
    return f"(°/s){['', '²', '³', '⁴', '⁵'][power - 1]}"


def span(points: Points) -> float:
    """Largest less smallest output."""
    return float(np.ptp(points.output)) or 1.0


def weight_sigma(points: Points) -> np.ndarray:
    """(N,) what residuals are divided by: the stated sigmas, or 1."""
    return points.sigma if points.is_known else np.ones(len(points))


def floor(points: Points) -> float:
    """Least sum of squared whitened residuals that counts: that of the outputs' last digit, and of the noise that rounding is."""
    least = max(ROUNDING * span(points), points.quantum / np.sqrt(12))
    return float(np.sum((least / weight_sigma(points)) ** 2))


def fit(points: Points, hypothesis: Hypothesis) -> Fit | None:
    """The best fit of a hypothesis; None where the points do not determine it."""
    width = len(points.curves) + len(hypothesis.of.coefficients) + hypothesis.added + len(hypothesis.of.shapes)
    if len(points) < width + hypothesis.lower + hypothesis.upper + 2 or len(np.unique(points.distinct)) < _least_rates(hypothesis):
        return None
    found: list[Fit] = []
    for low, high in product(plateaus(points, hypothesis.lower, False), plateaus(points, hypothesis.upper, True)):
        for start in hypothesis.of.starts(float(np.abs(points.rate_dps).max())):
            first = _from(points, hypothesis, start, low, high)
            if first is not None:
                found.append(first)
    found = sorted(found, key=lambda each: each.chi_square)[: REFINED if hypothesis.of.shapes else 1]
    refined = [each for each in map(_refined, found) if each is not None]
    return min(refined, key=lambda each: each.chi_square, default=None)


def _least_rates(hypothesis: Hypothesis) -> int:
    """Rates at no limit that a hypothesis needs: those of its numbers beside the offsets, and two more."""
    return len(hypothesis.of.coefficients) + len(hypothesis.of.shapes) + hypothesis.added + 2


def enough(points: Points, hypothesis: Hypothesis, low: np.ndarray, high: np.ndarray) -> bool:
    """Whether there are points at each limit, low and high (N,), and rates enough at none."""
    if (hypothesis.lower and not low.any()) or (hypothesis.upper and not high.any()):
        return False
    return len(np.unique(points.distinct[~(low | high)])) >= _least_rates(hypothesis)


def plateaus(points: Points, there: bool, upper: bool) -> Iterator[np.ndarray]:
    """(N,) which points may lie at a limit, one guess after the other; none where there is no limit."""
    output = points.output if upper else -points.output
    if not there:
        yield np.zeros(len(points), dtype=bool)
        return
    seen = set()
    for share in (0.0, *PLATEAUS):
        which = output >= output.max() - share * span(points)
        if int(which.sum()) not in seen:
            seen.add(int(which.sum()))
            yield which


def _from(points: Points, hypothesis: Hypothesis, shape: tuple[float, ...], low: np.ndarray, high: np.ndarray) -> Fit | None:
    """Offsets, coefficients and limits for given shape parameters, by least squares over the points that lie at no limit.

    low, high (N,) bool: points at the limits, where a guess begins.  None where the points do not determine it.
    """
    sigma, count = weight_sigma(points), len(points.curves)
    columns = np.column_stack([np.eye(count)[points.curve], hypothesis.columns(points.rate_dps, shape, points)])
    if not np.isfinite(columns).all():
        return None
    size = np.maximum(np.abs(columns).max(axis=0), 1e-300)
    columns, output = columns / size, points.output
    solved, limits = np.zeros(len(size)), (-np.inf, np.inf)
    for _ in range(PASSES):
        free = ~(low | high)
        if (hypothesis.lower and not low.any()) or (hypothesis.upper and not high.any()) or free.sum() < len(size):
            return None
        limits = (float(output[low].mean()) if hypothesis.lower else -np.inf, float(output[high].mean()) if hypothesis.upper else np.inf)
        solved = solve(columns[free] / sigma[free, None], output[free] / sigma[free]).shortest
        unlimited = columns @ solved
        now = (unlimited <= limits[0]) & hypothesis.lower, (unlimited >= limits[1]) & hypothesis.upper
        if (now[0] == low).all() and (now[1] == high).all():
            break
        low, high = now
    if (hypothesis.lower or hypothesis.upper) and len(np.unique(points.distinct[~(low | high)])) < _least_rates(hypothesis):
        return None
    return Fit(points, hypothesis, solved[:count] / size[:count], solved[count:] / size[count:], shape, limits)


def _refined(start: Fit) -> Fit | None:
    """The shape parameters at their optimum, all other numbers following them; None where a limit holds no point."""
    from scipy.optimize import least_squares

    hypothesis, points = start.hypothesis, start.points
    found, low, high = start, start.predicted <= start.limits[0], start.predicted >= start.limits[1]

    def residuals(shape: np.ndarray) -> np.ndarray:
        trial = _from(points, hypothesis, tuple(shape.tolist()), low, high)
        return (start.residuals * WORSE if trial is None else trial.residuals) / scale

    if hypothesis.of.shapes:
        scale = weight_sigma(points) * (1.0 if points.is_known else span(points))
        least, most = hypothesis.of.bounds(float(np.abs(points.rate_dps).max()))
        begin = np.clip(start.shape, least + 1e-9 * (most - least), most - 1e-9 * (most - least))
        solved = least_squares(residuals, begin, bounds=(least, most), x_scale=np.maximum(np.abs(begin), 0.1 * most), max_nfev=MOST_STEPS)
        trial = _from(points, hypothesis, tuple(solved.x.tolist()), low, high)
        found = min((start, trial or start), key=lambda each: each.chi_square)
    predicted = found.predicted
    if (hypothesis.lower and not (predicted <= found.limits[0]).any()) or (hypothesis.upper and not (predicted >= found.limits[1]).any()):
        return None
    return found
