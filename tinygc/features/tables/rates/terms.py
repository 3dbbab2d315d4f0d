"""The terms of IEEE 1431 (12.9 to 12.11) as rows: value, sigma, and the condition under which they hold; of what does not show, a limit.

Where the output bends, the linear range and what is quoted within it are those of the smooth curve (``curve.py``), whatever the law is
called.  Asymmetry, hysteresis and what does not show are fitted to the readings within the linear range alone: their sizes and sigmas show
what these show, and 95 % of the probability lies below a limit.  What the readings do not determine has no number.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from session.base.texts import significant
from tinygc.features.tables.rates.choice import NOT_SMOOTH, Choice
from tinygc.features.tables.rates.curve import Curve, fit
from tinygc.features.tables.rates.fitting import Fit, over_rate
from tinygc.features.tables.rates.laws import EXTRAS, Hypothesis
from tinygc.features.tables.rates.points import Points

#: departure from the slope at rest that ends the linear range of a law that bends
LINEAR_WITHIN = 0.01
#: normal quantile of an upper limit (95 %) on a term whose sign is not known
LIMIT_95 = 1.96
#: sigmas from which the scale is seen; below, no term is stated in terms of it
FOLLOWS = 3.0
#: rates at which a law is looked at
GRID = 2001
#: step of a difference quotient, in sigmas that a number would have alone
STEP = 0.1


@dataclass(frozen=True)
class TermRow:
    """One row of the report: key and name; value and sigma in ``unit``, None where it does not show; at_most: its upper limit (95 %), None
    where there is a value or the rates do not show the term; condition."""

    key: str
    name: str
    unit: str
    condition: str
    value: float | None = None
    sigma: float | None = None
    at_most: float | None = None


@dataclass(frozen=True)
class Range:
    """The linear range, °/s, and whether each end is the output's: a limit, or a bend of 1 %; else the rates tested end there.  between:
    whether an end lies between rest and the smallest rate, which no reading determines; the range is then to that rate."""

    low: float
    high: float
    ends: tuple[bool, bool]
    between: tuple[bool, bool] = (False, False)

    @property
    def words(self) -> str:
        """``−120 to 120 °/s``."""
        return f"{significant(self.low)} to {significant(self.high)} °/s"


def terms(choice: Choice) -> list[TermRow]:
    """The rows of one sensor."""
    found, points = choice.fit, choice.points
    within = _linear_range(choice.curve or found)
    low, high = (significant(rate, 4) for rate in (points.rate_dps.min(), points.rate_dps.max()))
    tested = f"{len(np.unique(points.distinct))} rates from {low} to {high} °/s"
    unit = points.unit
    outside = "outside the dead band, " if found.hypothesis.law == "dead_band" else ""
    scale, scale_sigma = averaged(choice, lambda law: best_line(law, within)[0])
    rows = [
        _row("scale", "scale factor", (scale, scale_sigma), over_rate(unit, 1), f"best line {outside}within {within.words}"),
        _row("offset", "output at rest", averaged(choice, lambda law: law.offset), unit, _curves_words(points)),
        _row(
            "offset_rate",
            "output at rest, as a rate",
            averaged(choice, lambda law: law.offset / best_line(law, within)[0]),
            "°/s",
            _curves_words(points),
        ),
    ]
    if len(points.curves) > 1:
        rows.append(_drift(found))
    inside = _inside(choice, within)
    rows += _range_rows(choice, within)
    rows.append(_nonlinearity(choice, within, inside))
    rows += _over_all(choice, within)
    rows.append(_asymmetry(choice, within, inside, tested))
    rows.append(_hysteresis(choice, inside, scale))
    rows.append(_dead_band(choice, inside, scale, tested))
    rows += _saturation(found)
    lack = found.lack_of_fit
    if lack is not None:
        known = "stated sigmas" if points.is_known else unit
        uncertain = lack.noise / np.sqrt(2 * lack.freedom)
        rows.append(TermRow("repeats", "scatter of repeats", known, f"{lack.freedom} more than rates", lack.noise, uncertain))
    line = choice.line
    share = 100 * float(np.abs(line.residuals).max() / max(abs(line.coefficients[0]) * np.abs(points.rate_dps).max(), 1e-300))
    rows.append(TermRow("straight_line", "nonlinearity by a straight line", "% of full scale", tested, share))
    if not abs(scale) > FOLLOWS * scale_sigma and np.isfinite(scale_sigma):  # and then nothing over the scale is known
        why = "not measured: the output does not follow the rate"
        over_scale = [row.key for row in rows if row.unit in ("ppm", "°/s", "% of full scale") and not row.key.startswith("linear")]
        rows = [TermRow(row.key, row.name, row.unit, why) if row.key in over_scale else row for row in rows]
    return rows


def averaged(choice: Choice, function: Callable[[Fit], float]) -> tuple[float, float]:
    """A function of the curve, where the law has one, and its sigma; else of the law's numbers, with what rival laws give for it by their
    probabilities, but of a straight line, from which nothing departs beyond chance."""
    if choice.curve is not None:
        return derived(choice.curve, function)
    value, sigma = derived(choice.fit, function)
    if choice.is_line:
        return value, sigma
    total = choice.probability + sum(share for _, share in choice.rivals)
    spread = sum(share / total * (function(rival) - value) ** 2 for rival, share in choice.rivals)
    return value, float(np.sqrt(sigma**2 + spread))


def derived(found: Fit, function: Callable[[Fit], float]) -> tuple[float, float]:
    """A function of a fit's numbers, and its sigma by their covariance, infinite where the points do not determine it; of a curve the
    median over its draws, and half of what holds 68 % of them."""
    if isinstance(found, Curve):
        low, value, high = np.percentile([function(each) for each in found.draws], [16, 50, 84])
        return float(value), float(high - low) / 2
    value = function(found)
    step = STEP * np.sqrt(found.variance) / found.solution.size
    slope = np.array([function(found.moved(found.vector + each)) - function(found.moved(found.vector - each)) for each in np.diag(step)])
    return value, float(np.sqrt(found.solution.variance(slope / (2 * step)) * found.variance))


def _row(key: str, name: str, found: tuple[float, float], unit: str, condition: str) -> TermRow:
    """A row of a value and its sigma; without a number where this is infinite."""
    if not np.isfinite(found[1]):
        return TermRow(key, name, unit, f"not determined by these rates: {condition}")
    return TermRow(key, name, unit, condition, *found)


def _curves_words(points: Points) -> str:
    return "one curve" if len(points.curves) == 1 else f"mean of {len(points.curves)} curves"


def _drift(found: Fit) -> TermRow:
    """Spread of the offsets of several curves, about their mean."""
    key, name, count = "drift", "spread of the output at rest", len(found.offsets)
    value, sigma = derived(found, lambda law: float(law.offsets.std(ddof=1)))
    of_one = float(np.sqrt(np.mean(np.diag(found.covariance)[:count])))
    if value > LIMIT_95 * of_one:
        return TermRow(key, name, found.points.unit, f"{count} curves", value, sigma)
    return TermRow(key, name, found.points.unit, f"{count} curves", at_most=value + LIMIT_95 * of_one)


# The linear range, and the best line within it.


def _linear_range(found: Fit) -> Range:
    """From rest outwards until the output reaches a limit, or departs by 1 % from its slope at rest; at most the rates tested, and where
    one reading that is off leaves an end open, the last sound one."""
    rates = found.points.rate_dps
    ends, sides, between, beyond = [], [], [], left_open(found)
    for end in (min(rates.min(), 0.0), max(rates.max(), 0.0)):
        drawn = [_end(each, float(end)) for each in (found.draws if isinstance(found, Curve) else [found])]
        reached = 2 * sum(before for _, before in drawn) > len(drawn)
        at = float(np.median([each for each, _ in drawn])) if reached else float(end)
        if beyond is not None and beyond[0] * end > 0 and abs(at) > abs(beyond[1]):
            at, reached = beyond[1], False
        smallest = float(np.copysign(np.abs(rates[rates * np.sign(end) > 0]).min(initial=abs(end)), end))
        between.append(reached and abs(at) < abs(smallest))
        sides.append(smallest if between[-1] else at)
        ends.append(reached)
    return Range(sides[0], sides[1], (ends[0], ends[1]), (between[0], between[1]))


def left_open(found: Fit) -> tuple[float, float, float | None] | None:
    """The rate of a reading that is off and has no sound one beyond it or next to it, the last sound rate before it (0 where there is none
    of its sense), and the first at a limit beyond, None where there is none; None where there is no such reading."""
    rates, apart = found.points.rate_dps, found.hypothesis.apart
    if apart < 0 or not (at := float(rates[apart])):
        return None
    outwards, steps, sound = rates * np.sign(at), found.points.distinct * np.sign(at), ~found.is_limited
    sound[apart] = False
    if (steps[sound] >= steps[apart]).any():
        return None
    last, limited = outwards[sound].max(initial=0.0), outwards[found.is_limited & (steps > steps[apart])]
    return at, float(np.copysign(last, at)), float(np.copysign(limited.min(), at)) if len(limited) else None


def _end(found: Fit, end: float) -> tuple[float, bool]:
    """Where the linear range ends towards a rate, and whether it does before it."""
    if not end:
        return 0.0, False
    limit = _input_limit(found, end)
    grid = np.linspace(0.0, end, GRID)[1:]
    step = 1e-3 * end
    free = found.unlimited(np.array([0.0, step, 2 * step]))
    slope = (free[2] - free[1]) / step  # beyond a step at rest
    curve = found.unlimited(grid)
    bent = np.abs(curve - (free[1] - slope * step) - slope * grid) - LINEAR_WITHIN * np.abs(slope * grid)
    bend = _crossing(grid, bent)
    reached = [abs(each) for each in (limit, bend) if each is not None]
    return (float(np.copysign(min(reached), end)), True) if reached else (end, False)


def _input_limit(found: Fit, end: float) -> float | None:
    """The rate towards ``end`` at which the output first reaches a limit; None where it does not."""
    grid = np.linspace(0.0, end, GRID)
    free = found.unlimited(grid) + found.offset
    return _crossing(grid, np.maximum(free - found.limits[1], found.limits[0] - free))


def _crossing(grid: np.ndarray, beyond: np.ndarray) -> float | None:
    """Where values on a grid first exceed zero, between two of its places; None where they do not, or do from the first on."""
    if beyond[0] >= 0 or not (beyond > 0).any():
        return None
    at = int(np.argmax(beyond > 0))
    share = -beyond[at - 1] / (beyond[at] - beyond[at - 1])
    return float(grid[at - 1] + share * (grid[at] - grid[at - 1]))


def best_line(found: Fit, within: Range) -> tuple[float, float]:
    """Slope of the best line over the range, and the largest departure of the law from it, in the output's unit; outside a dead band."""
    if found.hypothesis.law == "dead_band":
        return float(found.coefficients[0]), 0.0
    grid = np.linspace(within.low, within.high, GRID)
    free = found.unlimited(grid)
    slope, constant = np.polyfit(grid, free, 1)
    return float(slope), float(np.abs(free - slope * grid - constant).max())


def _range_rows(choice: Choice, within: Range) -> list[TermRow]:
    found, rows, beyond = choice.curve or choice.fit, [], left_open(choice.fit)
    for n, (key, name, end) in enumerate((("low", "lower", within.low), ("high", "upper", within.high))):
        reached = within.ends[n]
        why = (
            "rates tested end there" if not reached else "limit of the output" if _is_limit(found, end) else "departs by 1 % from its slope"
        )
        sigma = None
        if reached:
            same_end = [(rival, share) for rival, share in choice.rivals if _is_limit(rival, end) == _is_limit(found, end)]
            sigma = averaged(replace(choice, rivals=tuple(same_end)), lambda law, end=end: _end(law, 1.5 * end)[0])[1]  # type: ignore[misc]
        what = f"input limit, {name}" if why.startswith("limit") else f"linear range, {name} end"
        row = TermRow(f"linear_{key}", what, "°/s", why, end, sigma)
        if beyond is not None and (beyond[0] > 0) == (n == 1) and end == beyond[1]:
            at, last, first = beyond
            open_to = f"beyond {significant(last)} °/s" if first is None else f"{significant(last)} to {significant(first)} °/s"
            why = f"not determined, {open_to}: the reading at {significant(at)} °/s is off"
            row = TermRow(f"linear_{key}", f"linear range, {name} end", "°/s", why)
        elif within.between[n]:
            row = TermRow(f"linear_{key}", what, "°/s", f"{why} before {significant(end)} °/s, the smallest rate: not determined")
        elif sigma is not None and not np.isfinite(sigma):
            low, high = sorted((min(ends := [_end(each, 1.5 * end)[0] for each in found.profile]), max(ends)))
            row = TermRow(f"linear_{key}", what, "°/s", f"{why} between {significant(low)} and {significant(high)} °/s: not determined")
        rows.append(row)
    return rows


def _is_limit(found: Fit, end: float) -> bool:
    limit = _input_limit(found, 1.01 * end)
    return limit is not None and abs(limit - end) < 0.01 * abs(end)


# Terms that a law has or has not.


def _inside(choice: Choice, within: Range) -> Points:
    """The points within the linear range, at no limit, without one that is off."""
    points, found = choice.points, choice.fit
    kept = ~found.is_limited & (points.rate_dps >= within.low) & (points.rate_dps <= within.high)
    if found.hypothesis.apart >= 0:
        kept[found.hypothesis.apart] = False
    return points.part(kept)


def _probe(choice: Choice, inside: Points, extra: str, within: Range | None = None) -> tuple[float, float] | None:
    """Coefficient and sigma of a column next to the law of the points inside, a polynomial where it is smooth; of an asymmetry that of the
    best lines of both senses within the range, the law's own included; None where not determined."""
    of, extras = choice.fit.hypothesis, [each for each in choice.fit.hypothesis.extras if each != extra]
    law = "line" if of.law == extra else of.law if of.law in NOT_SMOOTH else "polynomial"
    if within is not None and law == "polynomial":  # a bend that one sense alone has would pull it
        inside = inside.part(np.abs(inside.rate_dps) <= min(-within.low, within.high))
    found = fit(inside, Hypothesis(law, extras=(*extras, extra)))
    if found is None:
        return None
    number = found.names.index(EXTRAS[extra].name, len(found.offsets) + len(found.hypothesis.of.coefficients))
    value, sigma = derived(found, lambda law: float(law.vector[number]) if within is None else _uneven(law, within))
    return (value, sigma) if np.isfinite(sigma) and sigma > 0 else None


def _uneven(found: Fit, within: Range) -> float:
    """Coefficient of |w| next to the best line over the range, as far as it goes in both senses."""
    half = np.linspace(0.0, min(-within.low, within.high), GRID)[1:]
    return float(np.polyfit(half, (found.unlimited(half) + found.unlimited(-half)) / 2, 1)[0])


def _shown(key: str, name: str, value: tuple[float, float] | None, factor: float, unit: str, condition: str, shows: bool) -> TermRow:
    """A row of a term that the law has, where the points inside show it by themselves; else of what does not show: less than x."""
    if value is None:
        return TermRow(key, name, unit, f"{condition}: these rates do not determine it")
    if shows and abs(value[0]) > LIMIT_95 * value[1]:
        return TermRow(key, name, unit, condition, factor * value[0], abs(factor) * value[1])
    return TermRow(key, name, unit, condition, at_most=abs(factor) * (abs(value[0]) + LIMIT_95 * value[1]))


def _nonlinearity(choice: Choice, within: Range, inside: Points) -> TermRow:
    """Largest departure from the best line within the linear range, ppm of its larger end."""
    full = abs(best_line(choice.curve or choice.fit, within)[0]) * max(abs(within.low), abs(within.high))
    condition = f"of {significant(full)} {choice.points.unit}, within {within.words}"
    if any(within.between):
        return TermRow("nonlinearity", "nonlinearity", "ppm", "not determined: the linear range is not")
    if _bends(choice.fit):
        return _row("nonlinearity", "nonlinearity", averaged(choice, lambda law: 1e6 * best_line(law, within)[1] / full), "ppm", condition)
    grid = np.linspace(within.low, within.high, GRID)
    departure = np.abs(grid**3 - np.polyval(np.polyfit(grid, grid**3, 1), grid)).max()
    probed = _probe(choice, inside, "bend")
    return _shown("nonlinearity", "nonlinearity", probed, 1e6 * departure / full, "ppm", f"{condition}, as a cubic", False)


def _over_all(choice: Choice, within: Range) -> list[TermRow]:
    """Departure of a law that bends from its best line over all rates tested, ppm of the larger end; limits of the output aside; none
    where one that is off leaves an end open."""
    rates = choice.points.rate_dps
    tested = Range(float(rates.min()), float(rates.max()), (False, False))
    if not _bends(choice.fit) or left_open(choice.fit) or (tested.low, tested.high) == (within.low, within.high):
        return []
    full = abs(best_line(choice.curve or choice.fit, tested)[0]) * float(np.abs(rates).max())
    name, condition = "nonlinearity over all rates", f"of {significant(full)} {choice.points.unit}, {tested.words}"
    return [_row("nonlinearity_tested", name, averaged(choice, lambda law: 1e6 * best_line(law, tested)[1] / full), "ppm", condition)]


def _bends(found: Fit) -> bool:
    return found.hypothesis.law not in ("line", "asymmetry", "dead_band")


def _asymmetry(choice: Choice, within: Range, inside: Points, tested: str) -> TermRow:
    """Slope of positive less slope of negative rates, ppm of their mean."""
    key, name = "asymmetry", "asymmetry of the scale"
    if not within.low < 0 < within.high:
        return TermRow(key, name, "ppm", f"not measured: one sense only, {tested}")
    scale = best_line(choice.curve or choice.fit, within)[0]
    shows = "a" in choice.fit.names or _bends(choice.fit)
    condition = f"both senses, within ±{significant(min(-within.low, within.high))} °/s"
    if choice.fit.hypothesis.law == "pieces":  # which differ by nothing else, and whose kink the readings inside may not show
        value, sigma = averaged(choice, lambda law: _uneven(law, within))
        probed = (value, sigma) if np.isfinite(sigma) else None
    else:
        probed = _probe(choice, inside, "asymmetry", within)
    return _shown(key, name, probed, 2e6 / scale, "ppm", condition, shows)


def _hysteresis(choice: Choice, inside: Points, scale: float) -> TermRow:
    """Output on the way up less output on the way down at one rate, as a rate."""
    key, name = "hysteresis", "hysteresis"
    both = len(inside.both_ways)
    if both < 2:
        return TermRow(key, name, "°/s", "not measured: the rates go one way; step up and down again")
    condition = f"{both} rates reached from both sides"
    likely = [choice.fit, *(rival for rival, _ in choice.rivals)]
    if all(any(name in each.hypothesis.extras for each in likely) for name in ("hysteresis", "drift")):
        condition += "; a drift cannot be separated from it: step up, down and up again"
    shows = "hysteresis" in choice.fit.hypothesis.extras
    return _shown(key, name, _probe(choice, inside, "hysteresis"), 1 / scale, "°/s", condition, shows)


def _dead_band(choice: Choice, inside: Points, scale: float, tested: str) -> TermRow:
    """Half the width about rest in which the output stays."""
    found, points = choice.fit, choice.points
    if found.hypothesis.law == "dead_band":
        number = found.names.index("d")
        return _row("dead_band", "dead band, ±", averaged(replace(choice, rivals=()), lambda law: law.vector[number]), "°/s", tested)
    smallest = float(np.abs(points.rate_dps[points.rate_dps != 0]).min())
    probed = _probe(choice, inside, "sense")
    return _shown("dead_band", "dead band, ±", probed, 1 / scale, "°/s", f"smallest rate {significant(smallest)} °/s", False)


def _saturation(found: Fit) -> list[TermRow]:
    rows = []
    tops = found.points.output
    for key, name, there, extreme in (
        ("saturation_high", "largest output", found.hypothesis.upper, float(tops.max())),
        ("saturation_low", "smallest output", found.hypothesis.lower, float(tops.min())),
    ):
        if there:
            number = found.names.index("V+" if key == "saturation_high" else "V−")
            value, sigma = float(found.vector[number]), float(np.sqrt(found.covariance[number, number]))
            # At which rate the output comes to a limit
            rates = found.points.rate_dps
            places = [at for end in (rates.min(), rates.max()) if end and (at := _input_limit(found, float(end))) is not None]
            beyond = left_open(found)
            places = [at for at in places if beyond is None or at * beyond[0] < 0 or abs(at) <= abs(beyond[1])]
            of_limit = [at for at in places if abs(float(found.at(np.array([at]))[0]) - value) < 1e-3 * found.points.span]
            alone = ", by one reading whose std is far below all others" if found.is_limited.sum() == 1 else ""
            remark = f"the output's limit{alone}" + "".join(f", reached at {significant(at)} °/s" for at in of_limit)
            rows.append(TermRow(key, f"{name} (saturation)", found.points.unit, remark, value, sigma))
        else:
            rows.append(TermRow(key, f"{name} seen", found.points.unit, "no limit is seen", extreme))
    return rows
