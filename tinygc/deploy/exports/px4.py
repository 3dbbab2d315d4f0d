"""PX4: CAL_GYRO0_* offsets, TC_G0_* temperature terms, CAL_ACC0_* offsets and scales, as a parameter file of QGroundControl.

The noise of EKF2 is a file of its own.  EKF2_GYR_NOISE and EKF2_ACC_NOISE are of one step of the filter (rad/s, m/s^2), no densities: its
covariance grows by (dt p)^2 a step (ekf2, covariance.cpp), and so does that of a bias with EKF2_GYR_B_NOISE and EKF2_ACC_B_NOISE.
"""

from __future__ import annotations

import numpy as np

from tinygc.deploy.exports._autopilots import StepParameter, step_parameters, zero_of
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._text import remarks
from tinygc.models.model import Model

NAME = "px4"
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
    zero = zero_of(model, context, NAME)
    values = {f"CAL_GYRO0_{axis}OFF": value for axis, value in zip("XYZ", zero.terms[0], strict=True)}
    over = {sensor: terms for sensor, terms in (("G", zero.terms), ("A", zero.accel)) if zero.range_c and terms is not None}
    for sensor, terms in over.items():
        ends = zip(("TMIN", "TMAX", "TREF"), (*(zero.range_c or ()), zero.reference_c), strict=True)
        values |= {f"TC_{sensor}0_{name}": value for name, value in ends}
        values |= {f"TC_{sensor}0_X{power}_{axis}": terms[power, axis] if power else 0.0 for power in range(4) for axis in range(3)}
    for name, of_axes in zip(("OFF", "SCALE"), zero.force or (), strict=False):
        values |= {f"CAL_ACC0_{axis}{name}": value for axis, value in zip("XYZ", of_axes, strict=True)}
    accel = "TC_A0 likewise, m/s^2: what the accelerometer reads otherwise than at TC_A0_TREF in the one attitude in which it lay."
    head = remarks(
        context,
        *zero.head,
        "corrected = measured - CAL_GYRO0_*OFF - (TC_G0_X1_* dT + TC_G0_X2_* dT^2 + TC_G0_X3_* dT^3),  dT = T - TC_G0_TREF, T held",
        "within TC_G0_TMIN to TC_G0_TMAX.",
        *(("corrected = (measured - CAL_ACC0_*OFF) CAL_ACC0_*SCALE, m/s^2",) if zero.force else ()),
        *((accel,) if "A" in over else ()),
        "rad/s, degC, in the sensor's axes before PX4 rotates the board.  CAL_GYRO0_ID, CAL_ACC0_ID (and TC_G0_ID, TC_A0_ID) must hold its",
        "id: they are not known here, and PX4 takes no offset without them.  Change the 0 if it is another instance.",
    )
    return {FILE: head + table(values, tuple(over))} | (export_noise(context) if context.noise is not None else {})


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
