"""The sensitivity moves with temperature (IEEE 528: scale factor temperature sensitivity)."""

import numpy as np

from tinygc.effects import Effect, Parameter, PerAxisC, axis_of, diagonal, largest
from tinygc.effects.effect import SCALE_LAW

EFFECT = Effect(
    id="gyro.thermal_scale",
    equation="ω_i += s_i (T − T₀) ω_i, T₀ the temperature of the first sample",
    parameter=Parameter("per_c", (3,), "1/°C", plausible=0.02),
    observable_in=("turn",),
    columns=lambda movement: diagonal((movement.temp_c - movement.first_temp_c)[:, None] * movement.rate),
    describe=lambda theta: (
        f"the sensitivity moves {1e6 * abs(largest(theta)):.0f} ppm per °C on {axis_of(theta)}: "
        "let it warm up, or keep temperature in the model"
    ),
    discriminating_motion="let the sensor cool while you turn it: temperature then falls while time goes on",
    conditions=("temperature", "°C"),
    picture=SCALE_LAW,
    inputs=("temperature",),
    device=PerAxisC(
        name="THERMAL_SCALE",
        formula="r -= k (T - T0) r (gyro.thermal_scale)",
        constants=lambda theta, known: {"THERMAL_SCALE": theta, "THERMAL_SCALE_AT_C": np.array([known.first_temp_c])},
        numpy=lambda c, w, inputs: c["THERMAL_SCALE"] * (inputs.temp_c - c["THERMAL_SCALE_AT_C"])[:, None] * w,
    ),
)
