"""Panels, one per kind of cause; each draws an explanation's claim into a pair of axes.

An effect names its pair of panels (``tinygc.effects.effect``), or draws its own from plain data.  By default an effect that adds to the
rates is drawn along its variable.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from tinygc.effects import effect
from tinygc.explanation.claims import Claim
from tinygc.explanation.engine import Explanation
from tinygc.reporting.pictures.panels import in_stills, in_turns, registers
from tinygc.reporting.pictures.values import draw_own

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: (explanation, claim, matplotlib axes)
Panel = Callable[..., None]


def _before_and_after(panel: Panel) -> tuple[Panel, Panel]:
    """The same turns twice, to one scale: as recorded, and with the effect removed."""
    return partial(panel, taken_off=False), partial(panel, taken_off=True)


PAIRS: dict[str, tuple[Panel, Panel]] = {
    effect.STILLS: (in_stills.along, in_stills.against_explained),
    effect.TURNS: _before_and_after(in_turns.against_prediction),
    effect.CLIPPED_TURN: (registers.one_turn, registers.closure_over_peak),
    effect.FALSE_READINGS: (registers.one_reading, registers.all_readings),
    effect.LOST_SAMPLES: (registers.one_loss, registers.closure_over_losses),
    effect.CREEPING_STILLS: (in_stills.turned_angle, in_stills.rate_against_bar),
    effect.CLOCKS: (in_turns.misfit_over_offset, in_turns.misfit_by_turn),
    effect.GRAVITY_LENGTH: (in_stills.over_attitude, in_stills.length_against_explained),
    effect.GRAVITY_LAW: (in_stills.length_over_conditions, in_stills.length_against_explained),
    effect.WORLD: (in_stills.in_the_table, in_stills.against_explained),
    effect.EARTH: (partial(in_stills.in_the_table, as_the_earths=True), in_stills.against_explained),
    effect.SCALE_LAW: _before_and_after(in_turns.along_law),
    effect.ENERGY_LAW: _before_and_after(in_turns.along_law),
    effect.LAG_LAW: _before_and_after(in_turns.against_one_ms),
    effect.DATA_RATE: (in_turns.over_rate, in_turns.along),
}


def draw_claim(e: Explanation, claim: Claim, left: Axes, right: Axes) -> None:
    """Draw the mismatch and a second view of it into two axes.  EffectError if an effect's own picture fails."""
    pair = claim.effect.pair
    if not isinstance(pair, str):
        draw_own(e, claim, left, right)
        return
    for panel, axes in zip(PAIRS[pair], (left, right), strict=True):
        panel(e, claim, axes)
