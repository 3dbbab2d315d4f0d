"""Which law the points follow: chance first, then evidence among all laws; what other curves show of it.

Chance: the straight line is given up only where the best of many departures from it removes more of the residuals than it does of pure
noise on the same rates in 95 of 100 tables.  This holds whatever the size of the noise is, which the residuals alone may have to state.

Evidence: that of ``tinygc.inference.choose.of_any_scale``; stated sigmas count for ``STATED_FREEDOM`` readings, and the prior of a number
is as wide as what a straight line leaves.  In addition, -2 log: 2 ln M, M the number of laws, of one that is no line; of kinds of limits,
of one that has any; and of readings, of one that leaves one of them apart.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from session.base.errors import DataError
from session.base.numeric import rms_of
from session.base.texts import printable
from tinygc.features.tables.rates.curve import Curve, fit, fit_curve
from tinygc.features.tables.rates.fitting import PLATEAUS, Fit
from tinygc.features.tables.rates.laws import COMPETING, CURVE, LAWS, LIMITS, Hypothesis
from tinygc.features.tables.rates.points import Points
from tinygc.inference.choose import LEVEL, Selection, of_any_scale, weights_of

#: seed of the tables of pure noise
SEED = 1
#: a law this much less probable than the best is no rival
RIVAL = 0.05
#: -2 log evidence that a further extra must gain, in addition its price
_EXTRA_GAIN = 2 * np.log(len(COMPETING) / LEVEL)
#: passes between the offset of a curve and which of its points lie at a limit
OFFSET_PASSES = 20
LINE = Hypothesis("line")
#: a limit at a single reading is one where its std is below this share of all others: the noise of a sensor passes through no rail
RAIL = 0.1
#: rates at which a departure may begin
MOST_PLACES = 60
#: laws without a bend, or with a kink
NOT_SMOOTH = ("line", "asymmetry", "dead_band", "pieces")
#: laws that a held-out table shows next to the chosen one
COMPARED = (LINE, Hypothesis("cubic"), Hypothesis("line", True, True), Hypothesis("sine"), Hypothesis("sine", True, True))


@dataclass(frozen=True)
class HeldOut:
    """A curve that a law was not fitted to: hypothesis; curve; what it was fitted to, empty for all other curves; rms of what it leaves
    there; how many rates lie beyond those fitted, and rms of the others."""

    hypothesis: str
    curve: str
    fitted_to: str
    points: int
    rms: float
    beyond: int
    within_rms: float


@dataclass(frozen=True, eq=False)
class Choice:
    """What the points of one sensor follow.

    fit: the chosen law; line: the straight line over all points; p_value: that noise on a straight line is as far from it; rivals: other
    laws with their probabilities, the likeliest first; fits: of all hypotheses, with their -2 log evidence.
    """

    points: Points
    fit: Fit
    line: Fit
    p_value: float
    rivals: tuple[tuple[Fit, float], ...]
    probability: float
    fits: tuple[tuple[Fit, float], ...]

    @property
    def is_line(self) -> bool:
        """Whether a straight line is all that the points show."""
        return self.fit.hypothesis == LINE

    @cached_property
    def curve(self) -> Curve | None:
        """The smooth curve with the chosen law's limits and extras, of which a range's figures are; None of a law not smooth."""
        if self.fit.hypothesis.law in NOT_SMOOTH:
            return None
        return self.fit if isinstance(self.fit, Curve) else fit_curve(self.points, replace(self.fit.hypothesis, law=CURVE))

    @cached_property
    def held_out(self) -> tuple[HeldOut, ...]:
        """Each curve predicted from the other curves, and from the widest one alone, by the chosen law and by simpler ones."""
        if len(self.points.curves) < 2:
            return ()
        points, count = self.points, len(self.points.curves)
        hypotheses = list(dict.fromkeys([*COMPARED, self.fit.hypothesis]))
        widest = int(points.curve[np.argmax(np.abs(points.rate_dps))])
        found = [held_out(points, which, n) for which in hypotheses for n in range(count)]
        found += [held_out(points, which, n, [widest]) for which in hypotheses for n in range(count) if n != widest and count > 2]
        return tuple(one for one in found if one is not None)


def choose(points: Points) -> Choice:
    """Choose the law of one sensor's points.  Raises DataError where not even a straight line is determined."""
    line = fit(points, LINE)
    if line is None:
        raise DataError(
            f"{printable(points.sensor)}: {len(points)} points on {len(points.curves)} curves do not determine a line and its noise; "
            "measure more rates on each curve"
        )
    ends = [_may_be_limited(points, side) for side in (-1.0, 1.0)]
    hypotheses = [
        Hypothesis(law, *limits)
        for law in LAWS
        for limits in LIMITS
        if law == LINE.law or all(may or not there for may, there in zip(ends, limits, strict=True))
    ]
    hypotheses += [Hypothesis("line", extras=(name,)) for name in COMPETING if name not in LAWS and _may_have(points, LINE, name)]
    fits = [found for each in hypotheses if (found := fit(points, each)) is not None and _shows_limits(found)]
    # A line within any limits, but for one reading: what a law with a bend at that reading would be, which it alone shows.
    more = [
        replace(each.hypothesis, apart=_farthest(each)) for each in fits if each.hypothesis.law == LINE.law and not each.hypothesis.extras
    ]
    more.append(replace(min(fits, key=lambda each: score(each, line.squares)).hypothesis, law=CURVE))
    fits += [found for each in more if (found := fit(points, each)) is not None and _shows_limits(found)]
    scored = sorted(
        ((found, score(found, line.squares) + _EXTRA_GAIN * (found.hypothesis.apart >= 0)) for found in fits), key=lambda each: each[1]
    )
    p_value = chance(points)
    others = [each for each in scored if each[0].hypothesis != LINE]
    if p_value > LEVEL or not others:
        scored.sort(key=lambda each: (each[0].hypothesis != LINE, each[1]))
    else:
        scored = [*_with_extras(points, others, line.squares), *(each for each in scored if each[0].hypothesis == LINE)]
    best = scored[0]
    shares = weights_of([max(score, best[1]) for _, score in scored])
    rivals = [(found, float(share)) for (found, _), share in zip(scored[1:], shares[1:], strict=True) if share > RIVAL * shares[0]]
    rivals.sort(key=lambda each: -each[1])
    return Choice(points, best[0], line, p_value, tuple(rivals), float(shares[0]), tuple(scored))


def _may_be_limited(points: Points, side: float) -> bool:
    """Whether the output may have a limit at one end that a law which bends does not need: a plateau, or an extreme at no extreme rate."""
    output = side * points.output
    highest = output >= output.max() - PLATEAUS[-1] * points.span
    rates = np.unique(points.distinct[highest])
    return len(rates) > 1 or rates[0] not in (points.distinct.min(), points.distinct.max())


def _with_extras(points: Points, scored: list[tuple[Fit, float]], width: float) -> list[tuple[Fit, float]]:
    """The hypotheses, and the best of them with what else it needs."""
    found = list(scored)
    for _ in COMPETING:
        best, have = found[0]
        of = best.hypothesis
        more = [replace(of, extras=(*of.extras, name)) for name in COMPETING if _may_have(points, of, name)]
        if of.apart < 0:
            more.append(replace(of, apart=_farthest(best)))
        fits = [each for hypothesis in more if (each := fit(points, hypothesis)) is not None and _shows_limits(each)]
        tried = sorted(((each, score(each, width) + _EXTRA_GAIN) for each in fits), key=lambda each: each[1])
        if not tried or tried[0][1] >= have:
            break
        found = [*tried, *found]
    return found


def _may_have(points: Points, hypothesis: Hypothesis, extra: str) -> bool:
    """Whether an extra is none of the law's own, and seen by these rates: hysteresis and drift where they go both ways."""
    if extra in ("hysteresis", "drift") and len(points.both_ways) < 2:
        return False
    return extra not in hypothesis.extras and not (extra == "asymmetry" and hypothesis.law in ("asymmetry", "pieces"))


def _farthest(found: Fit) -> int:
    """Row of the reading without which a fit leaves least."""
    leverage = np.einsum("ij,jk,ik->i", found.jacobian, found.solution.spread, found.jacobian)
    return int(np.argmax((found.residuals / found.points.weight) ** 2 / np.maximum(1 - leverage, 1e-9)))


def _shows_limits(found: Fit) -> bool:
    """Whether two readings lie at the limits, or one whose std is far below all others; one alone may be a reading that is off."""
    limited, std = found.is_limited, found.points.std
    if limited.sum() != 1:
        return True
    return bool(np.isfinite(std).all() and std[limited].max() < RAIL * std[~limited].min())


def score(found: Fit, width: float) -> float:
    """-2 log evidence; width: squares that the straight line leaves."""
    points, of = found.points, found.hypothesis
    price = 2 * np.log(len(LAWS)) * (of.law != LINE.law or bool(of.extras)) + 2 * np.log(len(LIMITS)) * (of.lower or of.upper)
    price += 2 * np.log(len(points)) * (of.apart >= 0)
    return float(of_any_scale(found.squares + points.stated, found.freedom, found.parameters, width) + price + found.penalty)


# Chance: departures from a straight line as columns, of which the best is held against the best of pure noise.


def departures(points: Points) -> list[np.ndarray]:
    """(N, 1 or 2) columns of every kind of departure from a line that the laws can make, at places of their own."""
    rate = points.rate_dps
    u = rate / np.abs(rate).max()
    sizes, places = (
        _thinned(np.unique(np.abs(points.distinct) / np.abs(rate).max())),
        _thinned(np.unique(points.distinct) / np.abs(rate).max()),
    )
    found = [u**2, u**3, np.abs(u), (rate != 0).astype(float), np.sign(u)]
    found += [points.direction, points.order] if len(points.both_ways) > 1 else []
    found += [np.maximum(u - place, 0.0) for place in places[1:-1]]
    found += [np.clip(u, -size, size) for size in sizes[:-1] if size]
    pairs = [np.stack([u**2, u**3], axis=1), np.stack([u**3, u**5], axis=1)]
    pairs += [np.stack([np.maximum(u - size, 0.0), np.maximum(-u - size, 0.0)], axis=1) for size in sizes[:-1] if size]
    return [column[:, None] for column in found] + pairs


def _thinned(places: np.ndarray) -> np.ndarray:
    """At most ``MOST_PLACES`` of them, the ends included."""
    return places[np.unique(np.linspace(0, len(places) - 1, min(len(places), MOST_PLACES)).round().astype(int))]


def chance(points: Points) -> float:
    """Probability that pure noise on a straight line departs from it as clearly as these points do."""
    sigma = points.weight
    nuisance = np.column_stack([np.eye(len(points.curves))[points.curve], points.rate_dps]) / sigma[:, None]
    stated = points.stated
    repeats = len(points) / len(np.unique(points.distinct))  # which rounding moves alike
    columns = dict(enumerate(each / sigma[:, None] for each in departures(points)))
    return Selection(nuisance, columns, SEED, further=(stated + repeats * points.floor, stated)).p_value(points.output / sigma)


# The other curves.


def held_out(points: Points, hypothesis: Hypothesis, curve: int, fitted: Sequence[int] | None = None) -> HeldOut | None:
    """A law fitted to other curves (all but this one by default), on this one, whose offset alone is free, by the rates within theirs.

    None where the others do not determine the law; without its limits where none of them reaches these.
    """
    hypothesis = replace(hypothesis, apart=-1)
    numbers = [n for n in range(len(points.curves)) if n != curve] if fitted is None else list(fitted)
    others = points.part(np.isin(points.curve, numbers))
    found = fit(others, hypothesis) or fit(others, replace(hypothesis, lower=False, upper=False))
    if found is None:
        return None
    here = points.part(points.curve == curve)
    beyond = np.abs(here.rate_dps) > np.abs(others.rate_dps).max()
    free, offset = found.unlimited(here.rate_dps, here), found.offset
    for _ in range(OFFSET_PASSES):
        predicted = np.clip(free + offset, *found.limits)
        inside = (predicted > found.limits[0]) & (predicted < found.limits[1]) & ~beyond
        if not inside.any():
            break
        offset += float(np.mean((here.output - predicted)[inside]))
    residuals = here.output - np.clip(free + offset, *found.limits)
    within = rms_of(residuals[~beyond]) if (~beyond).any() else float("nan")
    rms = rms_of(residuals)
    words = "" if fitted is None else "the widest curve alone"
    return HeldOut(hypothesis.name, points.curves[curve], words, len(here), rms, int(beyond.sum()), within)
