"""One panel for each idea of what a cause looks like; each draws an explanation's claim into a pair of axes.

An effect that adds to the rates is drawn along its variable; what the registers or the stills themselves tell has a panel of its own.
"""

from __future__ import annotations

from collections.abc import Callable

from tinygc.explain.pictures.panels import (
    clipped_turn,
    clock_offset,
    creeping_stills,
    earth,
    false_reading,
    gravity_length,
    in_stills,
    in_turns,
    lost_samples,
)
from tinygc.explain.verdict.claims import Claimed

#: (explanation, claim, matplotlib axes)
Panel = Callable[..., None]

OWN: dict[str, tuple[Panel, Panel]] = {
    "gyro.saturation": (clipped_turn.one_turn, clipped_turn.closure_over_peak),
    "data.glitches": (false_reading.one_reading, false_reading.all_readings),
    "timing.dropped_samples": (lost_samples.one_loss, lost_samples.closure_over_losses),
    "reference.not_still": (creeping_stills.turned_angle, creeping_stills.rate_against_bar),
    "timing.gyro_accel_offset": (clock_offset.misfit_over_offset, clock_offset.misfit_by_turn),
    "reference.accelerometer": (gravity_length.over_attitude, gravity_length.against_explained),
    "earth.rotation": (earth.in_the_table, in_stills.against_explained),
    "unknown.world_direction": (earth.in_the_table, in_stills.against_explained),
}


def panels_of(claim: Claimed) -> tuple[Panel, Panel]:
    """The mismatch where it lives, and a second look at it."""
    usual = in_stills if "still" in claim.effect.seen_in else in_turns
    return OWN.get(claim.effect.id, (usual.along, usual.against_explained))
