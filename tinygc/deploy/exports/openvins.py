"""OpenVINS: ``kalibr_imu_chain.yaml``, the noise and the intrinsics of its IMU model.

OpenVINS computes (ov_msckf, Propagator)

    a = R_ACCtoIMU Da (a_meas - ba),    w = R_GYROtoIMU Dw (w_meas - bg - Tg a),

and reads Tw = Dw^-1, Ta = Da^-1, R_IMUtoGYRO = R_GYROtoIMU^T and R_IMUtoACC = R_ACCtoIMU^T.  Model ``kalibr`` keeps the lower triangles
of Dw and Da, ``rpng`` the upper ones; both read both rotations.  Ours is a = matrix (a_meas - bias), w = E w_meas + B - K a.  With
E^-1 = Tw R_IMUtoGYRO and matrix^-1 = Ta R_IMUtoACC (Tw, Ta lower-triangular with a positive diagonal), Tg = E^-1 K and bg = -E^-1 B the
two are the same, in the axes of the log: its IMU frame is the log's body frame.  Model ``kalibr`` estimates R_GYROtoIMU online and keeps
R_ACCtoIMU, which holds that frame.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._noise import densities, kalibr_keys, noise_remarks
from tinygc.deploy.exports._text import linear_part, lower, remarks, words, yaml_text
from tinygc.models.model import Model

NAME = "openvins"
FILE = "kalibr_imu_chain.yaml"
#: OpenCV, which reads the file, knows YAML by this line
FIRST_LINE = "%YAML:1.0\n"


def export(model: Model, context: Context) -> dict[str, str]:
    """Export linear models, with g-sensitivity."""
    part = linear_part(model, NAME, carries=("force",))
    accelerometer = context.accelerometer
    Tw, to_gyro = lower(part.M)
    Ta, to_accel = lower(np.linalg.inv(accelerometer.matrix))
    intrinsics = {"Tw": Tw, "R_IMUtoGYRO": to_gyro, "Ta": Ta, "R_IMUtoACC": to_accel, "Tg": part.M @ part.K}
    lines = (
        f"Accelerometer: {context.accelerometer_words}",
        "bg and ba are no part of this file.  This session's, rad/s and m/s^2, in the words of estimator_config.yaml:",
        f"init_dyn_bias_g: {words(part.bias)}",
        f"init_dyn_bias_a: {words(accelerometer.bias_mps2)}",
        "They are other ones after each switch-on.",
        part.example(),
    )
    return _file(context, intrinsics, lines)


def export_noise(context: Context) -> dict[str, str]:
    """Export the noise with intrinsics of a sensor that needs none."""
    intrinsics = {"Tw": np.eye(3), "R_IMUtoGYRO": np.eye(3), "Ta": np.eye(3), "R_IMUtoACC": np.eye(3), "Tg": np.zeros((3, 3))}
    return _file(context, intrinsics, ("NOT CALIBRATED: Tw, Ta, Tg and the rotations are those of an ideal sensor.",))


def _file(context: Context, intrinsics: dict[str, np.ndarray], lines: tuple[str, ...]) -> dict[str, str]:
    found = densities(context, NAME, of_rate=True)
    noise, sources = kalibr_keys(found)
    head = remarks(
        context,
        "a = R_IMUtoACC^T Ta^-1 (a_meas - ba)        m/s^2, specific force in the axes of the log, which is the IMU frame here",
        "w = R_IMUtoGYRO^T Tw^-1 (w_meas - bg - Tg a)        rad/s",
        "Tw, Ta: lower-triangular, as model kalibr wants them.  Model rpng wants the upper triangles: it is not this file's.",
        *lines,
        *noise_remarks(context, found),
        *(f"{key}: {source}" for key, source in sources.items()),
        "calib_imu_intrinsics and calib_imu_g_sensitivity of estimator_config.yaml decide whether OpenVINS goes on estimating them.",
    )
    chip: dict[str, Any] = {"T_i_b": np.eye(4), **noise, "rostopic": "/imu0", "time_offset": 0.0}
    chip |= {"update_rate": context.config.sensor.odr_hz, "model": "kalibr", **intrinsics}
    return {FILE: FIRST_LINE + head + yaml_text({"imu0": chip})}
