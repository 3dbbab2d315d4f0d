"""Panels of effects in the turns: closure, laws, data rate, clock offset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from session.base.texts import significant
from session.base.units import DEG
from tinygc.estimation.bias import tilt_rms
from tinygc.explanation.claims import Claim
from tinygc.explanation.engine import Explanation
from tinygc.noise.turn_gravity import velocity_equations
from tinygc.noise.twin import variable_of
from tinygc.reporting.drawing import Axis, Panel, to_one_scale
from tinygc.reporting.pictures.values import (
    axis_laws,
    closure_by_segment,
    entry_name,
    per_parameter,
    strongest,
    value_text,
)

# Closure of each segment.

#: (name, colour, whether as rings, numbers of segments (S,), error angles (S, d) rad)
ClosureSeries = tuple[str, str, bool, Sequence[int], np.ndarray]
#: segments from which on points are small
MANY = 150


def closure_panel(series: Sequence[ClosureSeries], floor_deg: float, title: str = "", limit_deg: float | None = None) -> Panel:
    """Draw the tilt at the end of each segment, with the floor and the limit."""
    panel = Panel(Axis("segment"), Axis("tilt at the end of the segment (°)", log=True), title, "Closure of each segment")
    panel.across(floor_deg, name=f"noise floor, {significant(floor_deg)}°")
    if limit_deg:
        panel.across(limit_deg, "limit", name=f"limit, {limit_deg:g}°")
    for name, kind, ring, numbers, angles in series:
        tilt, radius = np.linalg.norm(angles[:, :2], axis=1) / DEG, 3.2 if len(numbers) < MANY else 1.8
        labels = [f"segment {number}, {name}: {significant(each)}°" for number, each in zip(numbers, tilt, strict=True)]
        panel.points(numbers, tilt, kind, ring, radius, name=f"{name}, {significant(tilt_rms(angles) / DEG)}° rms", labels=labels)
    return panel


def proof_panel(e: Explanation) -> Panel:
    """Draw held-out closure per segment: before, after, floor."""
    proof = e.proof
    series: list[ClosureSeries] = [("before", "before", False, proof.before_numbers, proof.before)] if proof.changed else []
    series.append(("after" if proof.changed else "held out", "after", True, proof.after_numbers, proof.after))
    return closure_panel(series, proof.floor_rms / DEG, "Closure of segments that the fit never saw")


# Any effect that acts during turns: closure residual of each turn over the effect's prediction, on a straight line.

#: number of parameters drawn, strongest first
MOST = 3
#: lag, in s, in which the horizontal axis is scaled
ONE_MS = 1e-3
AFTER = "After: the effect taken off, to the same scale"


def against_prediction(e: Explanation, claim: Claim) -> tuple[Panel, Panel]:
    """Draw residuals over predictions: on the line of slope one if the effect is the only cause, level once it is taken off."""
    values, names = claim.theta, {}
    lines: dict[int, tuple[float, float | None]] = {}
    for entry in strongest(e, claim, MOST):
        value = value_text(claim, entry)
        names[entry] = entry_name(claim.effect, entry), f": {value}" if value else ""
        lines[entry] = values[entry], None
    label, title = f"what {claim.effect.id} makes the turn miss (°)", "Before: each turn misses what the effect makes it miss"
    left, right = _turn_pair(e, claim, names, lines, label, title)
    ends = left.ends()[0]
    return left.line(ends, ends, "floor", name="slope 1: it is the cause", is_measure=False), right


def against_one_ms(e: Explanation, claim: Claim) -> tuple[Panel, Panel]:
    """Draw the closure residual of each turn over the closure of a lag of 1 ms; the slope is the lag in ms."""
    if claim.effect.parameter.unit != "s":  # not a lag
        return against_prediction(e, claim)
    values, names = claim.theta, {}
    lines: dict[int, tuple[float, float | None]] = {}
    for entry in strongest(e, claim, MOST):
        names[entry] = entry_name(claim.effect, entry).replace("from ", "from dω/dt about "), f": slope {value_text(claim, entry)}"
        lines[entry] = ONE_MS, values[entry] / ONE_MS
    title = "Before: what each turn misses follows its change of rate; slope in ms"
    return _turn_pair(e, claim, names, lines, "what 1 ms would make the turn miss (°)", title)


def _turn_pair(
    e: Explanation,
    claim: Claim,
    names: dict[int, tuple[str, str]],
    lines: Mapping[int, tuple[float, float | None]],
    label: str,
    title: str,
) -> tuple[Panel, Panel]:
    """Before and after, to one scale: each turn's residual over so many SI units of a parameter, with a line of a slope through zero.

    names: of each parameter, and its value; lines: the units and the slope.
    """
    left = Panel(Axis(label), Axis("what the turn misses (°)"), title, legend=claim.effect.equation).zero()
    right = Panel(Axis(label), Axis("what the turn misses (°)"), AFTER).zero()
    for number, (entry, (name, value)) in enumerate(names.items()):
        kind = "xyz"[entry if claim.effect.parameter.size == 3 else number]
        of, (unit, slope) = per_parameter(e, claim, entry), lines[entry]
        x = of.x * unit / DEG
        left.points(x, of.before / DEG, kind, sigma=of.sigma / DEG, name=name + value)
        right.points(x, of.after / DEG, kind, sigma=of.sigma / DEG, name=name)
        if slope is not None:
            span = np.array([np.min(x, initial=0.0), np.max(x, initial=0.0)])
            left.line(span, span * slope, kind, name=name + value)
    to_one_scale(left, right)
    return left, right


def along(e: Explanation, claim: Claim) -> Panel:
    """Draw closure before and after, over the segment's largest value of the variable."""
    variable = variable_of(claim.effect, claim.theta)
    x, numbers = variable.of_segments(e.twin), [segment.number for segment in e.twin.segments]
    axes = Axis(f"greatest {variable.words} in the segment ({variable.units})"), Axis("held-out closure (°)", log=True)
    panel = Panel(*axes, "Where it lives: closure of each segment").across(e.proof.floor_rms / DEG, name="noise floor")
    for kind, closure in zip(("before", "after"), closure_by_segment(e), strict=True):
        panel.points(x, [closure.get(number, np.nan) for number in numbers], kind, ring=kind == "after", name=kind)
    return panel


# The law turn by turn: scale error or zero-rate offset estimated from each turn, with the effect's curve.


def along_law(e: Explanation, claim: Claim) -> tuple[Panel, Panel]:
    """Draw the estimates with the noise of each turn, and the curve of the law; and the turns with the law removed, to the same scale."""
    laws = axis_laws(e, claim)
    if laws is None:
        return against_prediction(e, claim)
    y = f"{laws.words} of each turn ({laws.unit})"
    title = f"Before: the {laws.words} of each turn follows its {laws.follows}"
    left = Panel(Axis(laws.x_label), Axis(y, zero=True), title, legend=claim.effect.equation).zero()
    right = Panel(Axis(laws.x_label), Axis(y, zero=True), AFTER.replace("effect", "law")).zero()
    for number, (axis, of, (at, values)) in enumerate(zip("xyz", laws.turns, laws.curves, strict=True)):
        name = f"{axis}: {value_text(claim, number)}"
        left.points(of.x, of.before, axis, sigma=of.sigma, name=name).line(at, values, axis, name=name)
        right.points(of.x, of.after, axis, sigma=of.sigma, name=axis)
    to_one_scale(left, right)
    return left, right


# Motion faster than half the data rate: closure over the data rate, and its extrapolation.


def over_rate(e: Explanation, claim: Claim) -> Panel:
    """Draw, log-log, the closure at each rate, the power law through the reduced rates, and its value at the native rate.

    The claim's parameters: rates_hz (K,), the native one and those of every 2nd, 3rd, … sample; closure_deg (K,) rms at each; exponent of
    the closure in the rate; predicted_deg: closure at the native rate from motion between the samples.
    """
    exponent, predicted_deg = claim.parameters["exponent"], claim.parameters["predicted_deg"]
    floor_deg = float(np.degrees(e.proof.floor_rms))
    order = np.argsort(claim.parameters["rates_hz"])[::-1]
    rates, closure = (np.asarray(claim.parameters[name], dtype=float)[order] for name in ("rates_hz", "closure_deg"))
    x = Axis("samples taken a second (Hz)", log=True, ticks=[(float(rate), f"{rate:.3g}") for rate in rates])
    title = "Fewer samples close worse: the motion is too fast for them"
    panel = Panel(x, Axis("rms closure of the turns (°)", log=True), title)
    panel.across(floor_deg, name=f"noise alone: {significant(floor_deg, 2)}°")
    line = predicted_deg * (rates / rates[0]) ** exponent
    panel.line(rates, line, "before", name=f"motion between samples: closure ~ rate^{exponent:.1f}")
    panel.points(rates[0], predicted_deg, "before", ring=True, radius=6, name=f"of it at {rates[0]:.4g} Hz: {significant(predicted_deg)}°")
    labels = [f"every {round(rates[0] / rate)}th sample" for rate in rates[1:]]
    panel.points(rates[1:], closure[1:], "before", radius=4.5, name="closure, samples left out", labels=labels)
    return panel.points(rates[0], closure[0], "after", radius=4.5, name=f"closure as recorded: {significant(closure[0])}°")


# Clocks that differ: the velocity left after turns from rest to rest over the assumed offset, and turn by turn.


def misfit_over_offset(e: Explanation, claim: Claim) -> Panel:
    """Draw the velocity that turns from rest to rest seem to leave over the clock offset; the bias is refitted for each offset."""
    assert e.gravity is not None  # it claims the offset
    equations, found = velocity_equations(e.twin, e.naming.fit), e.gravity.offset_s
    offsets = np.linspace(min(0, found) - abs(found), max(0, found) + abs(found), 121)
    misfit = np.array([np.sqrt(equations.square_at(offset).sum() / equations.count.sum()) for offset in offsets])
    axes = Axis("the gyro is late by (ms)"), Axis("velocity after a turn (mm/s rms)")
    panel = Panel(*axes, "Where it lives: velocity from rest to rest")
    bar = 1e3 * e.gravity.bar_s
    panel.area([-bar, bar], -np.inf, np.inf, "floor", name="not claimed", is_measure=False).upright(0.0, "before", name="one clock")
    panel.upright(1e3 * found, "after", name=f"the gyro {1e3 * abs(found):.1f} ms {'late' if found > 0 else 'early'}")
    return panel.line(1e3 * offsets, 1e3 * misfit, "after")


def misfit_by_turn(e: Explanation, claim: Claim) -> Panel:
    """Draw each segment's residual with one clock, and with the offset."""
    assert e.gravity is not None  # it claims the offset
    equations, numbers = velocity_equations(e.twin, e.naming.fit), [segment.number for segment in e.twin.segments]
    axes = Axis("segment"), Axis("velocity after the turn (mm/s)", zero=True)
    panel = Panel(*axes, "Level velocity that a turn from rest to rest seems to leave")
    for name, kind, offset in (("one clock", "before", 0.0), ("with the offset", "after", e.gravity.offset_s)):
        misfit = 1e3 * np.sqrt(equations.square_at(offset) / equations.count)
        panel.points(numbers, misfit, kind, ring=kind == "after", name=f"{name}, {np.sqrt(np.mean(misfit**2)):.1f} mm/s rms")
    return panel
