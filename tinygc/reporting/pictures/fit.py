"""Picture of a fit: closure of each segment, raw and calibrated, and the sensor errors with their sigmas."""

from __future__ import annotations

from collections.abc import Sequence

from session.base.units import DEG
from tinygc.closure.residual import closure_angles
from tinygc.estimation.options import METHODS
from tinygc.fitting.results import FitResult
from tinygc.inference.decide import Fact
from tinygc.models.linear import bias_only
from tinygc.reporting.drawing import Axis, Panel, Picture
from tinygc.reporting.pictures.in_turns import closure_panel


def picture_of_fit(result: FitResult, words: Sequence[str], quantities: Sequence[Fact]) -> Picture:
    """Draw the picture; words: the three terms to show, of quantities."""
    errors = [_errors(word, [q for q in quantities if q.word == word and q.observed]) for word in words]
    return Picture([_closure(result), *errors], result.verdict().headline, [result.session.name])


def _closure(result: FitResult) -> Panel:
    """Draw the tilt at the end of each segment: of the raw rates, held out of the method to use, and the floor."""
    method = result.use.method or result.use.best
    after = result.methods[method].held_out if method in result.methods else result.linear.held_out
    title = METHODS[method].title if method in result.methods else "least squares"
    numbers, raw = [segment.number for segment in result.problem.used], closure_angles(result.problem.batch, bias_only())
    series = [("raw rates", "before", False, numbers, raw), (f"{title}, held out", "after", False, numbers, after)]
    return closure_panel(series, result.problem.floor.tilt_rms / DEG, "Closure of each segment")


def _errors(word: str, group: Sequence[Fact]) -> Panel:
    """Draw one sort of sensor error, each with one sigma."""
    x = Axis(lo=-0.6, hi=len(group) - 0.4, ticks=[(float(n), q.component) for n, q in enumerate(group)])
    y = Axis(f"{word} ({group[0].unit})" if group else f"{word}: not observed")
    panel = Panel(x, y, f"{word[0].upper()}{word[1:]}, one sigma").zero()
    values, sigmas = [q.value for q in group], [q.sigma for q in group]
    return panel.points(range(len(group)), values, "after", sigma=sigmas, radius=4)
