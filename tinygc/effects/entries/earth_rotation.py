"""The Earth's rotation, where no latitude was given: three components in table axes, whose length is known."""

import numpy as np

from session.base.units import DEG, EARTH_RATE_RPS
from tinygc.effects import Derived, Effect, Parameter, nothing
from tinygc.effects.effect import EARTH


def latitude_deg(rate_t: np.ndarray) -> float:
    """Latitude that fits a rate (3,) rad/s in table axes best, whatever its length."""
    return float(np.degrees(np.arctan2(-rate_t[2], np.hypot(rate_t[0], rate_t[1]))))


EFFECT = Effect(
    id="earth.rotation",
    equation="ω += R_bt w, w the Earth's rate in table axes",
    parameter=Parameter("rate_dps", (3,), "dps", DEG, plausible=2 * EARTH_RATE_RPS),
    observable_in=("still",),
    kind="earth",
    columns=nothing(3),
    describe=lambda theta: f"the stills turn with the Earth, as at a latitude of {latitude_deg(theta):.0f}°: give your latitude",
    discriminating_motion="record stills with each axis up and down and pointing each way",
    conditions=("attitude", "g"),
    derived=Derived("latitude_deg", "deg", latitude_deg),
    picture=EARTH,
)
