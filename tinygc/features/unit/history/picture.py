"""Picture of a history: each kind of number over the dates, with the course that was estimated and the shocks that were found."""

from __future__ import annotations

from datetime import timedelta
from typing import TYPE_CHECKING, Any

import numpy as np

from tinygc.estimation.session_times import YEAR_S
from tinygc.features.unit.history.curves import Panel, panels_of
from tinygc.features.unit.history.estimate import UnitHistory
from tinygc.features.unit.history.text import headline
from tinygc.reporting.pictures.canvas import AXES, FLOOR, PALE, canvas, legend

if TYPE_CHECKING:
    from tinygc.reporting.pictures.canvas import Axes, Figure

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
