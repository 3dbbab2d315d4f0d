"""What the pictures and the page draw of a history: the numbers of one kind, about their means, with the course that was estimated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import timedelta

import numpy as np

from tinygc.estimation.between_sessions import ONE_SIGMA
from tinygc.estimation.session_times import YEAR_S
from tinygc.features.unit.history.estimate import NumberHistory, UnitHistory
from tinygc.features.unit.history.text import headline, significant
from tinygc.reporting.drawing import Axis, Panel, Picture

#: places between the first session and the last at which a course is drawn
DRAWN = 25
#: components that are drawn in one panel; of six misalignments three at a time
TOGETHER = 3


@dataclass(frozen=True, eq=False)
class Curve:
    """One number, in its unit, less its mean.

    sessions (n,): places in the history; at (n,): their times; values, sigmas (n,); course, low and high (M,) at ``grid`` (M,), with 68 %,
    empty without a course; shows: whether the course has a drift or a step that is significant.
    """

    label: str
    axis: str
    sessions: np.ndarray
    at: np.ndarray
    values: np.ndarray
    sigmas: np.ndarray
    grid: np.ndarray
    course: np.ndarray
    low: np.ndarray
    high: np.ndarray
    shows: bool


@dataclass(frozen=True, eq=False)
class Kind:
    """Numbers of one kind: title, unit, curves; shocks: where one was found, and which components it moved."""

    title: str
    unit: str
    components: tuple[str, ...]
    curves: tuple[Curve, ...]
    shocks: tuple[tuple[float, str], ...]


def kinds_of(history: UnitHistory) -> Iterator[Kind]:
    """The kinds of numbers of a unit, in their order."""
    for name in dict.fromkeys(each.number.name for each in history.numbers):
        kind = [each for each in history.numbers if each.number.name == name and len(each.values)]
        for first in range(0, len(kind), TOGETHER):
            part = kind[first : first + TOGETHER]
            components = [each.number.component for each in part]
            shocks: dict[float, list[str]] = {}
            for step in history.steps:
                if step.number in [each.number for each in part]:
                    middle = float(history.at[step.interval : step.interval + 2].mean())
                    shocks.setdefault(middle, []).append(step.number.component)
            title = name if len(kind) <= TOGETHER else f"{name} {', '.join(components)}"
            marks = tuple((at, f"shock: {', '.join(sorted(which))}") for at, which in sorted(shocks.items()))
            curves = tuple(_curve(history, each, k) for k, each in enumerate(part))
            yield Kind(title, part[0].number.unit, tuple(components), curves, marks)


def _curve(history: UnitHistory, each: NumberHistory, place: int) -> Curve:
    si, at = each.number.si, history.at[each.sessions]
    mean = float(np.mean(each.values)) / si
    label = f"{each.number.component} {significant(mean, 4)}"
    grid, course, low, high = _course(each, at)
    values, sigmas = each.values / si - mean, each.sigmas / si
    shows = each.course is not None and (each.course.drifts or bool(each.course.steps))
    course, low, high = (part / si - mean for part in (course, low, high))
    return Curve(label, "xyz"[place], each.sessions, at, values, sigmas, grid, course, low, high, shows)


def _course(each: NumberHistory, at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Level, steps and drift on a grid, with their 68 %; a step stands in the middle of its interval."""
    none = np.zeros(0)
    if each.course is None:
        return none, none, none, none
    model = each.course.model
    edges = [float((at[step.before] + at[step.before + 1]) / 2) for step in each.course.steps]
    short = 1e-6 * (at[-1] - at[0])
    grid = np.sort(np.concatenate([np.linspace(at[0], at[-1], DRAWN), *([edge - short, edge + short] for edge in edges)]))
    slopes = np.zeros((len(grid), model.design.shape[1]))
    slopes[:, 0] = 1.0
    for k, edge in enumerate(edges):
        slopes[:, 1 + k] = np.where(grid < edge, -1.0, 0.0)
    if each.course.has_drift:
        slopes += (grid - at[-1])[:, None] * each.course.drift_column
    low, high = np.array([model.interval(slope, ONE_SIGMA) for slope in slopes]).T
    return grid, slopes @ model.coefficients, low, high


# The panels: each kind of number over the dates, with the course that was estimated and the shocks that were found.

#: of the span, between the points of two components at one session
APART = 0.006
#: dates below a panel
DATES = 6


def picture_of(history: UnitHistory) -> Picture:
    """All panels of a unit."""
    title = f"{headline(history)}: difference from each number's mean, ± one sigma; dashed: no significant course"
    return Picture([panel_of(history, kind) for kind in kinds_of(history)], title)


def panel_of(history: UnitHistory, kind: Kind) -> Panel:
    """One kind of number, about its means."""
    # Years since the first session, with dates, or names of sessions where there are none
    lo, hi = float(history.at[0]), float(history.at[-1])
    room, first = 0.04 * (hi - lo) or 0.5, history.sessions[0].moment
    if history.dated and first is not None:
        dates = [(float(at), first.when + timedelta(seconds=float(at) * YEAR_S)) for at in np.linspace(lo, hi, DATES)]
        ticks = [(at, date.date().isoformat()) for at, date in dates]
    else:
        ticks = [(float(at), session.name[:16]) for at, session in zip(history.at, history.sessions, strict=True)]
    x, y = Axis("", lo - room, hi + room, ticks=ticks), Axis(f"difference ({kind.unit})")
    course = "the course with its 68 %, dashed where neither drift nor step is significant"
    panel = Panel(x, y, kind.title, caption=f"{kind.title}: difference from each one’s mean, and {course}.")
    for k, curve in enumerate(kind.curves):
        if len(curve.grid):
            panel.area(curve.grid, curve.low, curve.high, curve.axis)
            panel.line(curve.grid, curve.course, curve.axis, "thin" if curve.shows else "dash")
        says = [
            f"{history.sessions[place].name}: {kind.components[k]} {value:+.3g} ± {sigma:.2g} {kind.unit}"
            for place, value, sigma in zip(curve.sessions, curve.values, curve.sigmas, strict=True)
        ]
        at = curve.at + (k - 1) * APART * ((hi - lo) or 1.0)
        panel.points(at, curve.values, curve.axis, sigma=curve.sigmas, name=curve.label, says=says)
    for middle, words in kind.shocks:
        panel.upright(middle, name="shock").words(middle, -np.inf, f" {words}", "floor")
    return panel
