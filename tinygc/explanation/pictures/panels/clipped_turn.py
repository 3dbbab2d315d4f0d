"""Clipping: the readings that stop at the level, and what that costs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.common.units import DEG
from session.detect.segments import Segment
from tinygc.explanation.pictures.channel_values import closure_as_recorded
from tinygc.explanation.pictures.panels.palette import AXES, BEFORE, FLOOR
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def one_turn(e: Explanation, claim: Claim, axes: Axes) -> None:
    """The turn that stands at the level for longest, the level drawn."""
    level = claim.parameters["dps"]
    least = level - claim.std["dps"]

    def at_level(segment: Segment) -> np.ndarray:
        rate = _rate_dps(e, segment)
        return (np.abs(rate) >= least).sum(axis=0)

    segment = max(e.problem.segments, key=lambda segment: at_level(segment).max())
    t_s, rate, axis = _t_s(e, segment), _rate_dps(e, segment), int(np.argmax(at_level(segment)))
    for i, name in enumerate("xyz"):
        axes.plot(t_s, rate[:, i], color=AXES[name], lw=1.5 if i == axis else 0.8, alpha=1.0 if i == axis else 0.5, label=name)
    stuck = np.abs(rate[:, axis]) >= least
    axes.plot(t_s[stuck], rate[stuck, axis], "o", color="black", ms=4, label=f"{'xyz'[axis]} at the level")
    for sign in (-1, 1):
        axes.axhline(sign * level, color=FLOOR, ls="--", lw=1, label=f"±{level:.4g} dps" if sign > 0 else None)
    number = f"segment {segment.number}, log {segment.log + 1}" if len(e.problem.logs) > 1 else f"segment {segment.number}"
    axes.set(xlabel=f"time in {number} (s)", ylabel="rate as read (dps)", title=f"Where it lives: {'xyz'[axis]} stops at {level:.4g} dps")
    axes.legend(fontsize=8)


def closure_over_peak(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Closure as recorded of every segment, over the greatest reading in it: what stands at the level does not close."""
    level, closure = claim.parameters["dps"], closure_as_recorded(e)
    left = {segment.number for segment in e.twin.segments}
    peak = np.array([np.abs(_rate_dps(e, segment)).max() for segment in e.problem.used])
    y = np.array([closure[segment.number] for segment in e.problem.used])
    out = np.array([segment.number not in left for segment in e.problem.used])
    axes.semilogy(peak[~out], y[~out], "o", color=AXES["z"], label="used")
    axes.semilogy(peak[out], y[out], "o", color=BEFORE, label="left out")
    axes.axvline(level, color=FLOOR, ls="--", lw=1, label=f"{level:.4g} dps")
    axes.axhline(e.proof.floor_rms / DEG, color=FLOOR, ls=":", lw=1, label="floor")
    axes.set(xlabel="greatest reading of the segment (dps)", ylabel="closure as recorded (°)", title="Segments at the level do not close")
    axes.legend(fontsize=8)


def _rate_dps(e: Explanation, segment: Segment) -> np.ndarray:
    return e.problem.logs[segment.log].samples.gyro[segment.start : segment.stop] / DEG


def _t_s(e: Explanation, segment: Segment) -> np.ndarray:
    t_s = e.problem.logs[segment.log].samples.t_s[segment.start : segment.stop]
    return t_s - t_s[0]
