"""The accelerometer's sensitivity differs between positive and negative force (IEEE 1293: input-output asymmetry)."""

import numpy as np

from session.base.units import PPM, G
from tinygc.effects import Effect, Parameter, axis_of, diagonal, largest, nothing
from tinygc.effects.device import OF_FORCE
from tinygc.effects.effect import GRAVITY_LAW

EFFECT = Effect(
    id="accelerometer.scale_asymmetry",
    equation="f_i += k_i |f_i|",
    parameter=Parameter("half_difference_ppm", (3,), "ppm", PPM, plausible=20_000 * PPM),
    observable_in=("reference",),
    kind="force",
    columns=nothing(3),
    bends=lambda movement: diagonal(np.abs(movement.force_g) * G),
    describe=lambda theta: (
        f"the accelerometer's up and down differ by {2 * abs(largest(theta)) / PPM:.0f} ppm on {axis_of(theta)}: "
        "keep one sensitivity for each sign"
    ),
    discriminating_motion="hold each axis up, down and half-way: |f| bends at zero alone, f² all along",
    conditions=("attitude", "g"),
    picture=GRAVITY_LAW,
    device=OF_FORCE,
)
