"""The law itself, turn by turn: the scale error or the zero that each turn asks for, with the effect's curve through them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tinygc.explanation.pictures.axis_laws import axis_laws
from tinygc.explanation.pictures.panels.in_turns import after as after_along
from tinygc.explanation.pictures.panels.in_turns import before as before_along
from tinygc.explanation.pictures.panels.palette import AXES, FLOOR
from tinygc.explanation.pictures.panels.words import legend, told_value
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def before(e: Explanation, claim: Claim, axes: Axes) -> None:
    """As recorded: points with the noise of each turn, and the curve of the law."""
    _panel(e, claim, axes, taken_off=False)


def after(e: Explanation, claim: Claim, axes: Axes) -> None:
    """The same turns, to the same scale, once the law is taken off."""
    _panel(e, claim, axes, taken_off=True)


def _panel(e: Explanation, claim: Claim, axes: Axes, taken_off: bool) -> None:
    laws = axis_laws(e, claim)
    if laws is None:
        (after_along if taken_off else before_along)(e, claim, axes)
        return
    for number, ((axis, colour), of, (at, values)) in enumerate(zip(AXES.items(), laws.turns, laws.curves, strict=True)):
        alpha = np.clip(2 * of.sigma.min(initial=np.inf) / of.sigma, 0.15, 1)
        for x, y, sigma, strength in zip(of.x, of.after if taken_off else of.before, of.sigma, alpha, strict=True):
            axes.errorbar(x, y, sigma, fmt="o", ms=4, lw=0.8, color=colour, alpha=strength)
        if not taken_off:
            axes.plot(at, values, color=colour, lw=1.8, label=f"{axis}: {told_value(claim, number)}")
        else:
            axes.plot([], [], "o", color=colour, ms=4, label=axis)
    axes.axhline(0, color=FLOOR, lw=0.8)
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
    """What holds all of the values, with some room."""
    low, high = float(values.min()), float(values.max())
    room = 0.05 * max(high - low, 1e-12)
    return low - room, high + room
