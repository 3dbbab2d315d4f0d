"""The accelerometer's pre-calibration no longer holds: a bias has crept in.  It bends the reference, not the rate."""

from session.common.units import MG
from tinygc.effects import Effect, Parameter, axis_of, largest, nothing
from tinygc.effects.picture import GRAVITY_LENGTH

EFFECT = Effect(
    id="reference.accelerometer",
    equation="f = f measured - b: the reference's attitudes and the length of gravity move with attitude",
    parameter=Parameter("bias_mg", (3,), "mg", MG, plausible=100 * MG),
    seen_in=("reference",),
    kind="force",
    columns=nothing(3),
    says=lambda theta: (
        f"the accelerometer is off by {abs(largest(theta)) / MG:.1f} mg on {axis_of(theta)} since its pre-calibration: "
        "calibrate it again before trusting the gyro's"
    ),
    splits="hold each axis of the accelerometer up and down: gravity's length must not change",
    regime=("attitude", "g"),
    picture=GRAVITY_LENGTH,
)
