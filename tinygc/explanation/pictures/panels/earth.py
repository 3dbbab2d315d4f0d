"""A rate that is fixed in the world: the stills' rates, turned into the table's frame, gather in one place that is not zero."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.common.units import DEG, EARTH_RATE_RPS
from tinygc.attitude import rotation
from tinygc.explanation.pictures.channel_values import rates_per_still, recorded_in_stills, theta
from tinygc.explanation.pictures.panels.palette import AFTER, BEFORE, FLOOR
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MDPS = 1e-3 * DEG


def in_the_table(e: Explanation, claim: Claim, axes: Axes, as_the_earths: bool = False) -> None:
    """Horizontal, along the found rate's own horizontal direction, and down; with a circle as large as the Earth's rate."""
    turn, fixed = rotation.matrix(e.twin.q_tb), theta(e, claim)
    size = np.hypot(*fixed[:2])
    ahead = np.array([*fixed[:2], 0]) / size if size > 0 else np.array([1.0, 0, 0])
    _, left = rates_per_still(e)
    for name, colour, fill, rates in (("before", BEFORE, BEFORE, recorded_in_stills(e, claim)), ("after", AFTER, "none", left)):
        in_table = np.einsum("qij,qj->qi", turn, rates) * 1e3
        x, y = in_table @ ahead, in_table[:, 2]
        axes.plot(x, y, "o", color=colour, mfc=fill, ms=4, alpha=0.6)
        axes.plot(x.mean(), y.mean(), "P", color=colour, mec="black", ms=13, label=f"mean {name}")
    if as_the_earths:
        angle = np.linspace(0, 2 * np.pi, 200)
        earth = EARTH_RATE_RPS / MDPS
        axes.plot(earth * np.cos(angle), earth * np.sin(angle), color=FLOOR, ls="--", label="the Earth's rate, 15.04 °/h")
    axes.axhline(0, color=FLOOR, lw=0.6)
    axes.axvline(0, color=FLOOR, lw=0.6)
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_yaxis()
    axes.set(
        xlabel="horizontal, northward where it is the Earth (mdps)",
        ylabel="down (mdps)",
        title="Where it lives: one rate, fixed in the table's frame",
    )
    axes.legend(fontsize=8)
