"""PX4: CAL_GYRO0_* offsets and TC_G0_* temperature terms, as a parameter file of QGroundControl."""

from __future__ import annotations

import numpy as np

from tinygc.deploy.exports._autopilot import cannot_scale, offsets
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._remarks import remarks
from tinygc.models.model import Model

NAME = "px4"
SUMMARY = "PX4 parameters: gyroscope offsets and temperature terms (no scale)"
INT32, FLOAT = 6, 9  #: MAVLink's parameter types


def export(model: Model, context: Context) -> dict[str, str]:
    """The zero of linear models, with thermal bias."""
    part, celsius = offsets(model, context, NAME)
    rates = {f"CAL_GYRO0_{axis}OFF": value for axis, value in zip("XYZ", part.bias, strict=True)}
    if celsius is not None:
        slope = part.M @ part.k
        rates |= {"TC_G0_TMIN": celsius[0], "TC_G0_TMAX": celsius[1], "TC_G0_TREF": part.first_c}
        rates |= {f"TC_G0_X{power}_{axis}": slope[axis] if power == 1 else 0.0 for power in range(4) for axis in range(3)}
    head = remarks(
        context,
        *cannot_scale(part),
        "corrected = measured - CAL_GYRO0_*OFF - (TC_G0_X1_* dT + TC_G0_X2_* dT^2 + TC_G0_X3_* dT^3),  dT = T - TC_G0_TREF",
        "rad/s, degC, in the sensor's axes before PX4 rotates the board.  CAL_GYRO0_ID (and TC_G0_ID) must hold this sensor's device id:",
        "they are not known here, and PX4 takes no offset without them.  Change the 0 if it is another instance.",
    )
    lines = [f"1\t1\t{name}\t{np.float32(value):.9g}\t{FLOAT}\n" for name, value in rates.items()]
    switch = [f"1\t1\tTC_G_ENABLE\t1\t{INT32}\n"] if celsius is not None else []
    return {"px4.params": head + "# Vehicle-Id\tComponent-Id\tName\tValue\tType\n" + "".join(switch + lines)}
