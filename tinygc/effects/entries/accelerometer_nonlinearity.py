"""The accelerometer's output bends with the square of the force (IEEE 1293: second-order nonlinearity coefficient K2)."""

from session.base.units import MG
from tinygc.effects import Effect, Parameter, axis_of, diagonal, largest, nothing
from tinygc.effects.device import OF_FORCE
from tinygc.effects.effect import GRAVITY_LAW

EFFECT = Effect(
    id="accelerometer.nonlinearity",
    equation="f_i += K2_i f_i²",
    parameter=Parameter("mg_per_g2", (3,), "mg/g²", MG, plausible=20 * MG),
    observable_in=("reference",),
    kind="force",
    columns=nothing(3),
    bends=lambda movement: diagonal(movement.force_g**2),
    describe=lambda theta: (
        f"the accelerometer bends by {abs(largest(theta)) / MG:.2f} mg per g² on {axis_of(theta)}: "
        "correct K2, or trust its tilt to that size"
    ),
    discriminating_motion="hold each axis up, down, level and at 45°: a zero error is the same in all of them, K2 f² is not",
    conditions=("attitude", "g"),
    picture=GRAVITY_LAW,
    device=OF_FORCE,
)
