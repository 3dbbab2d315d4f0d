"""ArduPilot: INS_GYROFFS_* and INS_TCAL1_*, as a parameter file of its ground stations.

Its temperature polynomial stands on 35 degC and is taken off twice (AP_InertialSensor_tempcal): at the present temperature, and, with
the other sign, at INS_GYR1_CALTEMP, where the offsets hold.  Of a straight line the 35 degC cancel.
"""

from __future__ import annotations

import numpy as np

from tinygc.deploy.exports._autopilot import cannot_scale, offsets
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._remarks import remarks
from tinygc.models.model import Model

NAME = "ardupilot"
SUMMARY = "ArduPilot parameters: gyroscope offsets and temperature terms (no scale)"
SCALE = 1e6  #: of the polynomial's coefficients
LEAST_C = 10.0  #: INS_TCAL1_TMAX must be so far above INS_TCAL1_TMIN


def export(model: Model, context: Context) -> dict[str, str]:
    """The zero of linear models, with thermal bias."""
    part, celsius = offsets(model, context, NAME)
    values = {f"INS_GYROFFS_{axis}": value for axis, value in zip("XYZ", part.bias, strict=True)}
    if celsius is not None:
        slope = part.M @ part.k * SCALE
        values |= {"INS_TCAL1_ENABLE": 1, "INS_TCAL1_TMIN": celsius[0], "INS_TCAL1_TMAX": max(celsius[1], celsius[0] + LEAST_C)}
        values |= {"INS_GYR1_CALTEMP": part.first_c}
        values |= {f"INS_TCAL1_GYR{power}_{axis}": slope[i] if power == 1 else 0.0 for power in (1, 2, 3) for i, axis in enumerate("XYZ")}
    head = remarks(
        context,
        *cannot_scale(part),
        "corrected = measured - INS_GYROFFS_* - p(T - 35) + p(INS_GYR1_CALTEMP - 35),  p(d) = 1e-6 (GYR1 d + GYR2 d^2 + GYR3 d^3)",
        "rad/s, degC, in the axes of the first IMU as ArduPilot's driver turns them.  It calibrates the offset anew at each boot unless",
        "INS_GYR_CAL is 0.",
    )
    return {"ardupilot.param": head + "".join(f"{name},{np.float32(value):.9g}\n" for name, value in values.items())}
