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
from tinygc.reporting.pictures.panels import in_stills as creeping_stills
from tinygc.reporting.pictures.panels import in_stills as earth
from tinygc.reporting.pictures.panels import in_stills as gravity_length
from tinygc.reporting.pictures.panels import in_turns as clock_offset
from tinygc.reporting.pictures.panels import in_turns as data_rate
from tinygc.reporting.pictures.panels import in_turns as law_of_turns
from tinygc.reporting.pictures.values import draw_own

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: (explanation, claim, matplotlib axes)
Panel = Callable[..., None]

PAIRS: dict[str, tuple[Panel, Panel]] = {
    effect.STILLS: (in_stills.along, in_stills.against_explained),
    effect.TURNS: (in_turns.before, in_turns.after),
    effect.CLIPPED_TURN: (registers.one_turn, registers.closure_over_peak),
    effect.FALSE_READINGS: (registers.one_reading, registers.all_readings),
    effect.LOST_SAMPLES: (registers.one_loss, registers.closure_over_losses),
    effect.CREEPING_STILLS: (creeping_stills.turned_angle, creeping_stills.rate_against_bar),
    effect.CLOCKS: (clock_offset.misfit_over_offset, clock_offset.misfit_by_turn),
    effect.GRAVITY_LENGTH: (gravity_length.over_attitude, gravity_length.length_against_explained),
    effect.WORLD: (earth.in_the_table, in_stills.against_explained),
    effect.EARTH: (partial(earth.in_the_table, as_the_earths=True), in_stills.against_explained),
    effect.SCALE_LAW: (law_of_turns.law_before, law_of_turns.law_after),
    effect.ENERGY_LAW: (law_of_turns.law_before, law_of_turns.law_after),
    effect.LAG_LAW: (in_turns.lag_before, in_turns.lag_after),
    effect.DATA_RATE: (data_rate.over_rate, in_turns.along),
}


def draw_claim(e: Explanation, claim: Claim, left: Axes, right: Axes) -> None:
    """Draw the mismatch and a second view of it into two axes.  EffectError if an effect's own picture fails."""
    pair = claim.effect.pair
    if not isinstance(pair, str):
        draw_own(e, claim, left, right)
        return
    for panel, axes in zip(PAIRS[pair], (left, right), strict=True):
        panel(e, claim, axes)
