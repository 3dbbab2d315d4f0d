"""Kalibr: ``imu.yaml`` (its input) and the intrinsics block of its scale-misalignment model (its result).

Kalibr's model is forward:  w_meas = M C w + A C a + b, M lower-triangular, C a rotation.  Ours is w = E w_meas + B - K a, so with
F = E^-1 the LQ factors F = M C (positive diagonal) are exact, A = F K C^T and b = -F B.  Kalibr's frame i makes the accelerometer's M
lower-triangular as well; ours makes it upper-triangular, or as session.toml has it.  T_i_b contains the rotation between the two frames,
and C_gyro_i follows.
"""

from __future__ import annotations

import numpy as np

from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._noise import densities, kalibr_keys, noise_remarks
from tinygc.deploy.exports._text import LinearPart, linear_part, lower, remarks, yaml_text
from tinygc.models.model import Model

NAME = "kalibr"


def export(model: Model, context: Context) -> dict[str, str]:
    """Export linear models, with g-sensitivity."""
    part = linear_part(model, NAME, carries=("force",))
    return export_noise(context) | {"imu-intrinsics.yaml": _intrinsics(part, context)}


def export_noise(context: Context) -> dict[str, str]:
    """Export ``imu.yaml`` alone, which needs no model."""
    found = densities(context, NAME, of_rate=True)
    values, sources = kalibr_keys(found)
    table = {"rostopic": "/imu0", "update_rate": context.config.sensor.odr_hz} | values
    return {"imu.yaml": remarks(context, *noise_remarks(context, found)) + yaml_text(table, sources)}


def factor(part: LinearPart) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(M, C, A): M lower-triangular with a positive diagonal, C a rotation, A (rad/s)/(m/s^2)."""
    M, C = lower(part.M)
    return M, C, part.M @ part.K @ C.T


def _intrinsics(part: LinearPart, context: Context) -> str:
    M, C, A = factor(part)
    accelerometer = context.accelerometer
    L, to_i = lower(np.linalg.inv(accelerometer.matrix))
    C = C @ to_i.T
    T = np.eye(4)
    T[:3, :3] = to_i
    text = remarks(
        context,
        "a_meas = M a_i + b, a_i = R a        R: the rotation of T_i_b, from the log's body frame b to Kalibr's i, in which M is lower",
        "triangular; a: the specific force in b, m/s^2.  b is below, next to Kalibr's own keys, for the gyroscope and the accelerometer.",
        f"Accelerometer: {context.accelerometer_words}",
        "w_meas = M C_gyro_i w_i + A C_gyro_i a_i + b        forward: w_i = R w, w the true rate in b, rad/s",
        "w_i = C_gyro_i^T M^-1 (w_meas - b) - C_gyro_i^T M^-1 A C_gyro_i a_i, w = R^T w_i        what to compute",
        "b is this session's (Kalibr estimates its own, as a spline, and writes none): it is another one after each switch-on.",
        part.example(),
    )
    gyroscopes = {"M": M, "A": A, "C_gyro_i": C, "b": part.bias}
    chip = {"model": "scale-misalignment", "rostopic": "/imu0", "update_rate": context.config.sensor.odr_hz, "time_offset": 0.0, "T_i_b": T}
    return text + yaml_text({"imu0": chip | {"gyroscopes": gyroscopes, "accelerometers": {"M": L, "b": accelerometer.bias_mps2}}})
