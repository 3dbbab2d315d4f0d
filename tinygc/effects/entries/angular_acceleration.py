"""The output follows angular acceleration, cross-axis too (IEEE 528: sensitivity to angular acceleration)."""

from tinygc.effects import AHEAD, NEIGHBOURS, CommonDelay, Effect, Parameter, full, largest
from tinygc.effects.effect import LAG_LAW

EFFECT = Effect(
    id="gyro.angular_acceleration",
    equation="ω += C dω/dt",
    parameter=Parameter("cross", (3, 3), "s", plausible=0.05),
    observable_in=("turn",),
    columns=lambda movement: full(movement.acceleration),
    describe=lambda theta: (
        f"the output follows angular acceleration by up to {abs(largest(theta)) * 1e3:.1f} ms: "
        "keep dω/dt of all axes in the model, or turn more gently"
    ),
    discriminating_motion="turn about one axis at a time, with sharp starts and stops",
    reach=NEIGHBOURS,
    conditions=("angular acceleration", "rad/s²"),
    picture=LAG_LAW,
    gauge_convention=CommonDelay((0, 4, 8), late=-1.0),  # the diagonal is a common delay plus differences
    device=AHEAD,
)
