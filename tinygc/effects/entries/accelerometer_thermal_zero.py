"""The accelerometer's zero moves with temperature (IEEE 1293: bias temperature sensitivity)."""

from session.base.units import MG
from tinygc.effects import Effect, Parameter, axis_of, diagonal, largest, nothing
from tinygc.effects.device import OF_FORCE
from tinygc.effects.effect import GRAVITY_LAW

EFFECT = Effect(
    id="accelerometer.thermal_zero",
    equation="f_i += b_i (T − T₀), T₀ the temperature of the first sample",
    parameter=Parameter("mg_per_c", (3,), "mg/°C", MG, plausible=10 * MG),
    observable_in=("reference",),
    kind="force",
    columns=nothing(3),
    bends=lambda movement: diagonal((movement.temp_c - movement.first_temp_c)[:, None] + 0 * movement.force_g),
    describe=lambda theta: (
        f"the accelerometer's zero moves {abs(largest(theta)) / MG:.2f} mg per °C on {axis_of(theta)}: "
        "let it warm up, or calibrate it over temperature"
    ),
    discriminating_motion="come back to the first attitudes warm and after it has cooled: temperature's part comes back, a drift stays",
    inputs=("temperature",),
    conditions=("temperature", "°C"),
    picture=GRAVITY_LAW,
    device=OF_FORCE,
)
