"""A smooth curve that no law names, with the sigma of its shape: the figures of a range that bends are those of this curve.

    output = clip(offset of the curve + K w + b w |w / W|^p + f(w) + extras, lower limit, upper limit)

b w |w / W|^p is how any smooth departure begins; W is the largest rate.  f is a random function, zero at rest: white noise over the
distance from rest, integrated three times (Wahba 1978: smoothing splines, and the sigmas that hold for them).  b and f are odd, or each
sense has its own.  A figure is the median over draws from all p, senses and sizes of f, each as often as by its evidence; its sigma is
half of what holds 68 % of them.  What the rates leave open, between them and about rest, is in it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np

from tinygc.features.tables.rates import fitting
from tinygc.features.tables.rates.fitting import Fit, Number, linear
from tinygc.features.tables.rates.laws import CURVE, Hypothesis
from tinygc.features.tables.rates.points import Points

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
    """Columns of a curve next to K w: of a power, then of f, odd or of each sense by itself."""

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
    """A fitted curve: of its shape; shapes: evidence and curve of every shape, in that of the best, which this one is."""

    of: Shape = field(kw_only=True)
    shapes: tuple[tuple[float, Curve], ...] = field(kw_only=True, default=())

    @property
    def free(self) -> int:  # type: ignore[override]
        """How many columns have no prior."""
        return self.of.free

    def own(self, rate: np.ndarray) -> np.ndarray:
        """(M, q) columns of its shape at rates (M,) °/s."""
        return self.of.columns(rate)

    @property
    def numbers(self) -> list[Number]:
        """The numbers that have a name: median over the draws, and half of what holds 68 % of them."""
        low, middle, high = np.percentile([each.vector[: len(self.names)] for each in self.draws], [16, 50, 84], axis=0).tolist()
        return [Number(*each) for each in zip(self.names, middle, (np.subtract(high, low) / 2).tolist(), self.units, strict=True)]

    @cached_property
    def draws(self) -> list[Curve]:
        """Curves that the points allow: each shape as often as by its evidence, its numbers by their covariance."""
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
    largest = float(np.abs(points.rate_dps).max())
    low = high = np.zeros(len(points), dtype=bool)
    if hypothesis.lower or hypothesis.upper:  # which a cubic gives well enough to begin with
        near = fitting.fit(points, replace(hypothesis, law="cubic")) or fitting.fit(points, replace(hypothesis, law="line"))
        if near is None:
            return None
        low, high = near.at_limits
    line, bent = (fitting.fit(each, Hypothesis("line")) for each in (points, points.part(~(low | high))))
    if line is None or bent is None:
        return None

    def evaluate(log: float, ratios: np.ndarray) -> list[tuple[float, Curve]]:
        """-2 log evidence and curve of a power, for each sense and ratio."""
        starts = (Curve(points, hypothesis, of=Shape(2.0**log, odd, largest)) for odd in (True, False))
        return [each for start in starts for each in linear(start, low, high, ratios, line.squares)]

    if not (first := evaluate(0.0, RATIOS)):
        return None
    noise = min(first, key=lambda each: each[0])[1].noise * np.median(points.weight)
    ratios = (SIZES * np.abs(bent.residuals).max() / max(noise, points.least)) ** 2
    evaluated = {log: evaluate(log, ratios) for log in POWERS.tolist()}
    for times in range(MOST_TIMES):
        logs = np.array(sorted(evaluated))
        owner = np.repeat(np.arange(len(logs)), [len(evaluated[log]) for log in logs.tolist()])
        scores = np.array([score for log in logs.tolist() for score, _ in evaluated[log]])
        share = np.exp((scores.min() - scores) / 2) * np.gradient(logs)[owner]
        probable = np.bincount(owner, share, len(logs)) > MOST_SHARE * share.sum()
        if not probable.any() or times == MOST_TIMES - 1:
            break
        evaluated |= {log: evaluate(log, ratios) for log in ((logs[1:] + logs[:-1]) / 2)[probable[1:] | probable[:-1]].tolist()}
    # The evidence is the mean over all powers, senses and sizes of f; the best stands for the curve.
    curves = [each for log in logs.tolist() for _, each in evaluated[log]]
    best = curves[int(np.argmin(scores))]
    mean = share.sum() / (2 * len(SIZES) * np.ptp(POWERS))
    shapes = tuple((float(own), each) for own, each in zip(share / share.max(), curves, strict=True) if own > DRAWN)
    return replace(best, penalty=best.penalty - 2 * float(np.log(mean)), shapes=shapes)
