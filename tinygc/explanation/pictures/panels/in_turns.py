"""Any effect that acts while the sensor turns: what each turn misses, on a straight line over what the effect says."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.common.units import DEG
from tinygc.explanation.pictures.channel_values import closure_by_segment, theta, variable_for
from tinygc.explanation.pictures.panels.palette import AFTER, AXES, BEFORE, FLOOR
from tinygc.explanation.pictures.panels.words import entry_name, legend, told_value
from tinygc.explanation.pictures.turn_values import per_parameter, strongest
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: parameters that are drawn, strongest first
MOST = 3
#: of a lag, in s, what the horizontal axis is told of
ONE_MS = 1e-3


def before(e: Explanation, claim: Claim, axes: Axes) -> None:
    """On the line of slope one where the effect is the cause."""
    _against_said(e, claim, axes, taken_off=False)


def after(e: Explanation, claim: Claim, axes: Axes) -> None:
    """The same turns, to the same scale, once the effect is taken off: level where it was all."""
    _against_said(e, claim, axes, taken_off=True)


def lag_before(e: Explanation, claim: Claim, axes: Axes) -> None:
    """What each turn misses against what 1 ms of lag would make: the slope is the lag in ms."""
    _against_one_ms(e, claim, axes, taken_off=False)


def lag_after(e: Explanation, claim: Claim, axes: Axes) -> None:
    """The same turns, to the same scale, once the lag is taken off."""
    _against_one_ms(e, claim, axes, taken_off=True)


def _against_said(e: Explanation, claim: Claim, axes: Axes, taken_off: bool) -> None:
    values, spans = theta(e, claim), []
    for entry, colour in _drawn(e, claim):
        value = told_value(claim, entry)
        label = entry_name(claim.effect, entry) + (f": {value}" if value and not taken_off else "")
        spans.append(_points(e, claim, axes, taken_off, entry, values[entry], colour, label))
    if not taken_off:
        span = np.array([np.min(spans), np.max(spans)])
        axes.plot(span, span, color=FLOOR, lw=1.5, label="slope 1: it is the cause")
    axes.set(
        xlabel=f"what {claim.effect.id} makes the turn miss (°)",
        ylabel="what the turn misses (°)",
        title="After: the effect taken off, to the same scale" if taken_off else "Before: each turn misses what the effect makes it miss",
    )
    legend(axes, None if taken_off else claim.effect.equation)


def _against_one_ms(e: Explanation, claim: Claim, axes: Axes, taken_off: bool) -> None:
    if claim.effect.parameter.unit != "s":  # no delay
        _against_said(e, claim, axes, taken_off)
        return
    values = theta(e, claim)
    for entry, colour in _drawn(e, claim):
        name = entry_name(claim.effect, entry).replace("from ", "from dω/dt about ")
        span = _points(e, claim, axes, taken_off, entry, ONE_MS, colour, name if taken_off else "")
        if not taken_off:
            axes.plot(span, span * values[entry] / ONE_MS, color=colour, lw=1.5, label=f"{name}: slope {told_value(claim, entry)}")
    axes.set(
        xlabel="what 1 ms would make the turn miss (°)",
        ylabel="what the turn misses (°)",
        title="After: taken off, to the same scale"
        if taken_off
        else "Before: what each turn misses follows its change of rate; slope in ms",
    )
    legend(axes, None if taken_off else claim.effect.equation)


def _points(e: Explanation, claim: Claim, axes: Axes, taken_off: bool, entry: int, unit: float, colour: str, label: str) -> np.ndarray:
    """Draw one parameter against so many SI units of it; the span (2,) of x, in degrees.  The limits are those of before in either case."""
    of = per_parameter(e, claim, entry)
    x, y = of.x * unit / DEG, (of.after if taken_off else of.before) / DEG
    axes.errorbar(x, y, of.sigma / DEG, fmt="o", ms=4, lw=0.8, color=colour, label=label or None)
    axes.update_datalim(np.column_stack([x, of.before / DEG]))
    axes.axhline(0, color=FLOOR, lw=0.8)
    axes.autoscale_view()
    return np.array([np.min(x, initial=0.0), np.max(x, initial=0.0)])


def _drawn(e: Explanation, claim: Claim) -> list[tuple[int, str]]:
    """Parameters that are drawn, each with its colour: of an axis its own, of anything else in order."""
    every, own = list(AXES.values()), claim.effect.parameter.size == 3
    return [(entry, every[entry if own else number]) for number, entry in enumerate(strongest(e, claim, MOST))]


def along(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Closure before and after, along the greatest that the variable reaches in the segment."""
    variable = variable_for(e, claim)
    x, numbers = variable.of_segments(e.twin), [segment.number for segment in e.twin.segments]
    for name, colour, fill, closure in zip(("before", "after"), (BEFORE, AFTER), (BEFORE, "none"), closure_by_segment(e), strict=True):
        axes.semilogy(x, [closure.get(number, np.nan) for number in numbers], "o", color=colour, mfc=fill, label=name)
    axes.axhline(e.proof.floor_rms / DEG, color=FLOOR, ls="--", label="floor")
    label = f"greatest {variable.words} in the segment ({variable.units})"
    axes.set(xlabel=label, ylabel="held-out closure (°)", title="Where it lives: closure of each segment")
    axes.legend()
