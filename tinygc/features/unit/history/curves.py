"""What the pictures and the page draw of a history: the numbers of one kind, about their means, with the course that was estimated."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import timedelta
from typing import TYPE_CHECKING, Any

import numpy as np

from tinygc.estimation.between_sessions import ONE_SIGMA
from tinygc.estimation.session_times import YEAR_S
from tinygc.features.unit.history.estimate import NumberHistory, UnitHistory
from tinygc.features.unit.history.text import headline, significant
from tinygc.reporting.pictures.canvas import AXES, FLOOR, PALE, canvas, legend

if TYPE_CHECKING:
    from tinygc.reporting.pictures.canvas import Axes, Figure


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
class Panel:
    """Numbers of one kind: title, unit, curves; shocks: where one was found, and which components it moved."""

    title: str
    unit: str
    components: tuple[str, ...]
    curves: tuple[Curve, ...]
    shocks: tuple[tuple[float, str], ...]


def panels_of(history: UnitHistory) -> Iterator[Panel]:
    """The panels of a unit, in the order of its numbers."""
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
            yield Panel(title, part[0].number.unit, tuple(components), curves, marks)


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


# The picture: each kind of number over the dates, with the course that was estimated and the shocks that were found.

MARKS = {"x": "o", "y": "s", "z": "^"}
#: of the span, between the marks of two components at one session
APART = 0.006
#: most names of sessions below a panel, where there are no dates
MOST_NAMES = 12


def figure_of(history: UnitHistory) -> Figure:
    """Return the picture as a matplotlib figure.  Raises CalibrationError where matplotlib is missing."""
    panels = list(panels_of(history))
    figure, grid = canvas(
        -(-len(panels) // 2), f"{headline(history)}: difference from each number's mean, ± one sigma; dotted: no significant course", [], []
    )
    axes = np.ravel(grid)
    for panel, own in zip(panels, axes, strict=False):
        _draw(history, panel, own)
    for own in axes[len(panels) :]:
        own.axis("off")
    return figure


def _draw(history: UnitHistory, panel: Panel, axes: Axes) -> None:
    first = history.sessions[0].moment
    span = float(history.at[-1] - history.at[0]) or 1.0

    def place(at: np.ndarray) -> Any:
        if not history.dated or first is None:
            return at
        return [first.when + timedelta(seconds=float(each) * YEAR_S) for each in at]

    for k, curve in enumerate(panel.curves):
        colour, moved = AXES[curve.axis], (k - 1) * APART * span
        if len(curve.grid):
            axes.fill_between(place(curve.grid), curve.low, curve.high, color=colour, alpha=0.12, lw=0)
            axes.plot(place(curve.grid), curve.course, "-" if curve.shows else ":", lw=1.0 if curve.shows else 0.7, color=colour)
        axes.errorbar(
            place(curve.at + moved),
            curve.values,
            curve.sigmas,
            fmt=MARKS[curve.axis],
            ms=4,
            mfc="white",
            lw=1,
            capsize=2,
            color=colour,
            label=curve.label,
        )
    axes.grid(True, color=PALE, lw=0.4, alpha=0.6)
    axes.set(ylabel=f"difference ({panel.unit})", title=panel.title)
    legend(axes)
    for at, words in panel.shocks:
        (where,) = place(np.array([at]))
        axes.axvline(where, color=FLOOR, lw=0.9, ls=":")
        axes.annotate(words, (where, 0.02), (3, 0), xycoords=("data", "axes fraction"), textcoords="offset points", fontsize=8, color=FLOOR)
    if history.dated:
        axes.tick_params(axis="x", rotation=20)
    else:
        step = -(-len(history.sessions) // MOST_NAMES)
        names = [session.name for session in history.sessions][::step]
        axes.set_xticks(history.at[::step], labels=names)
        for label in axes.get_xticklabels():
            label.set_parse_math(False)  # a dollar sign in a folder's name
