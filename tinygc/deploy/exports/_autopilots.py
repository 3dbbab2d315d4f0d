"""What PX4 and ArduPilot share: a gyroscope's zero over temperature, an accelerometer's zero and scale of each axis, a filter's noise.

Neither carries a scale or a misalignment of the gyroscope.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from session.base.units import DEG
from tinygc.deploy import ExportError, feature_exports
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._noise import densities, noise_remarks
from tinygc.deploy.exports._text import LinearPart, linear_part
from tinygc.models.model import Model

#: degC beyond the session's temperatures within which a straight line is trusted
BEYOND_C = 5.0
#: scales that ArduPilot accepts (INS_ACCSCAL_*); outside them the matrix turns the axes
SCALES = (0.8, 1.2)


@dataclass(frozen=True, eq=False)
class Zero:
    """A gyroscope's zero, over temperature where the model knows it.

    part: the linear model at reference_c; terms (4, 3) rad/s per degC^n about ``about_c``; range_c: within which they hold, None for a
    zero without temperature; accel (4, 3) m/s^2 likewise: what the accelerometer reads otherwise than at the reference, None if unknown;
    force: offsets (3,) m/s^2 and scales (3,) of the accelerometer, None where there is nothing to carry; lines: of these, for the head.
    """

    part: LinearPart
    terms: np.ndarray
    reference_c: float
    range_c: tuple[float, float] | None
    accel: np.ndarray | None = None
    force: tuple[np.ndarray, np.ndarray] | None = None
    lines: tuple[str, ...] = ()

    @property
    def head(self) -> tuple[str, ...]:
        """Lines for the file's head on what the format cannot carry."""
        errors = ", ".join(f"{1e6 * (value - 1):+.0f}" for value in np.diag(self.part.M))
        return (
            "SCALE CANNOT BE CARRIED of the gyroscope: these parameters hold its offsets only.  Left uncorrected: scale factor errors of",
            f"{errors} ppm (x, y, z) and misalignment; apply the whole calibration in the driver if that matters.",
            f"Offsets in deg/s: {', '.join(f'{value / DEG:+.4f}' for value in self.part.bias)}; they are this switch-on's.",
            *self.lines,
        )


def zero_of(model: Model, context: Context, name: str, about_c: float | None = None) -> Zero:
    """Return the zero of a linear model, also with thermal bias, or of one over temperature; about_c: of its terms, else the reference.

    Reports what is lost.  Raises ExportError for other models.
    """
    if (feature := feature_exports(model)) is not None:
        zero: Zero = feature.zero(model, context, name, about_c)
        return zero
    part = linear_part(model, name, carries=("temperature",))
    remark_on_scale(context, name, part.E)
    range_c = None
    if part.k.any():
        warmest = context.temperature_c()
        if warmest is None or not np.isfinite(part.first_c):
            raise ExportError(f"{name} needs the range of temperatures, which the session's logs do not have")
        range_c = warmest[0] - BEYOND_C, warmest[1] + BEYOND_C
    terms = np.stack([part.bias, part.M @ part.k, np.zeros(3), np.zeros(3)])
    force, lines = _force(context, name)
    return Zero(part, terms, part.first_c, range_c, force=force, lines=lines)


def remark_on_scale(context: Context, name: str, E: np.ndarray) -> None:
    """Report what is lost of E (3, 3), or of several (n, 3, 3)."""
    full_scale, lost = context.config.sensor.gyro_fs_dps, float(np.abs(E - np.eye(3)).sum(axis=-1).max())
    if lost > 0:  # rest logs alone do not determine E
        context.remark(
            f"{name} carries the gyroscope's offsets and temperature terms only, no scale and no misalignment: "
            f"up to {100 * lost:.2f} % of the rate, {lost * full_scale:.2g} dps at {full_scale:g} dps, stays uncorrected"
        )


def _force(context: Context, name: str) -> tuple[tuple[np.ndarray, np.ndarray] | None, tuple[str, ...]]:
    """Return offsets (3,) m/s^2 and scales (3,) of the accelerometer, and lines for the file's head.

    These parameters express corrected = (measured - offset) scale only.  Off-diagonal elements of the matrix are lost, which is reported.
    """
    accelerometer = context.accelerometer
    if accelerometer.source == "none":
        context.remark(f"{name}: the accelerometer is not calibrated: its parameters are left out")
        return None, ()
    scale = np.diag(accelerometer.matrix)
    if not ((scale > SCALES[0]) & (scale < SCALES[1])).all():
        values = ", ".join(f"{value:.3f}" for value in scale)
        context.remark(f"{name}: the accelerometer's matrix turns its axes (diagonal {values}): its parameters are left out")
        return None, ()
    lost = float(np.abs(accelerometer.matrix - np.diag(scale)).sum(axis=1).max())
    words = f"up to {1e3 * lost:.2g} mrad, {1e3 * lost:.2g} mg at one g"
    context.remark(f"{name} carries an offset and a scale of each of the accelerometer's axes; what leans between them stays: {words}")
    return (accelerometer.bias_mps2, scale), (
        f"Accelerometer: {context.accelerometer_words}",
        f"Its nonorthogonality, and a turn of its frame, cannot be carried: {words}.",
    )


# The autopilots' filters: parameters of one step of the filter, each with a documented range.


@dataclass(frozen=True)
class StepParameter:
    """A parameter p of which a filter adds (dt p)^2 to a variance at each step dt: name; density: its sensor, and N or K; default, least
    and most: as documented."""

    name: str
    density: tuple[str, str]
    default: float
    least: float
    most: float


def step_parameters(
    context: Context, name: str, parameters: Iterable[StepParameter], step_s: float, step_words: str
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Values by name and lines for the file's head: p = N / sqrt(dt) or K / sqrt(dt), within its range; dt: step_s, in words step_words."""
    found = densities(context, name, ("gyro",))
    values, lines = {}, []
    for each in parameters:
        kind, term = each.density
        if kind not in found:
            continue
        density = found[kind].white if term == "N" else found[kind].walk
        value = density.largest / np.sqrt(step_s)
        values[each.name] = float(np.clip(value, each.least, each.most))
        end = "" if each.least <= value <= each.most else f"; {values[each.name]:g} IS WRITTEN, the end of its documented range"
        lines.append(f"{each.name}: {term} / sqrt(dt) = {value:.4g}, {density.source}; default {each.default:g}{end}")
    if "accel" not in found:
        context.remark(f"{name}: the accelerometer's noise is not known: its parameters are left out")
    context.remark(f"{name}: the noise parameters hold at rest, and vibration in flight is not in them; do not fly with them as they are")
    return values, (
        "NOISE AT REST.  Vibration in flight is not in it, and the defaults leave room for that: a filter that flies with noise at rest",
        "trusts its gyroscope too much.  These are lower bounds; multiply them by what the vehicle's own log shows.",
        f"The filter adds (dt p)^2 to a variance at each step, dt = {step_words}:",
        "p = N / sqrt(dt) for the readings, p = K / sqrt(dt) for their biases.",
        *lines,
        *noise_remarks(context, found),
    )
