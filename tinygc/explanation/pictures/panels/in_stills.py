"""An effect that moves the zero: the rate in each still along what it follows, with its law; and against what the effect says."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.common.units import DEG
from tinygc.explanation.pictures.channel_values import (
    added_in_stills,
    rates_per_still,
    recorded_in_stills,
    theta,
    variable_for,
)
from tinygc.explanation.pictures.law_curve import at_constant
from tinygc.explanation.pictures.panels.palette import AXES, FLOOR
from tinygc.explanation.pictures.panels.words import legend, told_value
from tinygc.explanation.twin.variable import Variable
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: what an effect reads where it follows one variable alone
READS = {"attitude": {"force"}, "temperature": {"temperature"}, "time": {"time"}}
#: points of a curve
GRID = 401


def along(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Filled before, rings after, and the law's curve; where each axis follows gravity along itself, that is what it is drawn against.

    Before has all else of the fit taken off: the other columns of a matrix, too.
    """
    values, variable = theta(e, claim), variable_for(e, claim)
    own = variable.variable == "attitude" and values.size == 3
    if variable.variable == "attitude" and values.size == 9:
        values = np.where(np.arange(9) % 3 == variable.axis, values, 0.0)
    _, left = rates_per_still(e)
    recorded = left + added_in_stills(e, claim, values)
    for i, axis in enumerate("xyz"):
        along_axis = Variable("attitude", i) if own else variable
        x = along_axis.of_stills(e.twin)
        axes.plot(x, recorded[:, i] * 1e3, "o", color=AXES[axis], ms=4)
        axes.plot(x, left[:, i] * 1e3, "o", mfc="none", color=AXES[axis], ms=4)
        if _has_curve(claim, variable, values):
            at = np.linspace(x.min(), x.max(), GRID)
            curve = at_constant(claim.effect, values, e.twin.movements[0], along_axis, i, at) / DEG
            axes.plot(at, curve * 1e3, color=AXES[axis], lw=1.5)
        number = i if values.size == 3 else 3 * i + (variable.axis or 0)
        value = told_value(claim, number) if claim.effect.parameter.shape in ((3,), (3, 3)) else ""
        axes.plot([], [], "o-", color=AXES[axis], label=f"{axis}: {value}" if value else axis)
    axes.plot([], [], "o", mfc="none", color="black", label="after")
    axes.axhline(0, color=FLOOR, lw=0.8)
    label = "gravity along the same axis" if own else variable.words
    over = "gravity" if variable.variable == "attitude" else variable.words
    axes.set(
        xlabel=f"{label} ({variable.units})",
        ylabel="rate beyond the prediction (mdps)",
        title=f"Where it lives: the rate in each still over {over}, and the law",
    )
    legend(axes, claim.effect.equation)


def _has_curve(claim: Claim, variable: Variable, values: np.ndarray) -> bool:
    """Whether the variable alone tells what the effect adds to a still."""
    effect = claim.effect
    one = variable.variable != "attitude" or values.size in (3, 9)
    return one and not effect.reach and set(effect.inputs) <= READS.get(variable.variable, set())


def against_explained(e: Explanation, claim: Claim, axes: Axes) -> None:
    """On the line where the effect is all there is."""
    says, recorded = added_in_stills(e, claim) * 1e3, recorded_in_stills(e, claim) * 1e3
    for i, axis in enumerate("xyz"):
        axes.plot(says[:, i], recorded[:, i], "o", color=AXES[axis], label=axis, ms=4)
    span = [np.min([says, recorded]), np.max([says, recorded])]
    axes.plot(span, span, color=FLOOR, lw=0.8, label="slope 1")
    axes.set(xlabel=f"{claim.effect.id} says (mdps)", ylabel="recorded in the still (mdps)", title="Recorded against explained")
    axes.legend()
