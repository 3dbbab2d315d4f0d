"""Stills that were none: the angle by which the body turns in each, and its rate against the bar."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.common.units import DEG
from session.detect.stills import CREEP_RPS, CREEP_SIGMAS, Still
from tinygc.explanation.pictures.panels.palette import AFTER, BEFORE, FLOOR, PALE
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation
from tinygc.problem.still_set import StillSet

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def turned_angle(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Integral of the gyro, less its usual zero, within each still: those that were not still run away."""
    moving, zero = set(claim.parameters["stills"]), _zero(e, claim)
    for number, (log, still) in enumerate(_stills(e)):
        rate = log.samples.gyro[still.start : still.stop] - zero
        angle = np.linalg.norm(np.cumsum(rate, axis=0), axis=1) * log.samples.period_s / DEG
        bad = number in moving
        t_s = np.arange(len(angle)) * log.samples.period_s
        axes.plot(t_s, angle, color=BEFORE if bad else PALE, lw=1.4 if bad else 0.8, zorder=2 if bad else 1, label=_label(axes, bad))
    axes.set(
        xlabel="time within the still (s)",
        ylabel="turned since it began (°)",
        title="Where it lives: the body turns while it should be still",
    )
    axes.legend(fontsize=8)


def rate_against_bar(e: Explanation, claim: Claim, axes: Axes) -> None:
    """By gravity and by the gyro, and what noise would make of gravity."""
    zero, stills = _zero(e, claim), _stills(e)
    numbers = np.arange(len(stills))
    bad = np.isin(numbers, claim.parameters["stills"])
    by_gravity = np.array([np.linalg.norm(still.tilt_rate) for _, still in stills]) / DEG
    by_gyro = np.array([np.linalg.norm(still.gyro_mean - zero) for _, still in stills]) / DEG
    for which, colour, name in ((~bad, AFTER, "still"), (bad, BEFORE, "not still")):
        axes.semilogy(numbers[which], by_gyro[which], "o", color=colour, label=f"{name}, by the gyro")
        axes.semilogy(numbers[which], by_gravity[which], "^", mfc="none", color=colour, label=f"{name}, by gravity")
    axes.step(numbers, [_bar(log, still) / DEG for log, still in stills], where="mid", color=FLOOR, ls="--", label="bar for gravity")
    axes.set(xlabel="still", ylabel="turns at (dps)", title="Rate within each still")
    axes.legend(fontsize=8, ncols=2)


def _stills(e: Explanation) -> list[tuple]:
    """(log, still) of all, as they are numbered."""
    return [(log, still) for log in e.problem.logs for still in log.stills]


def _zero(e: Explanation, claim: Claim) -> np.ndarray:
    """(3,) rad/s: the gyro's usual reading at rest."""
    good = [still.gyro_mean for number, (_, still) in enumerate(_stills(e)) if number not in claim.parameters["stills"]]
    return np.median(good or [still.gyro_mean for _, still in _stills(e)], axis=0)


def _bar(log: StillSet, still: Still) -> float:
    """rad/s: what the first look lets noise make of gravity's movement in this still (``session.detect.stills``)."""
    sigma = float(log.noise.velocity_random_walk.max()) * np.sqrt(12 / still.duration_s**3) / still.gravity_mps2
    return max(CREEP_SIGMAS * sigma, CREEP_RPS)


def _label(axes: Axes, bad: bool) -> str | None:
    name = "not still" if bad else "still"
    return None if name in axes.get_legend_handles_labels()[1] else name
