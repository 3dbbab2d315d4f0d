"""The accelerometer's zero moves with time: to first order steadily, about its value at the middle of the session."""

from session.base.units import MG
from tinygc.effects import BYGONE, Effect, Parameter, axis_of, diagonal, largest, nothing
from tinygc.effects.effect import GRAVITY_LAW

EFFECT = Effect(
    id="accelerometer.zero_drift",
    equation="f_i += d_i (t − half the length of the session)",
    parameter=Parameter("mg_per_1000s", (3,), "mg/1000s", MG / 1000, plausible=100 * MG / 1000),
    observable_in=("reference",),
    kind="force",
    columns=nothing(3),
    bends=lambda movement: diagonal((movement.t_s - movement.duration_s / 2)[:, None] + 0 * movement.force_g),
    describe=lambda theta: (
        f"the accelerometer's zero drifts by {abs(largest(theta)) * 1000 / MG:.1f} mg in 1000 s on {axis_of(theta)}: "
        "let it warm up, and calibrate it again where tilt matters"
    ),
    discriminating_motion="come back to attitudes of the beginning at the end: gravity's length in them must not change",
    inputs=("time",),
    conditions=("time", "s"),
    picture=GRAVITY_LAW,
    device=BYGONE,
)
