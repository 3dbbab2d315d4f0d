"""How an effect is drawn: the name of a pair of panels that there is, or a function that draws its own from plain data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

#: pairs of panels: where the mismatch lives, and a second look at it
STILLS, TURNS = "stills", "turns"
CLIPPED_TURN, FALSE_READINGS, LOST_SAMPLES = "clipped turn", "false readings", "lost samples"
CREEPING_STILLS, CLOCKS, GRAVITY_LENGTH = "creeping stills", "clocks", "gravity's length"
WORLD, EARTH = "a rate fixed in the world", "the Earth's rate"
#: laws that turns show, of an effect with one parameter for each axis: a scale error along the regime, a lag (of a matrix, too), a zero
#: along the regime; and what a log loses that is sampled too slowly
SCALE_LAW, LAG_LAW, ENERGY_LAW, DATA_RATE = "scale law", "lag law", "energy law", "data rate"
PAIRS = (
    *(STILLS, TURNS, CLIPPED_TURN, FALSE_READINGS, LOST_SAMPLES, CREEPING_STILLS, CLOCKS, GRAVITY_LENGTH, WORLD, EARTH),
    *(SCALE_LAW, LAG_LAW, ENERGY_LAW, DATA_RATE),
)
#: regimes that only turns have
OF_TURNS = ("rate", "angular acceleration", "vibration")


@dataclass(frozen=True, eq=False)
class PictureData:
    """What an effect's own picture is handed, of Q stills and S segments of one explained recording; SI, in the sensor's axes.

    theta (P,); parameters and std as in the JSON; variable, unit: what the effect's regime names, in people's units, its mean in each
    still of_stills (Q,) and its greatest in each segment of_segments (S,); stills_s (Q,) s, the middle of each still;
    before, after (Q, 3) rad/s: rate in each still beyond the prediction, without the effect and with it; says (Q, 3) rad/s: what the
    effect adds in each still; numbers (S,) of the segments; closure_says, closure_recorded (S, d) rad: what it adds to the closure of
    each segment, and what the recording has of it; floor_rad: rms closure that noise alone leaves.
    """

    theta: np.ndarray
    parameters: dict
    std: dict
    variable: str
    unit: str
    of_stills: np.ndarray
    of_segments: np.ndarray
    stills_s: np.ndarray
    before: np.ndarray
    after: np.ndarray
    says: np.ndarray
    numbers: np.ndarray
    closure_says: np.ndarray
    closure_recorded: np.ndarray
    floor_rad: float


#: (data, left axes, right axes) -> None, axes of matplotlib
OwnPicture = Callable[[PictureData, Any, Any], None]
