"""The gyro's zero-rate offset bends with temperature: needs a temperature."""

import numpy as np

from session.base.units import DEG
from tinygc.effects import Effect, Movement, Parameter, PerAxisC, axis_of, diagonal, largest


def _columns(movement: Movement) -> np.ndarray:
    return diagonal((movement.temp_c - movement.first_temp_c) ** 2)


EFFECT = Effect(
    id="gyro.thermal_curvature",
    equation="ω += k (T − T₀)², T₀ the temperature of the first sample",
    parameter=Parameter("dps_per_c2", (3,), "dps/°C²", DEG, plausible=0.1 * DEG),
    observable_in=("still", "turn"),
    columns=_columns,
    describe=lambda theta: (
        f"the gyro's zero-rate offset bends with temperature, {abs(largest(theta)) / DEG:.5f} dps per °C² on {axis_of(theta)}"
    ),
    discriminating_motion="let the sensor warm up, cool, and warm up again",
    inputs=("temperature",),
    conditions=("temperature", "°C"),
    device=PerAxisC(
        name="THERMAL_CURVATURE",
        formula="r -= k (T - T0)^2 (gyro.thermal_curvature)",
        constants=lambda theta, known: {"THERMAL_CURVATURE": theta, "THERMAL_CURVATURE_AT_C": np.array([known.first_temp_c])},
        numpy=lambda c, w, inputs: c["THERMAL_CURVATURE"] * _square(inputs.temp_c - c["THERMAL_CURVATURE_AT_C"])[:, None],
        passes=1,
    ),
)


def _square(values: np.ndarray) -> np.ndarray:
    return values * values
