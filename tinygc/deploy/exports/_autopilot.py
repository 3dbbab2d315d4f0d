"""What PX4 and ArduPilot share: a gyroscope's zero and temperature terms without scale, an accelerometer's zero and scale of each axis."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG
from tinygc.deploy.errors import ExportError
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._linear import LinearPart, linear_part
from tinygc.models.model import Model

#: degC around the session's temperatures within which a straight line may be trusted
BEYOND_C = 5.0
#: scales that ArduPilot takes (INS_ACCSCAL_*); beyond them the axes are others
SCALES = (0.8, 1.2)


def offsets(model: Model, context: Context, name: str) -> tuple[LinearPart, tuple[float, float] | None]:
    """The linear part, and the range of temperatures of a model that follows temperature; says what is lost."""
    part = linear_part(model, name, carries=("temperature",))
    full_scale = context.config.sensor.gyro_fs_dps
    lost = np.abs(part.E - np.eye(3)).sum(axis=1).max()
    context.say(
        f"{name} carries the gyroscope's offsets and temperature terms only, no scale and no misalignment: "
        f"up to {100 * lost:.2f} % of the rate, {lost * full_scale:.2g} dps at {full_scale:g} dps, stays uncorrected"
    )
    if not part.k.any():
        return part, None
    warmest = context.temperature_c()
    if warmest is None or not np.isfinite(part.first_c):
        raise ExportError(f"{name} needs the range of temperatures, which the session's logs do not tell")
    return part, (warmest[0] - BEYOND_C, warmest[1] + BEYOND_C)


def cannot_scale(part: LinearPart) -> tuple[str, ...]:
    """For the file's head."""
    errors = ", ".join(f"{1e6 * (value - 1):+.0f}" for value in np.diag(part.M))
    return (
        "SCALE CANNOT BE CARRIED of the gyroscope: these parameters hold its offsets only.  Left uncorrected: scale factor errors of",
        f"{errors} ppm (x, y, z) and misalignment; apply the whole calibration in the driver if that matters.",
        f"Offsets in deg/s: {', '.join(f'{value / DEG:+.4f}' for value in part.bias)}; they are this switch-on's.",
    )


def force_terms(context: Context, name: str) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]] | None:
    """Offsets (3,) m/s^2 and scales (3,) of the accelerometer, and words for the file's head; None where there is nothing to carry.

    corrected = (measured - offset) scale is all that these parameters know.  What the matrix has beside its diagonal is lost: said.
    """
    accelerometer = context.accelerometer
    if accelerometer.source == "none":
        context.say(f"{name}: nobody has calibrated the accelerometer: its parameters are left out")
        return None
    scale = np.diag(accelerometer.matrix)
    if not ((scale > SCALES[0]) & (scale < SCALES[1])).all():
        values = ", ".join(f"{value:.3f}" for value in scale)
        context.say(f"{name}: the accelerometer's matrix turns its axes (diagonal {values}): its parameters are left out")
        return None
    lost = float(np.abs(accelerometer.matrix - np.diag(scale)).sum(axis=1).max())
    words = f"up to {1e3 * lost:.2g} mrad, {1e3 * lost:.2g} mg at one g"
    context.say(f"{name} carries an offset and a scale of each of the accelerometer's axes; what leans between them stays: {words}")
    return (
        accelerometer.bias_mps2,
        scale,
        (
            f"Accelerometer: {context.accelerometer_words}",
            f"Its nonorthogonality, and a turn of its frame, cannot be carried: {words}.",
        ),
    )
