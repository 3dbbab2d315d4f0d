"""Two panels of a law: the remainder along its quantity, with the law and its runner-up, and what each of them leaves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from session.common.units import DEG
from tinygc.discovery.judge.answer import Law
from tinygc.discovery.told import said
from tinygc.discovery.told.fits import Fitted, Pair
from tinygc.discovery.told.other_curve import other_curve
from tinygc.discovery.told.points import Points
from tinygc.discovery.told.series import Series, component_beside, component_name, curve, main_of, other_of, series_of, shown_as
from tinygc.explanation.pictures.panels.palette import AXES, FLOOR
from tinygc.explanation.pictures.panels.words import legend, plain
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: matplotlib's, left and right
Sides = tuple[Any, Any]

COLOURS = tuple(AXES.values())
#: functions whose constant is a place along their quantity
EDGED = ("dead_zone", "excess", "within", "beyond", "signed_beyond", "above", "hinge", "band")
#: of the runner-up, which has one colour for all axes
OTHER = "#555555"
#: points of a curve
POINTS = 400
#: of the levels of a second factor, at which the law is drawn
QUANTILES = (0.1, 0.5, 0.9)


def draw_pair(e: Explanation, pair: Pair, points: list[Points], left: Axes, right: Axes) -> None:
    """One row of the page."""
    law, own, where = pair.law, pair.own, "in each still" if points[0].still else "of each turn"
    movement = e.twin.movements[0]
    times, words, unit = shown_as(main_of(law.form), movement)
    along = points[0].along_law
    one = 1e3 if not along or points[0].still else 1.0
    y_unit = "mdps" if one == 1e3 else "°"
    times = one if along else times
    what = "rate" if one == 1e3 else "closure"
    components = {each.series.component for each in points}
    which = component_name(main_of(law.form), next(iter(components))) if len(components) == 1 else "the axis"
    x_label = f"what the law says ({y_unit})" if along else f"{words.format(i=which)} ({unit})"
    names = [_name(law, each.series) for each in points]
    level = points[0].level
    for axes in (left, right):
        axes.axhline(0, color=FLOOR, lw=0.8)
    if level is None:
        for name, each, colour in zip(names, points, COLOURS, strict=False):
            _errorbars(left, each.x * times, each.without * one, each.sigma * one, colour)
            _errorbars(right, each.x * times, each.left * one, each.sigma * one, colour)
            left.plot([], [], "o-", ms=4, color=colour, label=f"{name}{_number(law, each.series)}")
            right.plot([], [], "o", ms=4, color=colour, label=f"{name}, with the law")
    else:
        _levels(e, law, own, points[0], times, one, left, right)
    _laws(law, own, points, times, one, left)
    if not along:
        _edges(law, points, times, unit, left)
    _runner_up(e, pair, points, times, one, (left, right))
    _fit_in(left, [each.without * one for each in points])
    _fit_in(right, [each.left * one for each in points] + [each.other_left * one for each in points if each.other_left is not None])
    left.set(xlabel=x_label, ylabel=f"{what} {where} without the law ({y_unit})", title=f"Without the law: {what} {where}")
    right.set(xlabel=x_label, ylabel=f"{what} that is left ({y_unit})", title=_what_is_left(points))
    for axes in (left, right):
        legend(axes)


def _name(law: Law, series: Series) -> str:
    """The axis, and what it follows where that is another: ``x from y``, ``x from y and z``."""
    own, other = "xyz"[series.axis], other_of(law.form)
    parts = [component_name(main_of(law.form), series.component)]
    if other is not None and len(series.entries) == 1:
        beside = component_beside(law.form, law.form.terms()[series.entries[0]])
        parts.append(component_name(other, beside // other.through.phases))
    follows = list(dict.fromkeys(part for part in parts if part))
    return own + (f" from {' and '.join(follows)}" if follows not in ([], [own]) else "")


def _number(law: Law, series: Series) -> str:
    """The coefficient with its sigma, as the page says it, where the series has one."""
    if len(series.entries) != 1:
        return ""
    entry, (unit, _) = series.entries[0], said.unit_of(law.form)
    sigma = np.sqrt(law.covariance[entry, entry])
    return f": {plain(law.theta[entry] / DEG, sigma / DEG)} {unit}"


def _errorbars(axes: Axes, x: np.ndarray, y: np.ndarray, sigma: np.ndarray, colour: str) -> None:
    """Pale where they are uncertain."""
    alpha = np.clip(2 * sigma.min(initial=np.inf) / sigma, 0.15, 1)
    for at, value, spread, strength in zip(x, y, sigma, alpha, strict=True):
        axes.errorbar(at, value, spread, fmt="o", ms=4, lw=0.8, color=colour, alpha=strength)


def _laws(law: Law, own: Fitted, points: list[Points], times: float, one: float, axes: Axes) -> None:
    """The law through the points: a curve along the quantity, or the line of slope one."""
    if points[0].level is not None:
        return
    if points[0].along_law:
        low, high = _span(np.concatenate([each.x for each in points]))
        axes.plot([low * times, high * times], [low * one, high * one], "-", color="black", lw=1.5, label="what the law says, slope 1")
        return
    for each, colour in zip(points, COLOURS, strict=False):
        at = np.linspace(*_span(each.x), POINTS)
        said = curve(main_of(law.form), at, own.theta[list(each.series.entries)]) / DEG
        axes.plot(at * times, said * one, color=colour, lw=1.8)


def _edges(law: Law, points: list[Points], times: float, unit: str, axes: Axes) -> None:
    """Where the law begins or ends, dotted, as far as the points reach."""
    main = main_of(law.form)
    if main.function not in EDGED or main.constant is None:
        return
    low, high = _span(np.concatenate([each.x for each in points]))
    both = main.function not in ("above", "hinge") and low < 0
    label = f"{main.through.constant} {'±' if both else ''}{main.constant * times:.3g} {unit}"
    for edge in (main.constant, -main.constant) if both else (main.constant,):
        if low <= edge <= high:
            axes.axvline(edge * times, ls=":", lw=1.0, color=FLOOR, label=label, zorder=0)
            label = "_"  # said once


def _levels(e: Explanation, law: Law, own: Fitted, points: Points, times: float, one: float, left: Axes, right: Axes) -> None:
    """One series of a law of two quantities: colours are the level of the second."""
    assert points.level is not None
    other = other_of(law.form)
    assert other is not None
    from matplotlib import colormaps
    from matplotlib.colors import Normalize

    scale, colours = Normalize(*_span(points.level)), colormaps["viridis"]
    for axes, values in ((left, points.without), (right, points.left)):
        axes.errorbar(points.x * times, values * one, points.sigma * one, fmt="none", lw=0.8, color=FLOOR, zorder=1)
        drawn = axes.scatter(points.x * times, values * one, c=points.level, cmap=colours, norm=scale, s=26, zorder=2)
    right.figure.colorbar(drawn, ax=right, label=_level_words(law, points.series))
    at = np.linspace(*_span(points.x), POINTS)
    said = curve(main_of(law.form), at, own.theta[list(points.series.entries)]) / DEG
    for level in np.quantile(points.level, QUANTILES):
        left.plot(at * times, level * said * one, color=colours(scale(level)), lw=1.8, label=f"law at {level:.3g}")
    right.plot([], [], "o", color=colours(0.5), label=f"{_name(law, points.series)}, with the law")


def _level_words(law: Law, series: Series) -> str:
    """The second quantity through its function, with its unit."""
    other = other_of(law.form)
    assert other is not None
    component = component_beside(law.form, law.form.terms()[series.entries[0]])
    symbol = other.of.symbol.format(i=component_name(other, component // other.through.phases))
    constant = "" if other.constant is None else f"{other.constant:.3g}"
    shown = other.through.shown.format(x=symbol, c=constant)
    return f"{shown} ({other.of.unit})" if other.through.name == "itself" and other.of.unit != "1" else shown


def _runner_up(e: Explanation, pair: Pair, points: list[Points], times: float, one: float, axes: Sides) -> None:
    """A diamond for what it says of each turn or still, its own calibration beside it; in stills a dashed curve as well."""
    own, other = pair.own, pair.other
    if other is None:
        return
    left, right = axes
    # A turn is no constant movement, and where an axis follows several components no curve along one says it all.
    single = len({each.axis for each in series_of(pair.law.form)}) == len(series_of(pair.law.form))
    dashed = points[0].still and single and points[0].level is None and not points[0].along_law
    for each, colour in zip(points, COLOURS, strict=False):
        if each.other_says is None or each.other_left is None:
            continue
        drawn = {"mfc": "none", "color": colour if each.level is None else OTHER, "ms": 6, "alpha": 0.75}
        left.plot(each.x * times, each.other_says * one, "D", **drawn)
        right.plot(each.x * times, each.other_left * one, "D", **drawn)
        if dashed and (said := other_curve(e, own, other, each.series)) is not None:
            at = np.linspace(*_span(each.x), POINTS)
            left.plot(at * times, said(at) / DEG * one, "--", color=drawn["color"], lw=1.2)
    left.plot([], [], "D--" if dashed else "D", mfc="none", color=OTHER, label="what the runner-up says")
    right.plot([], [], "D", mfc="none", color=OTHER, label="with the runner-up")


def _what_is_left(points: list[Points]) -> str:
    def rms(values: list[np.ndarray]) -> float:
        return float(np.sqrt(np.mean(np.concatenate(values) ** 2)))

    words = f"What is left: {rms([each.left / each.sigma for each in points]):.2g} sigmas rms with the law"
    others = [each.other_left / each.sigma for each in points if each.other_left is not None]
    return f"{words}, {rms(others):.2g} with the runner-up" if others else words


def _span(values: np.ndarray) -> tuple[float, float]:
    low, high = float(np.min(values)), float(np.max(values))
    room = 0.03 * max(high - low, 1e-12)
    return (low - room if low < 0 else max(low - room, 0.0)), high + room  # what has no sign gets none


def _fit_in(axes: Axes, values: list[np.ndarray]) -> None:
    """All values, zero, and some room: not what a curve does beyond the points."""
    low, high = _span(np.append(np.concatenate(values), 0.0))
    axes.set_ylim(low - (high - low) * 0.05, high + (high - low) * 0.05)
