"""Positive and negative turns have different sensitivity (IEEE 528: scale factor asymmetry)."""

import numpy as np

from tinygc.effects.effect import Effect, Parameter, axis_of, diagonal, largest

EFFECT = Effect(
    id="gyro.scale_asymmetry",
    equation="ω_i += k_i |ω_i|",
    parameter=Parameter("half_difference", (3,), "fraction", plausible=0.05),
    seen_in=("turn",),
    columns=lambda movement: diagonal(np.abs(movement.rate)),
    says=lambda theta: (
        f"positive and negative turns differ in scale by {200 * abs(largest(theta)):.2f} % on {axis_of(theta)}: "
        "keep one sensitivity for each sense"
    ),
    splits="record the same turn both ways about each axis, slow and fast",
    regime=("rate", "dps"),
)
