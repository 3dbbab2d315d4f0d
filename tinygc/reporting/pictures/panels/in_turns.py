"""Panels of effects in the turns: closure, laws, data rate, clock offset."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.base.units import DEG
from tinygc.explanation.claims import Claim
from tinygc.explanation.engine import Explanation
from tinygc.noise.turn_gravity import velocity_equations
from tinygc.reporting.pictures.canvas import AFTER, AXES, BEFORE, FLOOR, entry_name, legend, value_text, zero_line
from tinygc.reporting.pictures.values import axis_laws, closure_by_segment, per_parameter, strongest, theta, variable_for

if TYPE_CHECKING:
    from matplotlib.axes import Axes


# Any effect that acts during turns: closure residual of each turn over the effect's prediction, on a straight line.

#: number of parameters drawn, strongest first
MOST = 3
#: lag, in s, in which the horizontal axis is scaled
ONE_MS = 1e-3


def against_prediction(e: Explanation, claim: Claim, axes: Axes, taken_off: bool) -> None:
    """Plot residuals over predictions: on the line of slope one if the effect is the only cause, level once it is taken off."""
    values, spans = theta(e, claim), []
    for entry, colour in _drawn(e, claim):
        value = value_text(claim, entry)
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


def against_one_ms(e: Explanation, claim: Claim, axes: Axes, taken_off: bool) -> None:
    """Plot the closure residual of each turn over the closure of a lag of 1 ms; the slope is the lag in ms."""
    if claim.effect.parameter.unit != "s":  # not a lag
        against_prediction(e, claim, axes, taken_off)
        return
    values = theta(e, claim)
    for entry, colour in _drawn(e, claim):
        name = entry_name(claim.effect, entry).replace("from ", "from dω/dt about ")
        span = _points(e, claim, axes, taken_off, entry, ONE_MS, colour, name if taken_off else "")
        if not taken_off:
            axes.plot(span, span * values[entry] / ONE_MS, color=colour, lw=1.5, label=f"{name}: slope {value_text(claim, entry)}")
    axes.set(
        xlabel="what 1 ms would make the turn miss (°)",
        ylabel="what the turn misses (°)",
        title="After: taken off, to the same scale"
        if taken_off
        else "Before: what each turn misses follows its change of rate; slope in ms",
    )
    legend(axes, None if taken_off else claim.effect.equation)


def _points(e: Explanation, claim: Claim, axes: Axes, taken_off: bool, entry: int, unit: float, colour: str, label: str) -> np.ndarray:
    """Plot one parameter against this many SI units of it; returns the span (2,) of x, in degrees.  Limits are those of "before"."""
    of = per_parameter(e, claim, entry)
    x, y = of.x * unit / DEG, (of.after if taken_off else of.before) / DEG
    axes.errorbar(x, y, of.sigma / DEG, fmt="o", ms=4, lw=0.8, color=colour, label=label or None)
    axes.update_datalim(np.column_stack([x, of.before / DEG]))
    zero_line(axes)
    axes.autoscale_view()
    return np.array([np.min(x, initial=0.0), np.max(x, initial=0.0)])


def _drawn(e: Explanation, claim: Claim) -> list[tuple[int, str]]:
    """Parameters drawn, each with its colour: that of its axis, else in order."""
    every, own = list(AXES.values()), claim.effect.parameter.size == 3
    return [(entry, every[entry if own else number]) for number, entry in enumerate(strongest(e, claim, MOST))]


def along(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot closure before and after, over the segment's largest value of the variable."""
    variable = variable_for(e, claim)
    x, numbers = variable.of_segments(e.twin), [segment.number for segment in e.twin.segments]
    for name, colour, fill, closure in zip(("before", "after"), (BEFORE, AFTER), (BEFORE, "none"), closure_by_segment(e), strict=True):
        axes.semilogy(x, [closure.get(number, np.nan) for number in numbers], "o", color=colour, mfc=fill, label=name)
    axes.axhline(e.proof.floor_rms / DEG, color=FLOOR, ls="--", label="floor")
    label = f"greatest {variable.words} in the segment ({variable.units})"
    axes.set(xlabel=label, ylabel="held-out closure (°)", title="Where it lives: closure of each segment")
    axes.legend()


# The law turn by turn: scale error or zero-rate offset estimated from each turn, with the effect's curve.


def along_law(e: Explanation, claim: Claim, axes: Axes, taken_off: bool) -> None:
    """Plot the estimates with the noise of each turn, and the curve of the law; or the turns with the law removed."""
    laws = axis_laws(e, claim)
    if laws is None:
        against_prediction(e, claim, axes, taken_off)
        return
    for number, ((axis, colour), of, (at, values)) in enumerate(zip(AXES.items(), laws.turns, laws.curves, strict=True)):
        alpha = np.clip(2 * of.sigma.min(initial=np.inf) / of.sigma, 0.15, 1)
        for x, y, sigma, strength in zip(of.x, of.after if taken_off else of.before, of.sigma, alpha, strict=True):
            axes.errorbar(x, y, sigma, fmt="o", ms=4, lw=0.8, color=colour, alpha=strength)
        if not taken_off:
            axes.plot(at, values, color=colour, lw=1.8, label=f"{axis}: {value_text(claim, number)}")
        else:
            axes.plot([], [], "o", color=colour, ms=4, label=axis)
    zero_line(axes)
    if len(laws.reached):
        axes.set_xlim(*_limits(laws.reached))
        axes.set_ylim(*_limits(np.append(laws.asked, 0.0)))
    axes.set(
        xlabel=laws.x_label,
        ylabel=f"{laws.words} of each turn ({laws.unit})",
        title="After: the law taken off, to the same scale"
        if taken_off
        else f"Before: the {laws.words} of each turn follows its {laws.follows}",
    )
    legend(axes, None if taken_off else claim.effect.equation)


def _limits(values: np.ndarray) -> tuple[float, float]:
    """Limits that hold all values, with a margin."""
    low, high = float(values.min()), float(values.max())
    room = 0.05 * max(high - low, 1e-12)
    return low - room, high + room


# Motion faster than half the data rate: closure over the data rate, and its extrapolation.

#: factor on either side of the data
ROOM = 1.35
#: factor below the lowest of them, for the legend
ROOM_BELOW = 8.0


def over_rate(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot, log-log, the closure at each rate, the power law through the reduced rates, and its value at the native rate.

    The claim's parameters: rates_hz (K,), the native one and those of every 2nd, 3rd, … sample; closure_deg (K,) rms at each; exponent of
    the closure in the rate; predicted_deg: closure at the native rate from motion between the samples.
    """
    exponent, predicted_deg = claim.parameters["exponent"], claim.parameters["predicted_deg"]
    floor_deg = float(np.degrees(e.proof.floor_rms))
    order = np.argsort(claim.parameters["rates_hz"])[::-1]
    rates, closure = (np.asarray(claim.parameters[name], dtype=float)[order] for name in ("rates_hz", "closure_deg"))
    axes.loglog(rates[1:], closure[1:], "o", color=BEFORE, ms=7, label="closure, samples left out")
    axes.loglog(rates[:1], closure[:1], "s", color=AFTER, ms=8, label=f"closure as recorded: {closure[0]:.3g}°")
    at = np.array([rates[-1] / ROOM, rates[0] * ROOM])
    line = predicted_deg * (at / rates[0]) ** exponent
    axes.loglog(at, line, color=BEFORE, lw=1.5, label=f"motion between samples: closure ~ rate$^{{{exponent:.1f}}}$")
    axes.loglog(rates[:1], [predicted_deg], "D", mfc="none", color=BEFORE, ms=9, label=f"of it at {rates[0]:.4g} Hz: {predicted_deg:.3g}°")
    axes.axhline(floor_deg, color=FLOOR, ls="--", label=f"noise alone: {floor_deg:.2g}°")
    for number, (rate, angle) in enumerate(zip(rates, closure, strict=True)):
        nth = round(rates[0] / rate)
        suffix = {1: "st", 2: "nd", 3: "rd"}.get(nth if nth < 20 else nth % 10, "th")
        words = "every sample" if number == 0 else f"every {nth}{suffix} sample"
        axes.annotate(words, (rate, angle), xytext=(7, 7), textcoords="offset points", fontsize=8)
    lowest = min([closure.min(), predicted_deg, *([floor_deg] if floor_deg else [])])
    axes.set_xlim(rates[-1] / ROOM, rates[0] * ROOM * 1.3)
    axes.set_ylim(lowest / ROOM_BELOW, max(closure.max(), line.max()) * 1.5)
    axes.set_xticks(rates, [f"{rate:.3g}" for rate in rates])
    axes.minorticks_off()
    axes.set(
        xlabel="samples taken a second (Hz)",
        ylabel="rms closure of the turns (°)",
        title="Fewer samples close worse: the motion is too fast for them",
    )
    axes.legend(fontsize=8, loc="lower left")


# Clocks that differ: the velocity left after turns from rest to rest over the assumed offset, and turn by turn.


def misfit_over_offset(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot the velocity that turns from rest to rest seem to leave over the clock offset; the bias is refitted for each offset."""
    equations = velocity_equations(e.twin, e.naming.fit)
    found = e.gravity.offset_s
    offsets = np.linspace(min(0, found) - abs(found), max(0, found) + abs(found), 121)
    misfit = np.array([np.sqrt(equations.square_at(offset).sum() / equations.count.sum()) for offset in offsets])
    axes.plot(1e3 * offsets, 1e3 * misfit, color=AFTER)
    axes.axvline(0, color=BEFORE, label="one clock")
    axes.axvline(1e3 * found, color=AFTER, label=f"the gyro {1e3 * abs(found):.1f} ms {'late' if found > 0 else 'early'}")
    axes.axvspan(-1e3 * e.gravity.bar_s, 1e3 * e.gravity.bar_s, color=FLOOR, alpha=0.2, label="not claimed")
    axes.set(
        xlabel="the gyro is late by (ms)", ylabel="velocity after a turn (mm/s rms)", title="Where it lives: velocity from rest to rest"
    )
    axes.legend(fontsize=8)


def misfit_by_turn(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Plot each segment's residual with one clock, and with the offset."""
    equations = velocity_equations(e.twin, e.naming.fit)
    numbers = [segment.number for segment in e.twin.segments]
    for name, colour, fill, offset in (("one clock", BEFORE, BEFORE, 0.0), ("with the offset", AFTER, "none", e.gravity.offset_s)):
        misfit = 1e3 * np.sqrt(equations.square_at(offset) / equations.count)
        axes.plot(numbers, misfit, "o", color=colour, mfc=fill, label=f"{name}, {np.sqrt(np.mean(misfit**2)):.1f} mm/s rms")
    axes.set(xlabel="segment", ylabel="velocity after the turn (mm/s)", title="Level velocity that a turn from rest to rest seems to leave")
    axes.set_ylim(bottom=0)
    axes.legend()
