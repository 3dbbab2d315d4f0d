"""An effect that moves the zero: the rate in each still, along what it follows, and against what the effect says."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from tinygc.explanation.pictures.channel_values import (
    added_in_stills,
    left_in_stills,
    rates_per_still,
    recorded_in_stills,
    theta,
    variable_for,
)
from tinygc.explanation.pictures.panels.palette import AXES, FLOOR
from tinygc.explanation.twin.variable import Variable
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def along(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Filled before, rings after; where each axis follows gravity along itself, that is what it is drawn against."""
    (before, _), after = rates_per_still(e), left_in_stills(e, claim)
    variable = variable_for(e, claim)
    own = variable.variable == "attitude" and theta(e, claim).size == 3 and claim.effect.kind == "rate"
    for i, axis in enumerate("xyz"):
        x = (Variable("attitude", i) if own else variable).of_stills(e.twin)
        axes.plot(x, before[:, i] * 1e3, "o", color=AXES[axis], label=f"{axis} before")
        axes.plot(x, after[:, i] * 1e3, "o", mfc="none", color=AXES[axis], label=f"{axis} after")
    axes.axhline(0, color=FLOOR, lw=0.8)
    label = "gravity along the same axis" if own else variable.words
    axes.set(xlabel=f"{label} ({variable.units})", ylabel="rate beyond the prediction (mdps)", title="Where it lives: rate in each still")
    axes.legend(ncols=3, fontsize=8)


def against_explained(e: Explanation, claim: Claim, axes: Axes) -> None:
    """On the line where the effect is all there is."""
    says, recorded = added_in_stills(e, claim) * 1e3, recorded_in_stills(e, claim) * 1e3
    for i, axis in enumerate("xyz"):
        axes.plot(says[:, i], recorded[:, i], "o", color=AXES[axis], label=axis, ms=4)
    span = [np.min([says, recorded]), np.max([says, recorded])]
    axes.plot(span, span, color=FLOOR, lw=0.8)
    axes.set(xlabel=f"{claim.effect.id} says (mdps)", ylabel="recorded in the still (mdps)", title="Recorded against explained")
    axes.legend()
