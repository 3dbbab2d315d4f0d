"""ArduPilot: INS_GYROFFS_*, INS_TCAL1_*, INS_ACCOFFS_* and INS_ACCSCAL_*, as a parameter file of its ground stations.

Its temperature polynomial is about 35 degC and is subtracted twice (AP_InertialSensor_tempcal): at the present temperature, and, with
the opposite sign, at INS_GYR1_CALTEMP, where the offsets hold.  For a straight line the 35 degC cancel.

The noise of EKF3 is a file of its own.  EK3_GYRO_P_NSE and EK3_ACC_P_NSE are of one step of the filter (rad/s, m/s^2), no densities: its
covariance grows by (dt p)^2 a step (AP_NavEKF3_core, CovariancePrediction).  The biases are those of an angle and a velocity of one step,
which grow by (dt^2 p)^2; as rates they grow by (dt p)^2, too, with EK3_GBIAS_P_NSE and EK3_ABIAS_P_NSE.
"""

from __future__ import annotations

import numpy as np

from tinygc.deploy.exports._autopilots import StepParameter, step_parameters, zero_of
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._text import remarks
from tinygc.models.model import Model

NAME = "ardupilot"
FILE, NOISE_FILE = "ardupilot.param", "ardupilot-noise.param"
ABOUT_C = 35.0  #: reference of its polynomial
SCALE = 1e6  #: factor of the polynomial's coefficients
#: bytes of a line: ArduPilot reads its own file (defaults.parm) 98 at a time, and takes the rest of a long comment for a parameter
LONGEST = 96
LEAST_C = 10.0  #: INS_TCAL1_TMAX must exceed INS_TCAL1_TMIN by this much
STEP_S = 0.012  #: of the filter: EKF_TARGET_DT
#: defaults and ranges of ArduPilot's AP_NavEKF3.cpp
NOISE = (
    StepParameter("EK3_GYRO_P_NSE", ("gyro", "N"), 0.015, 1e-4, 0.1),
    StepParameter("EK3_ACC_P_NSE", ("accel", "N"), 0.35, 0.01, 1.0),
    StepParameter("EK3_GBIAS_P_NSE", ("gyro", "K"), 0.001, 1e-5, 0.001),
    StepParameter("EK3_ABIAS_P_NSE", ("accel", "K"), 0.02, 1e-5, 0.02),
)


def export(model: Model, context: Context) -> dict[str, str]:
    """Export the zero of linear models, also with thermal bias or over temperature; the noise where figures are known."""
    zero = zero_of(model, context, NAME, ABOUT_C)
    values = {f"INS_GYROFFS_{axis}": value for axis, value in zip("XYZ", zero.part.bias, strict=True)}
    if zero.range_c is not None:
        coldest, warmest = zero.range_c
        values |= {"INS_TCAL1_ENABLE": 1, "INS_TCAL1_TMIN": coldest, "INS_TCAL1_TMAX": max(warmest, coldest + LEAST_C)}
        values |= {"INS_GYR1_CALTEMP": zero.reference_c}
        for sensor, terms in (("GYR", zero.terms), ("ACC", zero.accel)):
            if terms is not None:
                values |= {f"INS_TCAL1_{sensor}{n}_{axis}": terms[n, i] * SCALE for n in (1, 2, 3) for i, axis in enumerate("XYZ")}
    for name, of_axes in zip(("OFFS", "SCAL"), zero.force or (), strict=False):
        values |= {f"INS_ACC{name}_{axis}": value for axis, value in zip("XYZ", of_axes, strict=True)}
    accel = "INS_TCAL1_ACC* likewise, m/s^2; INS_ACC1_CALTEMP is set by ArduPilot's own accelerometer calibration, which comes first."
    head = remarks(
        context,
        *zero.head,
        "corrected = measured - INS_GYROFFS_* - p(T - 35) + p(INS_GYR1_CALTEMP - 35),  p(d) = 1e-6 (GYR1 d + GYR2 d^2 + GYR3 d^3),",
        "T and CALTEMP held within INS_TCAL1_TMIN to TMAX.",
        *(("corrected = (measured - INS_ACCOFFS_*) INS_ACCSCAL_*, m/s^2",) if zero.force else ()),
        *((accel,) if zero.accel is not None else ()),
        "rad/s, degC, in the axes of the first IMU as ArduPilot's driver turns them.  It calibrates the gyro's offset again at each boot",
        "unless INS_GYR_CAL is 0.",
        longest=LONGEST,
    )
    return {FILE: head + table(values)} | (export_noise(context) if context.noise is not None else {})


def export_noise(context: Context) -> dict[str, str]:
    """Export the parameters of EKF3's noise, which need no model."""
    values, lines = step_parameters(context, NAME, NOISE, STEP_S, f"{STEP_S:g} s, EKF_TARGET_DT")
    return {NOISE_FILE: remarks(context, *lines, longest=LONGEST) + table(values)}


def table(values: dict[str, float]) -> str:
    """Return the parameter file, one parameter per line."""
    return "".join(f"{name},{np.float32(value):.9g}\n" for name, value in values.items())
