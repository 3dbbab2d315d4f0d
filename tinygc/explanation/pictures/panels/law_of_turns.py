"""The law itself, turn by turn: the scale error or the zero that each turn asks for, with the effect's curve through them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from session.common.units import DEG
from tinygc.explanation.pictures.channel_values import theta, variable_for
from tinygc.explanation.pictures.law_curve import at_constant
from tinygc.explanation.pictures.panels import in_turns
from tinygc.explanation.pictures.panels.palette import AXES, FLOOR
from tinygc.explanation.pictures.panels.words import legend, told_value
from tinygc.explanation.pictures.turn_values import OfTurns, per_turn
from tinygc.explanation.twin.variable import Variable
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: share of the greatest scale error from which on it is told in per cent, not in millionths
PER_CENT = 1e-3
#: points of a curve
GRID = 401


@dataclass(frozen=True)
class _Kind:
    """carrier of ``per_turn``, and how its values are told."""

    carrier: str
    words: str


SCALE, OFFSET = _Kind("scale", "scale error"), _Kind("offset", "zero-rate offset")


def before(e: Explanation, claim: Claim, axes: Axes, kind: _Kind) -> None:
    """As recorded: points with the noise of each turn, and the curve of the law."""
    _panel(e, claim, axes, kind, taken_off=False)


def after(e: Explanation, claim: Claim, axes: Axes, kind: _Kind) -> None:
    """The same turns, to the same scale, once the law is taken off."""
    _panel(e, claim, axes, kind, taken_off=True)


def _panel(e: Explanation, claim: Claim, axes: Axes, kind: _Kind, taken_off: bool) -> None:
    variable = variable_for(e, claim)
    if claim.effect.parameter.size != 3 or claim.effect.reach or variable.variable == "angular acceleration":
        # No axis is its own, or no constant movement has the law.
        (in_turns.after if taken_off else in_turns.before)(e, claim, axes)
        return
    turns = [per_turn(e, claim, kind.carrier, axis, variable) for axis in range(3)]
    curves = [_curve(e, claim, kind, variable, axis, turns[axis]) for axis in range(3)]
    unit, one = _unit(kind, curves)
    for (axis, colour), of, (at, values) in zip(AXES.items(), turns, curves, strict=True):
        number = "xyz".index(axis)
        points = of.after if taken_off else of.before
        alpha = np.clip(2 * of.sigma.min(initial=np.inf) / of.sigma, 0.15, 1)
        for x, y, sigma, strength in zip(of.x, points / one, of.sigma / one, alpha, strict=True):
            axes.errorbar(x, y, sigma, fmt="o", ms=4, lw=0.8, color=colour, alpha=strength)
        if not taken_off:
            axes.plot(at, values / one, color=colour, lw=1.8, label=f"{axis}: {told_value(claim, number)}")
        else:
            axes.plot([], [], "o", color=colour, ms=4, label=axis)
    axes.axhline(0, color=FLOOR, lw=0.8)
    reached = np.concatenate([*(of.x for of in turns), *(at for at, _ in curves)])
    if len(reached):
        room = 0.04 * (reached.max() - reached.min())
        axes.set_xlim(reached.min() - room, reached.max() + room)
    axes.set_ylim(*_limits(np.concatenate([*(of.before / one for of in turns), *(values / one for _, values in curves)])))
    signed = variable.variable == "rate"
    where = "rate about the axis in the turn, with its sense" if signed else f"{variable.words} in the turn"
    axes.set(
        xlabel=f"{where} ({variable.units})",
        ylabel=f"{kind.words} of each turn ({unit})",
        title="After: the law taken off, to the same scale"
        if taken_off
        else f"Before: the {kind.words} of each turn follows its {variable.words}",
    )
    legend(axes, None if taken_off else claim.effect.equation)


def _curve(e: Explanation, claim: Claim, kind: _Kind, variable: Variable, axis: int, of: OfTurns) -> tuple[np.ndarray, np.ndarray]:
    """Where (K,), and the law there (K,) SI: of this axis, along what its turns reach."""
    span = np.max(np.abs(of.x), initial=1e-9)
    low, high = (-span, span) if variable.variable == "rate" else (np.min(of.x, initial=np.inf), np.max(of.x, initial=-np.inf))
    if kind is OFFSET:
        low = min(low, 0.0)
    if not high > low:
        return np.zeros(0), np.zeros(0)
    at = np.linspace(low, high, GRID - 1)
    return at, at_constant(claim.effect, theta(e, claim), e.twin.movements[0], variable, axis, at, per_rate=kind is SCALE)


def _unit(kind: _Kind, curves: list[tuple[np.ndarray, np.ndarray]]) -> tuple[str, float]:
    """Words, and its size in SI."""
    if kind is OFFSET:
        return "dps", DEG
    greatest = max((np.max(np.abs(values), initial=0.0) for _, values in curves), default=0.0)
    return ("%", 1e-2) if greatest >= PER_CENT else ("ppm", 1e-6)


def _limits(values: np.ndarray) -> tuple[float, float]:
    """What holds all of the values, with some room."""
    low, high = np.min(values, initial=0.0), np.max(values, initial=0.0)
    room = 0.06 * max(high - low, 1e-12)
    return low - room, high + room
