"""Clocks that differ: gravity's misfit in the turns over the offset that is assumed, and turn by turn."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.common.units import MG
from tinygc.explanation.pictures.panels.palette import AFTER, BEFORE, FLOOR
from tinygc.explanation.twin.turn_gravity import turn_equations
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def misfit_over_offset(e: Explanation, claim: Claim, axes: Axes) -> None:
    """The lever arm is fitted anew for each offset."""
    equations = turn_equations(e.twin, e.naming.fit)
    found = e.gravity.offset_s
    offsets = np.linspace(min(0, found) - abs(found), max(0, found) + abs(found), 121)
    misfit = np.array([np.sqrt(equations.square_at(offset).sum() / equations.count.sum()) for offset in offsets]) / MG
    axes.plot(1e3 * offsets, misfit, color=AFTER)
    axes.axvline(0, color=BEFORE, label="one clock")
    axes.axvline(1e3 * found, color=AFTER, label=f"the gyro {1e3 * abs(found):.1f} ms {'late' if found > 0 else 'early'}")
    axes.axvspan(-1e3 * e.gravity.bar_s, 1e3 * e.gravity.bar_s, color=FLOOR, alpha=0.2, label="what filters may do")
    axes.set(
        xlabel="the gyro is late by (ms)", ylabel="gravity off in the turns (mg rms)", title="Where it lives: gravity during the turns"
    )
    axes.legend(fontsize=8)


def misfit_by_turn(e: Explanation, claim: Claim, axes: Axes) -> None:
    """Each segment with one clock, and with the offset."""
    equations = turn_equations(e.twin, e.naming.fit)
    numbers = [segment.number for segment in e.twin.segments]
    for name, colour, fill, offset in (("one clock", BEFORE, BEFORE, 0.0), ("with the offset", AFTER, "none", e.gravity.offset_s)):
        misfit = np.sqrt(equations.square_at(offset) / equations.count) / MG
        axes.plot(numbers, misfit, "o", color=colour, mfc=fill, label=f"{name}, {np.sqrt(np.mean(misfit**2)):.1f} mg rms")
    axes.set(xlabel="segment", ylabel="gravity off in the turn (mg rms)", title="Gravity predicted from the gyro against the accelerometer")
    axes.set_ylim(bottom=0)
    axes.legend()
