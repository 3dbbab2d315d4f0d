"""An effect that draws its own picture: it is handed plain arrays, and the two axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from session.common.units import DEG
from tinygc.effects import EffectError, PictureData
from tinygc.explanation.pictures.channel_values import (
    added_in_stills,
    added_to_closure,
    rates_per_still,
    theta,
    variable_for,
)
from tinygc.explanation.twin.variable import Variable
from tinygc.explanation.verdict.claims import Claim
from tinygc.explanation.verdict.explain import Explanation

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def picture_data(e: Explanation, claim: Claim) -> PictureData:
    """What there is to draw of a claim that adds to the rates."""
    variable, (before, after) = variable_for(e, claim), rates_per_still(e)
    closure_says, closure_recorded = added_to_closure(e, claim)
    return PictureData(
        theta=theta(e, claim),
        parameters=claim.parameters,
        std=claim.std,
        variable=variable.words,
        unit=variable.units,
        of_stills=variable.of_stills(e.twin),
        of_segments=variable.of_segments(e.twin),
        stills_s=Variable("time").of_stills(e.twin),
        before=before * DEG,
        after=after * DEG,
        says=added_in_stills(e, claim) * DEG,
        numbers=np.array([segment.number for segment in e.twin.segments]),
        closure_says=closure_says,
        closure_recorded=closure_recorded,
        floor_rad=float(e.proof.floor_rms),
    )


def draw_own(e: Explanation, claim: Claim, left: Axes, right: Axes) -> None:
    """Call the effect's own function.  EffectError, with what it said, where it fails."""
    own = claim.effect.pair
    assert callable(own)
    try:
        own(picture_data(e, claim), left, right)
    except Exception as error:
        what = " ".join(str(error).split())
        raise EffectError(
            f"{claim.effect.id}: its picture cannot be drawn: {type(error).__name__}: {what}; --no-pictures goes on"
        ) from None
