"""The gyro's zero-rate offset moves with temperature (IEEE 528: bias temperature sensitivity)."""

import numpy as np

from session.base.units import DEG
from tinygc.effects import Effect, Movement, Parameter, PerAxisC, axis_of, diagonal, largest


def _columns(movement: Movement) -> np.ndarray:
    return diagonal(movement.temp_c - movement.first_temp_c)


EFFECT = Effect(
    id="gyro.thermal_bias",
    equation="ω += k (T − T₀), T₀ the temperature of the first sample",
    parameter=Parameter("dps_per_c", (3,), "dps/°C", DEG, plausible=0.5 * DEG),
    observable_in=("still", "turn"),
    columns=_columns,
    describe=lambda theta: (
        f"the gyro's zero-rate offset moves {abs(largest(theta)) / DEG:.4f} dps per °C on {axis_of(theta)}: "
        "let it warm up, or keep temperature in the model"
    ),
    discriminating_motion="let the sensor cool while you record: temperature then falls while time goes on",
    conditions=("temperature", "°C"),
    inputs=("temperature",),
    device=PerAxisC(
        name="THERMAL_BIAS",
        formula="r -= k (T - T0) (gyro.thermal_bias)",
        constants=lambda theta, known: {"THERMAL_BIAS": theta, "THERMAL_BIAS_AT_C": np.array([known.first_temp_c])},
        numpy=lambda c, w, inputs: c["THERMAL_BIAS"] * (inputs.temp_c - c["THERMAL_BIAS_AT_C"])[:, None],
        passes=1,
    ),
    linear_in="temperature",
)
