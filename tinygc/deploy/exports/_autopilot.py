"""What PX4 and ArduPilot share: they hold a gyroscope's zero and its temperature terms, and no scale."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG
from tinygc.deploy.errors import ExportError
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._linear import LinearPart, linear_part
from tinygc.models.model import Model

#: degC around the session's temperatures within which a straight line may be trusted
BEYOND_C = 5.0


def offsets(model: Model, context: Context, name: str) -> tuple[LinearPart, tuple[float, float] | None]:
    """The linear part, and the range of temperatures of a model that follows temperature; says what is lost."""
    part = linear_part(model, name, carries=("temperature",))
    full_scale = context.config.sensor.gyro_fs_dps
    lost = np.abs(part.E - np.eye(3)).sum(axis=1).max()
    context.say(
        f"{name} carries offsets and temperature terms only, no scale and no misalignment: up to {100 * lost:.2f} % of the rate, "
        f"{lost * full_scale:.2g} dps at {full_scale:g} dps, stays uncorrected"
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
        "SCALE CANNOT BE CARRIED: these parameters hold offsets only.  Left uncorrected: scale factor errors of",
        f"{errors} ppm (x, y, z) and misalignment; apply the whole calibration in the driver if that matters.",
        f"Offsets in deg/s: {', '.join(f'{value / DEG:+.4f}' for value in part.bias)}; they are this switch-on's.",
    )
