"""Positive and negative turns have different sensitivity (IEEE 528: scale factor asymmetry)."""

import numpy as np

from tinygc.effects import Effect, Parameter, PerAxisC, axis_of, diagonal, largest
from tinygc.effects.effect import SCALE_LAW

EFFECT = Effect(
    id="gyro.scale_asymmetry",
    equation="ω_i += k_i |ω_i|",
    parameter=Parameter("half_difference", (3,), "fraction", plausible=0.05),
    observable_in=("turn",),
    columns=lambda movement: diagonal(np.abs(movement.rate)),
    describe=lambda theta: (
        f"positive and negative turns differ in scale by {200 * abs(largest(theta)):.2f} % on {axis_of(theta)}: "
        "keep one sensitivity for each sense"
    ),
    discriminating_motion="record the same turn both ways about each axis, slow and fast",
    conditions=("rate", "dps"),
    picture=SCALE_LAW,
    device=PerAxisC(
        name="SCALE_ASYMMETRY",
        formula="r -= k |r| (gyro.scale_asymmetry)",
        numpy=lambda c, w, inputs: c["SCALE_ASYMMETRY"] * np.abs(w),
    ),
)
