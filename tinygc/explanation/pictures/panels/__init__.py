"""One panel for each idea of what a cause looks like; each draws an explanation's claim into a pair of axes.

An effect names its pair (``tinygc.effects.picture``), or draws its own from plain data; one that adds to the rates is drawn along its
variable unless it says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from tinygc.effects import picture as named
from tinygc.explanation.pictures.own_picture import draw_own
from tinygc.explanation.pictures.panels import (
    clipped_turn,
    clock_offset,
    creeping_stills,
    data_rate,
    earth,
    false_reading,
    gravity_length,
    in_stills,
    in_turns,
    law_of_turns,
    lost_samples,
)
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: (explanation, claim, matplotlib axes)
Panel = Callable[..., None]

PAIRS: dict[str, tuple[Panel, Panel]] = {
    named.STILLS: (in_stills.along, in_stills.against_explained),
    named.TURNS: (in_turns.before, in_turns.after),
    named.CLIPPED_TURN: (clipped_turn.one_turn, clipped_turn.closure_over_peak),
    named.FALSE_READINGS: (false_reading.one_reading, false_reading.all_readings),
    named.LOST_SAMPLES: (lost_samples.one_loss, lost_samples.closure_over_losses),
    named.CREEPING_STILLS: (creeping_stills.turned_angle, creeping_stills.rate_against_bar),
    named.CLOCKS: (clock_offset.misfit_over_offset, clock_offset.misfit_by_turn),
    named.GRAVITY_LENGTH: (gravity_length.over_attitude, gravity_length.against_explained),
    named.WORLD: (earth.in_the_table, in_stills.against_explained),
    named.EARTH: (partial(earth.in_the_table, as_the_earths=True), in_stills.against_explained),
    named.SCALE_LAW: (law_of_turns.before, law_of_turns.after),
    named.ENERGY_LAW: (law_of_turns.before, law_of_turns.after),
    named.LAG_LAW: (in_turns.lag_before, in_turns.lag_after),
    named.DATA_RATE: (data_rate.over_rate, in_turns.along),
}


def draw_claim(e: Explanation, claim: Claim, left: Axes, right: Axes) -> None:
    """The mismatch where it lives, and a second look at it, into two axes.  EffectError where an effect's own picture fails."""
    pair = claim.effect.pair
    if not isinstance(pair, str):
        draw_own(e, claim, left, right)
        return
    for panel, axes in zip(PAIRS[pair], (left, right), strict=True):
        panel(e, claim, axes)
