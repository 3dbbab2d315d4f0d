"""A stale pre-calibration: the length of gravity in each still, over attitude, and against what the bias says."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.common.units import MG
from tinygc.explanation.pictures.channel_values import lengths_per_still, theta
from tinygc.explanation.pictures.panels.palette import AFTER, AXES, FLOOR
from tinygc.explanation.pictures.panels.words import legend, told_value
from tinygc.explanation.twin.state import bent_by
from tinygc.explanation.twin.variable import Variable
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def over_attitude(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Gravity has one length, whatever the attitude: a bias makes it longer one way up, and shorter the other.

    Of each axis, with what the bias of the others does taken off; filled before, rings after, and the line of the bias.
    """
    _, after = lengths_per_still(e)
    down = e.twin.force / np.linalg.norm(e.twin.force, axis=1, keepdims=True)
    for number, (axis, colour) in enumerate(AXES.items()):
        bias = theta(e, claim)[number]
        x = Variable("attitude", number).of_stills(e.twin)
        axes.plot(x, (after + down[:, number] * bias) / MG, "o", color=colour, ms=4)
        axes.plot(x, after / MG, "o", mfc="none", color=colour, ms=4)
        ends = np.array([x.min(), x.max()])
        axes.plot(ends, -ends * bias / MG, "-", color=colour, lw=1.5, label=f"{axis}: {told_value(claim, number)}")
    axes.plot([], [], "o", mfc="none", color="black", label="after")
    axes.axhline(0, color=FLOOR, lw=0.8)
    axes.set(
        xlabel="gravity along the same axis (g)",
        ylabel="length of gravity beyond one value (mg)",
        title="Where it lives: gravity's length changes with attitude",
    )
    legend(axes, claim.effect.equation)


def against_explained(e: Explanation, claim: Claim, axes: Axes) -> None:
    """What it adds to gravity's length in each attitude."""
    down = e.twin.force / np.linalg.norm(e.twin.force, axis=1, keepdims=True)
    says = np.sum(down * (bent_by(claim.effect, e.twin.force) @ theta(e, claim)), axis=1) / MG
    recorded = says + lengths_per_still(e)[1] / MG
    axes.plot(says, recorded, "o", color=AFTER, ms=4)
    span = [min(says.min(), recorded.min()), max(says.max(), recorded.max())]
    axes.plot(span, span, color=FLOOR, lw=0.8)
    axes.set(xlabel=f"{claim.effect.id} says (mg)", ylabel="recorded in the still (mg)", title="Recorded against explained")
