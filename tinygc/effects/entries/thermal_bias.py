"""The gyro's zero moves with temperature (IEEE 528: bias temperature sensitivity)."""

import numpy as np

from session.common.units import DEG
from tinygc.effects.effect import Effect, Movement, Parameter, axis_of, diagonal, largest


def _columns(movement: Movement) -> np.ndarray:
    return diagonal(movement.temp_c - movement.first_temp_c)


EFFECT = Effect(
    id="gyro.thermal_bias",
    equation="ω += k (T − T₀), T₀ the temperature of the first sample",
    parameter=Parameter("dps_per_c", (3,), "dps/°C", DEG, plausible=0.5 * DEG),
    seen_in=("still", "turn"),
    columns=_columns,
    says=lambda theta: (
        f"the gyro's zero moves {abs(largest(theta)) / DEG:.4f} dps per °C on {axis_of(theta)}: "
        "let it warm up, or keep temperature in the model"
    ),
    splits="let the sensor cool while you record: temperature then falls while time goes on",
    regime=("temperature", "°C"),
    needs="temperature",
)
