"""The accelerometer's sensitivity moves with temperature (IEEE 1293: scale factor temperature sensitivity)."""

from session.base.units import PPM, G
from tinygc.effects import Effect, Parameter, axis_of, diagonal, largest, nothing
from tinygc.effects.device import OF_FORCE
from tinygc.effects.effect import GRAVITY_LAW

EFFECT = Effect(
    id="accelerometer.thermal_scale",
    equation="f_i += s_i (T − T₀) f_i, T₀ the temperature of the first sample",
    parameter=Parameter("ppm_per_c", (3,), "ppm/°C", PPM, plausible=2000 * PPM),
    observable_in=("reference",),
    kind="force",
    columns=nothing(3),
    bends=lambda movement: diagonal((movement.temp_c - movement.first_temp_c)[:, None] * movement.force_g * G),
    describe=lambda theta: (
        f"the accelerometer's sensitivity moves {abs(largest(theta)) / PPM:.0f} ppm per °C on {axis_of(theta)}: "
        "let it warm up, or calibrate it over temperature"
    ),
    discriminating_motion="hold each axis up and down, cold and warm: a scale moves both readings apart, a zero moves them together",
    inputs=("temperature",),
    conditions=("temperature", "°C"),
    picture=GRAVITY_LAW,
    device=OF_FORCE,
)
