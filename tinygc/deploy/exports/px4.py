"""PX4: CAL_GYRO0_* offsets, TC_G0_* temperature terms, CAL_ACC0_* offsets and scales, as a parameter file of QGroundControl.

The noise of EKF2 is a file of its own.  EKF2_GYR_NOISE and EKF2_ACC_NOISE are of one step of the filter (rad/s, m/s^2), no densities: its
covariance grows by (dt p)^2 a step (ekf2, covariance.cpp), and so does that of a bias with EKF2_GYR_B_NOISE and EKF2_ACC_B_NOISE.
"""

from __future__ import annotations

import numpy as np

from tinygc.deploy import feature_exports
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._noise import StepParameter, step_parameters
from tinygc.deploy.exports._text import cannot_scale, force_terms, offsets, remarks
from tinygc.models.model import Model

NAME = "px4"
SUMMARY = "PX4 parameters: gyroscope offsets and temperature terms (no scale), accelerometer offsets and scales; noise of EKF2"
FILE, NOISE_FILE = "px4.params", "px4-noise.params"
INT32, FLOAT = 6, 9  #: MAVLink's parameter types
STEP_S = 0.01  #: of the filter: EKF2_PREDICT_US
#: defaults and ranges of PX4's module.yaml of ekf2
NOISE = (
    StepParameter("EKF2_GYR_NOISE", ("gyro", "N"), 0.015, 1e-4, 0.1),
    StepParameter("EKF2_ACC_NOISE", ("accel", "N"), 0.35, 0.01, 1.0),
    StepParameter("EKF2_GYR_B_NOISE", ("gyro", "K"), 0.001, 0.0, 0.01),
    StepParameter("EKF2_ACC_B_NOISE", ("accel", "K"), 0.003, 0.0, 0.01),
)


def export(model: Model, context: Context) -> dict[str, str]:
    """Export the zero of linear models, also with thermal bias or over temperature; the noise where figures are known."""
    noise = export_noise(context) if context.noise is not None else {}
    if (feature := feature_exports(model)) is not None:
        return {FILE: feature.px4(model, context)} | noise
    part, celsius = offsets(model, context, NAME)
    rates = {f"CAL_GYRO0_{axis}OFF": value for axis, value in zip("XYZ", part.bias, strict=True)}
    if celsius is not None:
        slope = part.M @ part.k
        rates |= {"TC_G0_TMIN": celsius[0], "TC_G0_TMAX": celsius[1], "TC_G0_TREF": part.first_c}
        rates |= {f"TC_G0_X{power}_{axis}": slope[axis] if power == 1 else 0.0 for power in range(4) for axis in range(3)}
    force = force_terms(context, NAME)
    if force is not None:
        rates |= {f"CAL_ACC0_{axis}OFF": value for axis, value in zip("XYZ", force[0], strict=True)}
        rates |= {f"CAL_ACC0_{axis}SCALE": value for axis, value in zip("XYZ", force[1], strict=True)}
    head = remarks(
        context,
        *cannot_scale(part),
        *(() if force is None else force[2]),
        "corrected = measured - CAL_GYRO0_*OFF - (TC_G0_X1_* dT + TC_G0_X2_* dT^2 + TC_G0_X3_* dT^3),  dT = T - TC_G0_TREF",
        *(() if force is None else ("corrected = (measured - CAL_ACC0_*OFF) CAL_ACC0_*SCALE, m/s^2",)),
        "rad/s, degC, in the sensor's axes before PX4 rotates the board.  CAL_GYRO0_ID, CAL_ACC0_ID (and TC_G0_ID) must hold its id:",
        "they are not known here, and PX4 takes no offset without them.  Change the 0 if it is another instance.",
    )
    return {FILE: head + table(rates, ("G",) if celsius is not None else ())} | noise


def export_noise(context: Context) -> dict[str, str]:
    """Export the parameters of EKF2's noise, which need no model."""
    values, lines = step_parameters(context, NAME, NOISE, STEP_S, f"{STEP_S:g} s, EKF2_PREDICT_US")
    lines += ("EKF2 stops adding to the variance of a bias where it reaches the square of EKF2_GYR_NOISE or EKF2_ACC_NOISE.",)
    return {NOISE_FILE: remarks(context, *lines) + table(values, ())}


def table(values: dict[str, float], switches: tuple[str, ...]) -> str:
    """Return the parameter file, one parameter per line."""
    lines = [f"1\t1\tTC_{sensor}_ENABLE\t1\t{INT32}\n" for sensor in switches]
    lines += [f"1\t1\t{name}\t{np.float32(value):.9g}\t{FLOAT}\n" for name, value in values.items()]
    return "# Vehicle-Id\tComponent-Id\tName\tValue\tType\n" + "".join(lines)
