"""Isolated false readings of the gyro."""

from tinygc.effects import Effect, Occurrence, Parameter, nothing
from tinygc.effects.effect import FALSE_READINGS, ROWS

EFFECT = Effect(
    id="data.glitches",
    equation="at some rows the gyro reads what it did not feel, for a few samples",
    parameter=Parameter("samples", (), "samples"),
    observable_in=("timing",),
    kind="register",
    columns=nothing(1),
    describe=lambda theta: (
        f"isolated false readings, {theta[0]:.0f} samples long each: they are bridged here; "
        "look at the bus and the cable, and check each word"
    ),
    discriminating_motion="log the raw bus words with the samples",
    conditions=("time", "s"),
    occurs=Occurrence("at", ROWS),
    picture=FALSE_READINGS,
)
