"""An effect that acts while the sensor turns: closure of each segment, along what it follows, and against what the effect says."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.common.units import DEG
from tinygc.explanation.pictures.channel_values import added_to_closure, closure_by_segment, variable_for
from tinygc.explanation.pictures.panels.palette import AFTER, AXES, BEFORE, FLOOR
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


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


def against_explained(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Each angle of each closure, on the line where the effect is all there is."""
    says, recorded = (angles / DEG for angles in added_to_closure(e, claim))
    for i, (name, colour) in enumerate(zip(("about x", "about y", "about z"), AXES.values(), strict=True)):
        if i < says.shape[1]:
            axes.plot(says[:, i], recorded[:, i], "o", color=colour, label=name, ms=4)
    span = [np.min([says, recorded]), np.max([says, recorded])]
    axes.plot(span, span, color=FLOOR, lw=0.8)
    axes.set(
        xlabel=f"{claim.effect.id} says (°)", ylabel="recorded closure (°)", title="Recorded against explained: closure of each segment"
    )
    axes.legend()
