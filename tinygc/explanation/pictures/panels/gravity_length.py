"""A stale pre-calibration: the length of gravity in each still, over attitude, and against what the bias says."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.common.units import MG
from tinygc.explanation.pictures.channel_values import lengths_per_still, theta, variable_for
from tinygc.explanation.pictures.panels.palette import AFTER, BEFORE, FLOOR
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def over_attitude(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Gravity has one length, whatever the attitude."""
    variable, (before, after) = variable_for(e, claim), lengths_per_still(e)
    x = variable.of_stills(e.twin)
    axes.plot(x, before / MG, "o", color=BEFORE, label=f"before, {np.std(before) / MG:.2f} mg rms")
    axes.plot(x, after / MG, "o", mfc="none", color=AFTER, label=f"after, {np.std(after) / MG:.2f} mg")
    axes.axhline(0, color=FLOOR, lw=0.8)
    axes.set(
        xlabel=f"{variable.words} ({variable.units})",
        ylabel="length of gravity beyond one value (mg)",
        title="Where it lives: gravity's length changes with attitude",
    )
    axes.legend()


def against_explained(e: Explanation, claim: Claim, axes: Axes) -> None:
    """What the bias adds to gravity's length in each attitude."""
    down = e.twin.force / np.linalg.norm(e.twin.force, axis=1, keepdims=True)
    says = down @ theta(e, claim) / MG
    recorded = says + lengths_per_still(e)[1] / MG
    axes.plot(says, recorded, "o", color=AFTER, ms=4)
    span = [min(says.min(), recorded.min()), max(says.max(), recorded.max())]
    axes.plot(span, span, color=FLOOR, lw=0.8)
    axes.set(xlabel=f"{claim.effect.id} says (mg)", ylabel="recorded in the still (mg)", title="Recorded against explained")
