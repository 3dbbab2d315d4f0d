"""The picture of an explanation: each cause in its pair of panels, closure per segment, and the stills over time.

An effect names its pair (``tinygc.effects.effect``).  By default an effect that adds to the rates is drawn along its variable.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from tinygc.effects import effect
from tinygc.explanation.claims import Claim
from tinygc.explanation.engine import Explanation
from tinygc.explanation.result import is_refitted
from tinygc.noise.channels import own_residuals
from tinygc.reporting.drawing import Axis, Panel, Picture
from tinygc.reporting.pictures import in_stills, in_turns, registers

MOST_ROWS = 4  #: number of causes drawn, strongest first

Pair = Callable[[Explanation, Claim], tuple[Panel, Panel]]


def _two(left: Callable[..., Panel], right: Callable[..., Panel]) -> Pair:
    return lambda e, claim: (left(e, claim), right(e, claim))


PAIRS: dict[str, Pair] = {
    effect.STILLS: _two(in_stills.along, in_stills.against_explained),
    effect.TURNS: in_turns.against_prediction,
    effect.CLIPPED_TURN: _two(registers.one_turn, registers.closure_over_peak),
    effect.FALSE_READINGS: _two(registers.one_reading, registers.all_readings),
    effect.LOST_SAMPLES: _two(registers.one_loss, registers.closure_over_losses),
    effect.CREEPING_STILLS: _two(in_stills.turned_angle, in_stills.rate_against_bar),
    effect.CLOCKS: _two(in_turns.misfit_over_offset, in_turns.misfit_by_turn),
    effect.GRAVITY_LENGTH: _two(in_stills.over_attitude, in_stills.length_against_explained),
    effect.GRAVITY_LAW: _two(in_stills.length_over_conditions, in_stills.length_against_explained),
    effect.WORLD: _two(in_stills.in_the_table, in_stills.against_explained),
    effect.EARTH: _two(partial(in_stills.in_the_table, as_the_earths=True), in_stills.against_explained),
    effect.SCALE_LAW: in_turns.along_law,
    effect.ENERGY_LAW: in_turns.along_law,
    effect.LAG_LAW: in_turns.against_one_ms,
    effect.DATA_RATE: _two(in_turns.over_rate, in_turns.along),
}


def pair_of(e: Explanation, claim: Claim) -> tuple[Panel, Panel]:
    """Draw the mismatch and a second view of it."""
    return PAIRS[effect.TURNS if claim.effect.pair == effect.STILLS and not e.twin.stills else claim.effect.pair](e, claim)


def drawable(e: Explanation) -> list[Claim]:
    """The claims and findings with a picture: what was left out of a further reference before the fit has none."""
    fitted = {claim.effect.id for claim in e.naming.fit.state.claims}
    return [claim for claim in (*e.claimed, *e.findings) if e.twin.stills or claim.effect.id in fitted]


def picture_of(e: Explanation) -> Picture:
    """Draw the picture."""
    claims, panels = [*e.claimed, *e.findings], list[Panel]()
    shown = drawable(e)[:MOST_ROWS]
    for claim in shown:
        left, right = pair_of(e, claim)
        if len(shown) > 1:
            left.title = f"{claim.effect.id}\n{left.title}"
        panels += [left, right]
    if not shown and e.twin.stills:
        panels = [in_stills.in_time(e), in_stills.length_in_time(e)]
    in_the_stills = [claim for claim in shown if claim.effect.kind in ("rate", "earth") and "still" in claim.effect.observable_in]
    still = e.twin.stills and any(c.effect.pair != effect.TURNS for c in in_the_stills)
    panels += [in_turns.proof_panel(e), in_stills.in_time(e) if still else _channels(e), *(() if e.shown is None else e.shown.panels)]
    names = ", ".join(claim.effect.id for claim in claims)
    return Picture(panels, f"{e.session.name}: {e.words[0]}", [*filter(None, [names]), *(claim.description for claim in claims)])


def _channels(e: Explanation) -> Panel:
    """Draw the sigmas of the channels: residuals and the level of noise alone."""
    refitted = is_refitted(e)
    fits = [("before", e.naming.first), ("after", e.naming.fit)] if refitted else [("after", e.naming.fit)]
    names = {"closure": "closure", "still": "rate in stills", "length": "gravity's length"}
    title = "Recorded less predicted, by channel" + (", once repaired" if e.repaired.found and not refitted else "")
    ticks = [(float(n), names[name]) for n, name in enumerate(e.own_p)]
    panel = Panel(Axis(lo=-0.6, hi=len(ticks) - 0.4, ticks=ticks), Axis("rms (sigmas)", zero=True), title).across(1.0, name="noise alone")
    width = 0.8 / len(fits)
    for i, (kind, fit) in enumerate(fits):
        left, taken = own_residuals(e.twin, e.whiten, fit)
        for at, name in enumerate(e.own_p):
            part = e.whiten.parts[name]
            rms = np.sqrt(np.sum(left[part] ** 2) / max(part.stop - part.start - taken[name], 1))
            middle = at + (i - (len(fits) - 1) / 2) * width
            panel.area([middle - width / 2, middle + width / 2], 0, rms, kind, "solid", name=kind if refitted else "")
            if rms > 20:
                panel.y = Axis("rms (sigmas)", log=True)
    return panel
