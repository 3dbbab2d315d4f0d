"""Page of pictures of an explanation: each cause and its residuals, closure per segment, the stills over time."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.base.units import DEG, MG
from tinygc.effects.effect import TURNS
from tinygc.explanation.engine import Explanation
from tinygc.explanation.result import is_refitted
from tinygc.noise.channels import own_residuals
from tinygc.noise.twin import Variable
from tinygc.reporting.pictures.canvas import AFTER, AXES, BEFORE, FLOOR, canvas, draw_closure, zero_line
from tinygc.reporting.pictures.panels import draw_claim
from tinygc.reporting.pictures.values import lengths_per_still, rates_per_still

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST_ROWS = 4  #: number of causes drawn, strongest first


def figure_of(e: Explanation) -> Figure:
    """Draw the page as a matplotlib figure.  Raises CalibrationError if matplotlib is missing."""
    told = [*e.claimed, *e.findings]
    shown = told[:MOST_ROWS]
    rows = max(len(shown), 1) + 1
    headline = f"{e.session.name}: {e.words[0]}"
    figure, grid = canvas(rows, headline, [claim.effect.id for claim in told], [claim.says for claim in told])
    for claim, row in zip(shown, grid, strict=False):
        draw_claim(e, claim, *row)
        if len(shown) > 1:
            row[0].set_title(f"{claim.effect.id}\n{row[0].get_title()}")
    if not shown:
        _stills_in_time(e, grid[0, 0])
        # Plot the length of gravity in each still over the session.
        axes = grid[0, 1]
        _, left = lengths_per_still(e)
        axes.plot(Variable("time").of_stills(e.twin), left / MG, "o", mfc="none", color=AFTER, ms=4)
        zero_line(axes)
        axes.set(xlabel="time (s)", ylabel="beyond one value (mg)", title="Length of gravity in the stills over time")
    _closure(e, grid[-1, 0])
    if any(
        claim.effect.kind in ("rate", "earth") and "still" in claim.effect.observable_in and claim.effect.pair != TURNS for claim in shown
    ):
        _stills_in_time(e, grid[-1, 1])
    else:
        _channels(e, grid[-1, 1])
    return figure


def _closure(e: Explanation, axes: Axes) -> None:
    """Plot held-out closure per segment: before, after, floor."""
    series = [("before", BEFORE, BEFORE, e.proof.before_numbers, e.proof.before)] if e.proof.changed else []
    series += [("after" if e.proof.changed else "held out", AFTER, "none", e.proof.after_numbers, e.proof.after)]
    draw_closure(axes, series, e.proof.floor_rms / DEG)
    axes.set(ylabel="closure (°)", title="Closure of segments that the fit never saw")


def _stills_in_time(e: Explanation, axes: Axes) -> None:
    """Plot the rate in each still over the session, which shows drifts and steps."""
    before, after = rates_per_still(e)
    t_s, refitted = Variable("time").of_stills(e.twin), is_refitted(e)
    for i, axis in enumerate("xyz"):
        if refitted:
            axes.plot(t_s, before[:, i] * 1e3, "-", color=AXES[axis], lw=0.8, alpha=0.6)
        axes.plot(t_s, after[:, i] * 1e3, "o", mfc="none", color=AXES[axis], ms=4, label=axis)
    title = "Rate in the stills over time" + (": lines before, circles after" if refitted else "")
    axes.set(xlabel="time (s)", ylabel="rate beyond the prediction (mdps)", title=title)
    zero_line(axes)
    axes.legend(ncols=3)


def _channels(e: Explanation, axes: Axes) -> None:
    """Plot the sigmas of the channels: residuals and the level of noise alone."""
    refitted = is_refitted(e)
    fits = [("before", BEFORE, e.naming.first), ("after", AFTER, e.naming.fit)] if refitted else [("", AFTER, e.naming.fit)]
    names = {"closure": "closure", "still": "rate in stills", "length": "gravity's length"}
    at, width, greatest = np.arange(len(e.whiten.parts)), 0.8 / len(fits), 0.0
    for i, (label, colour, fit) in enumerate(fits):
        left, taken = own_residuals(e.twin, e.whiten, fit)
        parts = e.whiten.parts.items()
        rms = [np.sqrt(np.sum(left[part] ** 2) / max(part.stop - part.start - taken[name], 1)) for name, part in parts]
        axes.bar(at + (i - (len(fits) - 1) / 2) * width, rms, width, color=colour, label=label or None)
        greatest = max(greatest, *rms)
    axes.axhline(1, color=FLOOR, ls="--", label="noise alone")
    axes.set_xticks(at, [names[name] for name in e.whiten.parts])
    axes.set(
        ylabel="rms in sigmas", title="Recorded less predicted, by channel" + (", once mended" if e.mended.found and not refitted else "")
    )
    if greatest > 20:
        axes.set_yscale("log")
    else:
        axes.set_ylim(0, 1.25 * max(greatest, 1))
    axes.legend()
