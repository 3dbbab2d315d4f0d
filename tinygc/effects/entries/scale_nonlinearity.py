"""The scale factor changes with the rate: a cubic, odd term (IEEE 528: scale factor nonlinearity)."""

from tinygc.effects import Effect, Parameter, PerAxisC, axis_of, diagonal, largest
from tinygc.effects.effect import SCALE_LAW

EFFECT = Effect(
    id="gyro.scale_nonlinearity",
    equation="ω_i += c_i FS (ω_i / FS)³, FS the full scale",
    parameter=Parameter("cubic_at_fs", (3,), "fraction of full scale", plausible=0.3),
    observable_in=("turn",),
    columns=lambda movement: diagonal(movement.rate * (movement.rate / movement.fs_rps) ** 2),  # a square is quick, a cube is not
    describe=lambda theta: (
        f"fast turns read {'more' if largest(theta) > 0 else 'less'} (cubic, "
        f"{100 * abs(largest(theta)):.2f} % at full scale "
        f"on {axis_of(theta)}): keep the cubic in the model, or stay at the rates that were calibrated"
    ),
    discriminating_motion="record slow and fast turns about each axis, both ways",
    conditions=("rate", "dps"),
    picture=SCALE_LAW,
    device=PerAxisC(
        name="SCALE_NONLINEARITY",
        formula="r -= k r^3 (gyro.scale_nonlinearity)",
        constants=lambda theta, known: {"SCALE_NONLINEARITY": theta / known.fs_rps**2},
        numpy=lambda c, w, inputs: c["SCALE_NONLINEARITY"] * (w * w * w),
    ),
)
