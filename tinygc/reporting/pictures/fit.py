"""Picture of a fit: closure of each segment, raw and calibrated, and the sensor errors with their sigmas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from session.base.units import DEG
from tinygc.closure.residual import closure_angles
from tinygc.estimation.options import METHODS
from tinygc.fitting.results import FitResult
from tinygc.models.linear import Quantity, bias_only
from tinygc.reporting.pictures.canvas import AFTER, BEFORE, canvas, draw_closure, zero_line

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def figure_of_fit(result: FitResult, words: Sequence[str], quantities: Sequence[Quantity]) -> Figure:
    """Draw the figure; words: the three terms to show, of quantities.  Raises CalibrationError if matplotlib is missing."""
    figure, grid = canvas(2, result.verdict().headline, [result.session.name], [])
    _closure(result, grid[0, 0])
    groups: Mapping[str, list[Quantity]] = {word: [q for q in quantities if q.word == word and q.observed] for word in words}
    for (word, group), axes in zip(groups.items(), grid.flat[1:], strict=True):
        _errors(word, group, axes)
    return figure


def _closure(result: FitResult, axes: Axes) -> None:
    """Plot the tilt at the end of each segment: of the raw rates, held out of the method to use, and the floor."""
    method = result.use.method or result.use.best
    after = result.methods[method].held_out if method in result.methods else result.linear.held_out
    title = METHODS[method].title if method in result.methods else "least squares"
    numbers = [segment.number for segment in result.problem.used]
    raw = closure_angles(result.problem.batch, bias_only())
    series = [("raw rates", BEFORE, BEFORE, numbers, raw), (f"{title}, held out", AFTER, AFTER, numbers, after)]
    draw_closure(axes, series, result.problem.floor.tilt_rms / DEG)
    axes.set(ylabel="tilt at the end (°)", title="Closure of each segment")


def _errors(word: str, group: Sequence[Quantity], axes: Axes) -> None:
    """Plot one sort of sensor error, each with one sigma."""
    names, values = [q.component for q in group], [q.value for q in group]
    axes.errorbar(names, values, [q.sigma for q in group], fmt="o", color=AFTER, capsize=4)
    zero_line(axes)
    axes.set(title=f"{word[0].upper()}{word[1:]}, one sigma", ylabel=group[0].unit if group else "not observed")
