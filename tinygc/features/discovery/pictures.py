"""Plot a law: residuals along its quantity, with the law and its runner-up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from session.base.numeric import rms_of
from session.base.texts import measured
from session.base.units import DEG
from tinygc.effects import Movement
from tinygc.explanation.engine import Explanation
from tinygc.features.discovery.form import Factor
from tinygc.features.discovery.law_fits import (
    LawSeries,
    Pair,
    component_beside,
    component_name,
    curve,
    has_curve,
    main_of,
    other_curve,
    other_of,
    series_of,
    shown_as,
    values_of,
)
from tinygc.features.discovery.result import briefly, headline
from tinygc.features.discovery.search_state import Discovery, Law
from tinygc.features.discovery.words import coefficient_unit, equation
from tinygc.reporting.drawing import Axis, Panel, Picture
from tinygc.reporting.pictures.values import ahead_of, by_samples, moved, one_way, projector, standing, telling

# Residuals of stills and turns: without the law, with it, and with its runner-up.
#
# A still gives a rate.  A turn's closure is projected onto that of a constant rate about one axis; where the law varies within a turn, it
# is projected onto what the law adds to the closure.

#: quantities that hardly vary within a turn
SLOW = ("temperature", "temperature_rate", "time", "vibration", "rest", "sense")
#: share of the other factor's largest level below which a turn cannot be placed along the main quantity
LEVEL = 0.15
#: extension of the points' range, to either side, in which a point is placed on the curve
ROOM = 0.3


@dataclass(frozen=True, eq=False)
class Points:
    """One series of n stills or turns.

    x (n,): of the quantity in its own unit, or the law's value where ``along_law``; without, left, other_left (n,): the residual without
    the law, with it, and with the runner-up in its place, None where there is none; sigma (n,) of noise; level (n,): of the second factor,
    None where there is none.  In dps, or in degrees of closure for turns drawn along the law.
    """

    series: LawSeries
    x: np.ndarray
    without: np.ndarray
    left: np.ndarray
    other_left: np.ndarray | None
    sigma: np.ndarray
    level: np.ndarray | None
    along_law: bool
    still: bool

    @property
    def other_says(self) -> np.ndarray | None:
        """(n,) the runner-up's values, with its change of the calibration."""
        return None if self.other_left is None else self.without - self.other_left

    def some(self, keep: np.ndarray) -> Points:
        """The points of a mask (n,)."""
        values = {name: getattr(self, name) for name in ("x", "without", "left", "other_left", "sigma", "level")}
        kept: dict[str, Any] = {name: None if each is None else each[keep] for name, each in values.items()}
        return replace(self, **kept)


def of_stills(e: Explanation, pair: Pair, series: LawSeries) -> Points:
    """Points of the stills' mean rates, dps."""
    law, other, form = pair.own, pair.other, pair.law.form
    entries, movements = list(series.entries), moved(e.twin, law.replay)

    def mean(of: Callable[[Movement], np.ndarray]) -> np.ndarray:
        by_log = [of(movement) for movement in movements]
        return np.array([by_log[log][still.start : still.stop].mean() for log, still in e.twin.stills])

    said = law.adds.still[:, series.axis][:, entries] @ law.theta[entries]
    left = law.left.still[:, series.axis]
    other_left = None if other is None else other.left.still[:, series.axis] / DEG
    sigma = law.whiten.sigma[law.whiten.parts["still"]].reshape(-1, 3)[:, series.axis]
    along = not has_curve(form)
    level = None if along else _level(pair, series, mean)
    x = said / DEG if along else mean(lambda movement: values_of(main_of(form), movement, series.component))
    if not along and level is None:
        x = _placed(pair, series, x, said, np.ones(len(x), dtype=bool))
    return Points(series, x, (said + left) / DEG, left / DEG, other_left, sigma / DEG, level, along, still=True)


def of_turns(e: Explanation, pair: Pair, series: LawSeries) -> Points:
    """Points of the turns: dps about the axis, or degrees along the law's closure."""
    law, other, form = pair.own, pair.other, pair.law.form
    entries, beside = list(series.entries), other_of(form)
    said = law.adds.closure[:, :, entries] @ law.theta[entries]
    angles = [said + law.left.closure, law.left.closure, *([] if other is None else [other.left.closure])]
    if not has_curve(form) or (beside is not None and beside.quantity not in SLOW):
        return _along_law(series, said, angles, e.twin.problem.floor.sigma)
    share, weight, sigma = projector(law.replay.sensitivity[:, :, :, series.axis], e.twin.problem.floor.sigma)
    movements = moved(e.twin, law.replay)

    def sampled(of: Callable[[Movement], np.ndarray]) -> np.ndarray:
        return by_samples(e.twin, [of(movement) for movement in movements])

    along = sampled(lambda movement: values_of(main_of(form), movement, series.component))
    x = np.sum(weight * along, axis=1)
    level = _level(pair, series, lambda of: np.sum(weight * sampled(of), axis=1))
    keep = telling(sigma) & np.isfinite(x) & one_way(weight, along, x)
    asked = np.einsum("sd,sd->s", share, said)
    if level is not None:
        strong = np.abs(level) > LEVEL * np.max(np.abs(level), initial=0.0)
        keep &= strong
        asked = np.divide(asked, level, out=np.zeros_like(level), where=strong)
    x = _placed(pair, series, x, asked, keep)
    without, left, *more = (np.einsum("sd,sd->s", share, each) / DEG for each in angles)
    return Points(series, x, without, left, more[0] if more else None, sigma / DEG, level, along_law=False, still=False).some(keep)


def _along_law(series: LawSeries, said: np.ndarray, angles: list[np.ndarray], sigma: np.ndarray) -> Points:
    """Each turn along the direction in which the law moves its closure: a line of slope one, if the law is the cause."""
    law, (without, left, *more), noise = (np.divide(each, DEG) for each in ahead_of(said, angles, sigma))
    other = more[0] if more else None
    return Points(series, law, without, left, other, noise, None, along_law=True, still=False).some(law != 0)


def _level(pair: Pair, series: LawSeries, mean: Callable[[Callable[[Movement], np.ndarray]], np.ndarray]) -> np.ndarray | None:
    """(n,) of the second factor through its function, in the series' first term; None where there is none."""
    form = pair.law.form
    beside: Factor | None = other_of(form)
    if beside is None:
        return None
    component = component_beside(form, series)
    return mean(lambda movement: beside.values(movement)[:, component])


def _placed(pair: Pair, series: LawSeries, x: np.ndarray, said: np.ndarray, keep: np.ndarray) -> np.ndarray:
    """(n,) where the curve has the law's value, on the same side of zero as x; x itself where the curve does not determine it."""
    low, high = (x[keep].min(), x[keep].max()) if keep.any() else (0.0, 0.0)
    room, theta = ROOM * (high - low), pair.own.theta[list(series.entries)]
    return standing(x, said, lambda at: curve(main_of(pair.law.form), at, theta), np.array([low - room, high + room]))


# Two panels of a law: residuals along its quantity with the law and its runner-up, and the residuals of each.

#: colours of the series of a panel
COLOURS = ("x", "y", "z")
#: functions whose constant is a place along their quantity
EDGED = ("dead_zone", "excess", "within", "beyond", "signed_beyond", "above", "hinge", "band")
#: points of a curve
POINTS = 400
#: quantiles of a second factor's levels at which the law is drawn, and among which its points are parted
QUANTILES = (0.1, 0.5, 0.9)


def draw_pair(e: Explanation, pair: Pair, points: list[Points]) -> tuple[Panel, Panel]:
    """Draw one row of the page."""
    law, own, where = pair.law, pair.own, "in each still" if points[0].still else "of each turn"
    times, words, unit = shown_as(main_of(law.form), e.twin.movements[0])
    along = points[0].along_law
    one = 1e3 if not along or points[0].still else 1.0
    y_unit, what = ("mdps", "rate") if one == 1e3 else ("°", "closure")
    times = one if along else times
    components = {each.series.component for each in points}
    which = component_name(main_of(law.form), next(iter(components))) if len(components) == 1 else "the axis"
    label = f"what the law says ({y_unit})" if along else f"{words.format(i=which)} ({unit})"
    left = Panel(Axis(label), Axis(f"{what} {where} without the law ({y_unit})"), f"Without the law: {what} {where}").zero()
    right = Panel(Axis(label), Axis(f"{what} that is left ({y_unit})"), _what_is_left(points)).zero()
    series = (
        _by_level(law, points[0])
        if points[0].level is not None
        else [(each, _name(law, each.series), _number(law, each.series)) for each in points]
    )
    for (each, name, number), kind in zip(series, COLOURS, strict=False):
        left.points(each.x * times, each.without * one, kind, sigma=each.sigma * one, name=name + number)
        right.points(each.x * times, each.left * one, kind, sigma=each.sigma * one, name=f"{name}, with the law")
        if not along:
            at = np.linspace(*_span(each.x), POINTS)
            said = curve(main_of(law.form), at, own.theta[list(each.series.entries)]) / DEG
            height = 1.0 if each.level is None else float(np.median(each.level))
            left.line(at * times, said * height * one, kind, name=name + number, is_measure=False)
    if along:
        low, high = _span(np.concatenate([each.x for each in points]))
        left.line([low * times, high * times], [low * one, high * one], "ink", name="what the law says, slope 1", is_measure=False)
    else:
        _edges(law, points, times, unit, left)
    _runner_up(e, pair, points, times, one, left, right)
    return left, right


def _by_level(law: Law, points: Points) -> list[tuple[Points, str, str]]:
    """One series of a law of two quantities, parted by the level of the second, with the law at each part's middle level."""
    other = other_of(law.form)
    assert other is not None
    assert points.level is not None
    # The second quantity through its function, with its unit
    component = component_beside(law.form, points.series)
    symbol = other.of.symbol.format(i=component_name(other, component // other.through.phases))
    shown = other.through.shown.format(x=symbol, c="" if other.constant is None else f"{other.constant:.3g}")
    unit = f" {other.of.unit}" if other.through.name == "itself" and other.of.unit != "1" else ""
    centres = np.quantile(points.level, QUANTILES)
    nearest = np.argmin(np.abs(points.level[:, None] - centres), axis=1)
    parts = [(points.some(nearest == n), float(np.median(points.level[nearest == n]))) for n in np.unique(nearest)]
    return [(part, f"{_name(law, part.series)} at {shown} of {level:.3g}{unit}", "") for part, level in parts]


def _name(law: Law, series: LawSeries) -> str:
    """The axis, and what it follows where that is another: ``x from y``, ``x from y and z``."""
    own, other = "xyz"[series.axis], other_of(law.form)
    parts = [component_name(main_of(law.form), series.component)]
    if other is not None and len(series.entries) == 1:
        beside = component_beside(law.form, series)
        parts.append(component_name(other, beside // other.through.phases))
    follows = list(dict.fromkeys(part for part in parts if part))
    return own + (f" from {' and '.join(follows)}" if follows not in ([], [own]) else "")


def _number(law: Law, series: LawSeries) -> str:
    """The coefficient with its sigma as on the page, where the series has one."""
    if len(series.entries) != 1:
        return ""
    entry, (unit, _) = series.entries[0], coefficient_unit(law.form)
    sigma = np.sqrt(law.covariance[entry, entry])
    return f": {measured(law.theta[entry] / DEG, sigma / DEG)} {unit}"


def _edges(law: Law, points: list[Points], times: float, unit: str, panel: Panel) -> None:
    """Draw dashed lines where the law begins or ends, within the range of the points."""
    main = main_of(law.form)
    if main.function not in EDGED or main.constant is None:
        return
    low, high = _span(np.concatenate([each.x for each in points]))
    both = main.function not in ("above", "hinge") and low < 0
    name = f"{main.through.constant} {'±' if both else ''}{main.constant * times:.3g} {unit}"
    for edge in (main.constant, -main.constant) if both else (main.constant,):
        if low <= edge <= high:
            panel.upright(edge * times, name=name)


def _runner_up(e: Explanation, pair: Pair, points: list[Points], times: float, one: float, left: Panel, right: Panel) -> None:
    """Draw the runner-up with its own calibration: a ring at each turn or still, and for stills a dashed curve."""
    own, other = pair.own, pair.other
    if other is None:
        return
    # A turn's movement is not constant, and where an axis follows several components no curve along one is complete.
    single = len({each.axis for each in series_of(pair.law.form)}) == len(series_of(pair.law.form))
    dashed = points[0].still and single and points[0].level is None and not points[0].along_law
    for each, kind in zip(points, COLOURS, strict=False):
        if each.other_says is None or each.other_left is None:
            continue
        kind = kind if each.level is None else "ink"
        left.points(each.x * times, each.other_says * one, kind, ring=True, name="what the runner-up says")
        right.points(each.x * times, each.other_left * one, kind, ring=True, name="with the runner-up")
        if dashed and (said := other_curve(e, own, other, each.series)) is not None:
            at = np.linspace(*_span(each.x), POINTS)
            left.line(at * times, said(at) / DEG * one, kind, "dash", is_measure=False)


def _what_is_left(points: list[Points]) -> str:
    def rms(values: list[np.ndarray]) -> float:
        return rms_of(np.concatenate(values))

    words = f"What is left: {rms([each.left / each.sigma for each in points]):.2g} sigmas rms with the law"
    others = [each.other_left / each.sigma for each in points if each.other_left is not None]
    return f"{words}, {rms(others):.2g} with the runner-up" if others else words


def _span(values: np.ndarray) -> tuple[float, float]:
    low, high = float(np.min(values)), float(np.max(values))
    room = 0.03 * max(high - low, 1e-12)
    return (low - room if low < 0 else max(low - room, 0.0)), high + room  # a quantity without a sign stays positive


# ``explain/discover.svg``: residuals against the law's quantity, with the law and its runner-up.

#: share of a law's chi-square above which a channel has its own row
SHARE = 0.15
#: series in one panel
MOST_SERIES = 3


def picture_of(e: Explanation, discovery: Discovery, pairs: list[Pair]) -> Picture:
    """The picture, for an answer with laws."""
    title, _ = headline(discovery.verdict, any(law.runners_up for law in discovery.laws))
    panels = [panel for pair in pairs for points in _rows(e, pair) for panel in draw_pair(e, pair, points)]
    return Picture(panels, f"{e.session.name}: {title}", [_words(pair.law) for pair in pairs])


def _words(law: Law) -> str:
    beside = f"      runner-up:  {briefly(law.runners_up[0].effect.equation)}" if law.runners_up else ""
    return f"{law.effect.id}:  {equation(law.form)}{beside}"


def _rows(e: Explanation, pair: Pair) -> list[list[Points]]:
    """The series of each channel with evidence for the law."""
    # Chi-square of the law's prediction, by channel
    said = pair.own.whiten.by_channel(pair.own.whiten(pair.own.adds.stacked() @ pair.own.theta))
    power, found = {name: float(np.sum(said[part] ** 2)) for name, part in pair.own.whiten.parts.items()}, []
    for channel, of in (("closure", of_turns), ("still", of_stills)):
        if power[channel] < SHARE * sum(power.values()):
            continue
        points = [of(e, pair, series) for series in series_of(pair.law.form)]
        points = [each for each in points if len(each.x)]
        if not points:
            continue
        strength = [float(np.sum(((each.without - each.left) / each.sigma) ** 2)) for each in points]
        most = 1 if points[0].level is not None else MOST_SERIES
        found.append([points[number] for number in sorted(np.argsort(strength)[::-1][:most])])
    return found
