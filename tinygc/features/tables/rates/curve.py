"""A smooth curve that no law names, with the sigma of its shape: the figures of a range that bends are those of this curve.

    output = clip(offset of the curve + K w + b w |w / W|^p + f(w) + extras, lower limit, upper limit)

b w |w / W|^p is how any smooth departure begins; W is the largest rate.  f is a random function, zero at rest: white noise over the
distance from rest, integrated three times (Wahba 1978: smoothing splines, and the sigmas that hold for them).  b and f are odd, or each
sense has its own.  A figure is the median over draws from all p, senses and sizes of f, each as often as its evidence says; its sigma is
half of what holds 68 % of them.  What the rates leave open, between them and about rest, is in it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from tinygc.features.tables.rates import fitting
from tinygc.features.tables.rates.fitting import PASSES, ROUNDING, STATED_FREEDOM, Fit, Number, enough, floor, span, weight_sigma
from tinygc.features.tables.rates.laws import CURVE, Hypothesis
from tinygc.features.tables.rates.points import Points
from tinygc.inference.solve import solve

#: log2 of how the departure may begin, from a cusp to a plateau: a grid, halved where one has more than a share of the evidence
POWERS, MOST_SHARE, MOST_TIMES = np.arange(-1.5, 2.1, 0.5), 0.15, 8
#: knots of each sense, denser towards rest, where what bends at any power of the rate still shows
KNOTS = (np.arange(1, 17) / 16) ** 2
#: variance of f at the largest rate, in that of the noise: from none to what any output shows, which finds the noise
RATIOS = 10.0 ** np.arange(-2, 12)
#: size of f at the largest rate, in the largest departure from a straight line: none is a power alone (benchmarks/rate_steps.py ranges)
SIZES = 10.0 ** np.arange(-1, 1.1, 0.5)
#: of the largest variance of the basis: what lies below is rounding
LEAST = 1e-10
#: draws, their seed, and the share of the best one's evidence below which a shape is not drawn
DRAWS, SEED, DRAWN = 200, 1, 1e-3


@dataclass(frozen=True)
class Shape:
    """Columns of a curve beside K w: of a power, then of f, odd or of each sense by itself."""

    power: float
    is_odd: bool
    largest_dps: float

    @property
    def free(self) -> int:
        """How many columns have no prior."""
        return 1 if self.is_odd else 2

    def columns(self, rate: np.ndarray) -> np.ndarray:
        """(N, free + q) at rates (N,) °/s; those of f have independent weights of variance one."""
        return _columns(self, np.ascontiguousarray(rate, dtype=float).tobytes())


@lru_cache(maxsize=512)
def _columns(shape: Shape, rates: bytes) -> np.ndarray:
    rate = np.frombuffer(rates) / shape.largest_dps
    size, axes = np.linalg.eigh(_covariance(KNOTS, KNOTS))
    kept = size > LEAST * size.max()
    f = _covariance(np.abs(rate), KNOTS) @ (axes[:, kept] / np.sqrt(size[kept]))
    power = np.abs(rate)[:, None] ** (1 + shape.power)
    if shape.is_odd:
        return np.sign(rate)[:, None] * np.concatenate([power, f], axis=1)
    up, down = (rate > 0)[:, None], (rate < 0)[:, None]
    return np.concatenate([power * up, power * down, f * up, f * down], axis=1)


def _covariance(u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """(U, V) covariance of f at distances from rest, one at a distance of one."""
    low, high = np.minimum.outer(u, v), np.maximum.outer(u, v)
    return low**3 * (10 * high**2 - 5 * high * low + low**2) / 6


@dataclass(frozen=True, eq=False)
class Curve(Fit):
    """A fitted curve: weights (free + q,) of its shape, those of f of variance ``ratio`` times that of the noise; penalty: -2 log evidence
    of the weights; shapes: evidence and curve of every shape, in that of the best, which this one is."""

    of: Shape = field(kw_only=True)
    weights: np.ndarray = field(kw_only=True)
    ratio: float = field(kw_only=True)
    penalty: float = field(kw_only=True)
    shapes: tuple[tuple[float, Curve], ...] = field(kw_only=True, default=())

    def unlimited(self, rate: np.ndarray, points: Points | None = None) -> np.ndarray:
        """(M,) output less offset at rates (M,) °/s, without the limits."""
        return super().unlimited(rate, points) + self.of.columns(np.asarray(rate, dtype=float)) @ self.weights

    @cached_property
    def vector(self) -> np.ndarray:
        """(p,) all estimated numbers, the weights last."""
        return np.concatenate([super().vector, self.weights])

    def moved(self, vector: np.ndarray) -> Curve:
        """The same shape with other numbers."""
        named = len(vector) - len(self.weights)
        like = super().moved(vector[:named])
        return replace(self, offsets=like.offsets, coefficients=like.coefficients, limits=like.limits, weights=vector[named:], shapes=())

    @property
    def occam(self) -> float:
        """-2 log evidence that the numbers with a prior cost."""
        return self.penalty

    @property
    def prior_scale(self) -> np.ndarray:
        """(p,) 1 / prior sigma of each number, in sigmas of the noise; 0 for what has none."""
        known = len(self.weights) - self.of.free
        one = 1 / np.sqrt(self.ratio) / np.median(weight_sigma(self.points))
        return np.concatenate([np.zeros(len(self.vector) - known), np.full(known, one)])

    @cached_property
    def jacobian(self) -> np.ndarray:
        """(N, p) derivatives of the whitened predictions."""
        points, free = self.points, ~self.is_limited[:, None]
        sides = [side for side, there in zip(self.at_limits, (self.hypothesis.lower, self.hypothesis.upper), strict=True) if there]
        linear = [np.eye(len(points.curves))[points.curve] * free, self.hypothesis.columns(points.rate_dps, (), points) * free]
        whole = np.column_stack([*linear, *(side.astype(float) for side in sides), self.of.columns(points.rate_dps) * free])
        return whole / weight_sigma(points)[:, None]

    @property
    def numbers(self) -> list[Number]:
        """The numbers that have a name: median over the draws, and half of what holds 68 % of them."""
        low, middle, high = np.percentile([each.vector[: len(self.names)] for each in self.draws], [16, 50, 84], axis=0).tolist()
        return [Number(*each) for each in zip(self.names, middle, (np.subtract(high, low) / 2).tolist(), self.units, strict=True)]

    @cached_property
    def draws(self) -> list[Curve]:
        """Curves that the points allow: each shape as often as its evidence says, its numbers by their covariance."""
        rng = np.random.default_rng(SEED)
        shares = np.array([share for share, _ in self.shapes])
        counts = rng.multinomial(DRAWS, shares / shares.sum())
        found = []
        for (_, curve), count in zip(self.shapes, counts.tolist(), strict=True):
            if count:
                size, axes = np.linalg.eigh(curve.solution.spread)
                root = axes * np.sqrt(np.maximum(size, 0.0))
                noise = np.sqrt(curve.variance * self.freedom / rng.chisquare(self.freedom, count))
                found += [
                    curve.moved(curve.vector + n * (root @ z)) for n, z in zip(noise, rng.normal(size=(count, len(size))), strict=True)
                ]
        return found


def fit(points: Points, hypothesis: Hypothesis) -> Fit | None:
    """The best fit of a law of the list, or of the curve; None where the points do not determine it."""
    return fit_curve(points, hypothesis) if hypothesis.law == CURVE else fitting.fit(points, hypothesis)


def fit_curve(points: Points, hypothesis: Hypothesis) -> Curve | None:
    """The curve of the largest evidence, with the hypothesis' limits and extras; None where the points do not determine it."""
    from scipy.special import gammaln

    largest = float(np.abs(points.rate_dps).max())
    low = high = np.zeros(len(points), dtype=bool)
    if hypothesis.lower or hypothesis.upper:  # which a cubic tells well enough to begin with
        near = fitting.fit(points, replace(hypothesis, law="cubic")) or fitting.fit(points, replace(hypothesis, law="line"))
        if near is None:
            return None
        low, high = near.at_limits
    # What a number without a prior costs, as in ``choice.score``.
    sigma, everywhere, free = weight_sigma(points), np.ones(len(points), dtype=bool), ~(low | high)
    penalty_of_one = np.log(max(float(np.sum((_departure_from_line(points, everywhere) / sigma) ** 2)), floor(points)))
    first = [each for odd in (True, False) for each in _of_shape(points, hypothesis, Shape(1.0, odd, largest), low, high, RATIOS)]
    if not first:
        return None
    noise = min(first, key=lambda each: each[0])[1].noise * np.median(sigma)
    ratios = (SIZES * np.abs(_departure_from_line(points, free)).max() / max(noise, ROUNDING * span(points))) ** 2

    def evaluate(log: float) -> list[tuple[float, Curve]]:
        """-2 log evidence and curve of a power, for each sense and ratio."""
        found = [each for odd in (True, False) for each in _of_shape(points, hypothesis, Shape(2.0**log, odd, largest), low, high, ratios)]
        return [(score + each.parameters * penalty_of_one - 2 * gammaln(each.freedom / 2), each) for score, each in found]

    evaluated = {log: evaluate(log) for log in POWERS.tolist()}
    for times in range(MOST_TIMES):
        logs = np.array(sorted(evaluated))
        owner = np.repeat(np.arange(len(logs)), [len(evaluated[log]) for log in logs.tolist()])
        scores = np.array([score for log in logs.tolist() for score, _ in evaluated[log]])
        share = np.exp((scores.min() - scores) / 2) * np.gradient(logs)[owner]
        probable = np.bincount(owner, share, len(logs)) > MOST_SHARE * share.sum()
        if not probable.any() or times == MOST_TIMES - 1:
            break
        evaluated |= {log: evaluate(log) for log in ((logs[1:] + logs[:-1]) / 2)[probable[1:] | probable[:-1]].tolist()}
    # The evidence is the mean over all powers, senses and sizes of f; the best stands for the curve.
    curves = [each for log in logs.tolist() for _, each in evaluated[log]]
    best = curves[int(np.argmin(scores))]
    mean = share.sum() / (2 * len(SIZES) * np.ptp(POWERS))
    shapes = tuple((float(own), each) for own, each in zip(share / share.max(), curves, strict=True) if own > DRAWN)
    return replace(best, penalty=best.penalty - 2 * float(np.log(mean)), shapes=shapes)


def _departure_from_line(points: Points, which: np.ndarray) -> np.ndarray:
    """(M,) of the points that are chosen, (N,) bool: output less the best straight line through them."""
    line = np.column_stack([np.eye(len(points.curves))[points.curve], points.rate_dps])[which]
    sigma, output = weight_sigma(points)[which], points.output[which]
    left: np.ndarray = output - line @ solve(line / sigma[:, None], output / sigma).shortest
    return left


def _of_shape(
    points: Points, hypothesis: Hypothesis, shape: Shape, low: np.ndarray, high: np.ndarray, ratios: np.ndarray
) -> Iterator[tuple[float, Curve]]:
    """-2 log evidence, but for what is the same of all, and the curve, for each ratio of f's variance to that of the noise; low, high (N,):
    points at the limits at first."""
    sigma, count = weight_sigma(points), len(points.curves)
    columns = shape.columns(points.rate_dps)
    fixed = np.column_stack([np.eye(count)[points.curve], hypothesis.columns(points.rate_dps, (), points), columns[:, : shape.free]])
    f, stated = columns[:, shape.free :], STATED_FREEDOM if points.is_known else 0.0
    freedom = len(points) - fixed.shape[1] - hypothesis.lower - hypothesis.upper + stated
    variance = ratios[:, None] * np.median(sigma) ** 2  # of a weight, for noise of one stated sigma
    limits = (-np.inf, np.inf)
    for _ in range(PASSES):
        free = ~(low | high)
        if not enough(points, hypothesis, low, high) or freedom < 1:
            return
        limits = (
            float(points.output[low].mean()) if hypothesis.lower else -np.inf,
            float(points.output[high].mean()) if hypothesis.upper else np.inf,
        )
        y = np.column_stack([points.output, f]) / sigma[:, None]
        straight = solve(fixed[free] / sigma[free, None], y[free])
        if straight.open.size:
            return
        left = y[free] - fixed[free] / sigma[free, None] @ straight.shortest
        u, s, v = np.linalg.svd(left[:, 1:], full_matrices=False)
        z = u.T @ left[:, 0]
        shrunk = 1 + variance * s**2  # (R, q)
        weights = (variance * s * z / shrunk) @ v
        clipped = sum(
            float(np.sum(((points.output - limit)[side] / sigma[side]) ** 2))
            for side, limit in zip((low, high), limits, strict=True)
            if side.any()
        )
        square = left[:, 0] @ left[:, 0] - z @ z + np.sum(z**2 / shrunk, axis=1) + clipped
        occam = np.sum(np.log(shrunk), axis=1)
        scores = freedom * np.log((np.maximum(square, floor(points)) + stated) / 2) + occam
        coefficients = straight.shortest[:, :1] - straight.shortest[:, 1:] @ weights.T  # (k, R)
        best = (fixed @ coefficients + f @ weights.T)[:, np.argmin(scores)]
        now = (best <= limits[0]) & hypothesis.lower, (best >= limits[1]) & hypothesis.upper
        if (now[0] == low).all() and (now[1] == high).all():
            break
        low, high = now
    for number, ratio in enumerate(ratios.tolist()):
        offsets, rest, powers = np.split(coefficients[:, number], [count, fixed.shape[1] - shape.free])
        own = np.concatenate([powers, weights[number]])
        yield (
            float(scores[number]),
            Curve(points, hypothesis, offsets, rest, (), limits, of=shape, weights=own, ratio=ratio, penalty=float(occam[number])),
        )
