"""The first second of a stream: does it look like an accelerometer and a gyroscope at the data rate that was said?"""

from __future__ import annotations

import numpy as np

from session.common.units import STANDARD_GRAVITY_MPS2, G
from session.log.samples import Samples

CHECK_S = 1.0
FEWEST = 50
GRAVITY_RATIO = (0.75, 1.33)  #: of the median specific force to gravity; a wrong full scale is a factor of 2
#: the same of an accelerometer that nobody has calibrated: an MPU-9250 whose z zero is at 0.5 g reads 0.5 or 1.5 g level
UNCALIBRATED_RATIO = (0.3, 2.5)
ODR_RATIO = 0.10  #: true rates are off by up to 5 %


def stream_problem(samples: Samples, odr_hz: float, accel_fs_g: float, calibrated: bool = True) -> str:
    """What is wrong with samples of a second or so, with number and bar; empty where nothing is.  calibrated: the accelerometer."""
    steps = samples.dt_s
    if len(steps) == 0 or not (steps > 0).all():
        return "the stamps do not increase: device time in microseconds is expected"
    found_hz = 1 / samples.period_s
    if abs(found_hz / odr_hz - 1) > ODR_RATIO:
        return f"data rate {found_hz:.1f} Hz by the stamps, {odr_hz:g} Hz expected (bar {100 * ODR_RATIO:.0f} %): --odr {found_hz:.0f}?"
    if not (samples.accel.any() and np.ptp(samples.accel, axis=0).any()):
        return "the accelerometer does not change at all: is it on?"
    if not np.ptp(samples.gyro, axis=0).all():
        axis = "xyz"[int(np.argmin(np.ptp(samples.gyro, axis=0)))]
        return f"the gyro's {axis} does not change at all: is it on?"
    force = float(np.median(np.linalg.norm(samples.accel, axis=1)))
    ratio = force / STANDARD_GRAVITY_MPS2
    low, high = GRAVITY_RATIO if calibrated else UNCALIBRATED_RATIO
    if not low < ratio < high:
        return f"specific force {force / G:.2f} g, {low:g} to {high:g} g expected: was the range really ±{accel_fs_g:g} g?"
    return ""
