"""Samples were lost and the stamps closed up over the loss, so that no gap shows."""

from tinygc.effects import Effect, Occurrence, Parameter, nothing
from tinygc.effects.effect import LOST_SAMPLES, SECONDS

EFFECT = Effect(
    id="timing.dropped_samples",
    equation="at some moments `length` samples are missing, and the stamps go on as if none were",
    parameter=Parameter("length", (), "samples"),
    observable_in=("timing", "turn"),
    kind="register",
    columns=nothing(1),
    describe=lambda theta: (
        f"{theta[0]:.0f} samples at a time are lost without a gap in the stamps: "
        "stamp in the sensor, count the frames, empty its FIFO in time"
    ),
    discriminating_motion="log the sensor's own time stamps with the samples",
    conditions=("time", "s"),
    occurs=Occurrence("at_s", SECONDS),
    picture=LOST_SAMPLES,
)
