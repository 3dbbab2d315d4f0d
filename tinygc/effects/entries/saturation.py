"""The output clips below what the register can hold.  What was clipped is lost: those turns are left out."""

import numpy as np

from session.base.units import DEG
from tinygc.effects import Effect, Occurrence, Parameter, nothing
from tinygc.effects.effect import CLIPPED_TURN, LEVEL

EFFECT = Effect(
    id="gyro.saturation",
    equation="|ω_i| never exceeds the level",
    parameter=Parameter("dps", (), "dps", DEG),
    observable_in=("turn",),
    kind="register",
    columns=nothing(1),
    exact_distort=lambda movement, theta: np.clip(movement.rate, -float(theta[0]), float(theta[0])),
    describe=lambda theta: (
        f"the gyro does not go beyond {float(theta[0]) / DEG:.0f} dps: turn slower, or look for the limit in its settings"
    ),
    discriminating_motion="turn each axis faster than the level, slowly increasing",
    conditions=("rate", "dps"),
    occurs=Occurrence("dps", LEVEL),
    picture=CLIPPED_TURN,
)
