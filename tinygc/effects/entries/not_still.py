"""The sensor turned slowly while it was meant to be still."""

import numpy as np

from tinygc.effects.effect import Effect, Parameter

EFFECT = Effect(
    id="reference.not_still",
    equation="in some stills the body turns",
    parameter=Parameter("stills", (), ""),
    seen_in=("still", "reference"),
    kind="register",
    columns=lambda movement: np.zeros((*movement.rate.shape, 1)),
    says=lambda theta: f"{theta[0]:.0f} stills were not still: lock the table before each still; they are passed over here",
    splits="lock the table, and record again",
    regime=("time", "s"),
)
