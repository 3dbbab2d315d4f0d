"""Kalibr: ``imu.yaml`` (its input) and the intrinsics block of its scale-misalignment model (its result).

Kalibr's model is forward:  w_meas = M C w + A C a + b, M lower-triangular, C a rotation.  Ours is w = E w_meas + B - K a, so with
F = E^-1 the LQ factors F = M C (positive diagonal) are exact, A = F K C^T and b = -F B.  Kalibr's frame i makes the accelerometer's M
lower-triangular as well; ours makes it upper-triangular, or as session.toml has it.  T_i_b contains the rotation between the two frames,
and C_gyro_i follows.
"""

from __future__ import annotations

import numpy as np

from session.io.texts import command_line
from session.io.units import DEG_PER_HOUR
from tinygc.deploy import ExportError
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._text import LinearPart, linear_part, remarks, words, yaml_text
from tinygc.models.model import Model

NAME = "kalibr"
SUMMARY = "imu.yaml and the intrinsics block of Kalibr's scale-misalignment model"
#: the random walk has the Allan deviation of the flicker floor at this averaging time
WALK_S = 100.0
FLOOR = 0.664
#: m/s^2, assumed for a MEMS accelerometer of this class: not measured
ACCEL_INSTABILITY_MPS2 = 4e-4
UNITS = {
    "gyroscope_noise_density": "rad/s/sqrt(Hz)",
    "gyroscope_random_walk": "rad/s^2/sqrt(Hz)",
    "accelerometer_noise_density": "m/s^2/sqrt(Hz)",
    "accelerometer_random_walk": "m/s^3/sqrt(Hz)",
}


def export(model: Model, context: Context) -> dict[str, str]:
    """Export linear models, with g-sensitivity."""
    part = linear_part(model, NAME, carries=("force",))
    noise, accel_noise, instability = context.gyro_noise, context.accel_noise, context.gyro_instability
    if noise is None or accel_noise is None:
        raise ExportError(f"kalibr needs the noise that `{command_line('fit')}` measured (fit.json beside the model)")
    if instability is None:
        raise ExportError("kalibr needs a bias instability: give sensor.gyro_bias_instability_dph in session.toml")
    context.say("kalibr: the random walks in imu.yaml are guesses from bias instability; minutes of recording do not show them")
    return {"imu.yaml": _imu(context, noise, accel_noise, *instability), "imu-intrinsics.yaml": _intrinsics(part, context)}


def factor(part: LinearPart) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(M, C, A): M lower-triangular with a positive diagonal, C a rotation, A (rad/s)/(m/s^2)."""
    M, C = lower(part.M)
    return M, C, part.M @ part.K @ C.T


def lower(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(M, C): matrix = M C, M lower-triangular with a positive diagonal, C a rotation."""
    Q, R = np.linalg.qr(matrix.T)
    signs = np.sign(np.diag(R))
    return np.tril((signs[:, None] * R).T), (Q * signs).T


def _imu(context: Context, gyro_noise: np.ndarray, accel_noise: np.ndarray, instability: float, source: str) -> str:
    # Kalibr's densities are two-sided, as in IEEE 952: one-sided densities of the stills divided by sqrt 2.
    gyro, accel = gyro_noise / np.sqrt(2), accel_noise / np.sqrt(2)
    walk = np.sqrt(3 / WALK_S) * FLOOR
    said = f" (the gyroscope's: {source})" if not source.startswith("typical") else ""
    return remarks(
        context,
        "Densities are sigma_continuous = sigma_sample * sqrt(dt), measured in the stills; the worst axis is given:",
        f"gyroscope {words(gyro)}, accelerometer {words(accel)} (x, y, z).",
        f"Random walks are NOT MEASURED: they have the Allan deviation at {WALK_S:g} s of bias instabilities of "
        f"{instability / DEG_PER_HOUR:.4g} deg/h and {ACCEL_INSTABILITY_MPS2:g} m/s^2{said}.  Replace them by an hour's recording.",
        "Vibration, temperature and scale error are in none of these: users inflate them 5 to 10 times.",
    ) + yaml_text(
        {
            "rostopic": "/imu0",
            "update_rate": context.config.sensor.odr_hz,
            "gyroscope_noise_density": gyro.max(),
            "gyroscope_random_walk": walk * instability,
            "accelerometer_noise_density": accel.max(),
            "accelerometer_random_walk": walk * ACCEL_INSTABILITY_MPS2,
        },
        UNITS,
    )


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
        "triangular; a: the specific force in b, m/s^2.  b is below, beside Kalibr's own keys, for the gyroscope and the accelerometer.",
        f"Accelerometer: {context.accelerometer_words}",
        "w_meas = M C_gyro_i w_i + A C_gyro_i a_i + b        forward: w_i = R w, w the true rate in b, rad/s",
        "w_i = C_gyro_i^T M^-1 (w_meas - b) - C_gyro_i^T M^-1 A C_gyro_i a_i, w = R^T w_i        what to compute",
        "b is this session's (Kalibr estimates its own, as a spline, and writes none): it is another one after each switch-on.",
        part.example(),
    )
    gyroscopes = {"M": M, "A": A, "C_gyro_i": C, "b": part.bias}
    chip = {"model": "scale-misalignment", "rostopic": "/imu0", "update_rate": context.config.sensor.odr_hz, "time_offset": 0.0, "T_i_b": T}
    return text + yaml_text({"imu0": chip | {"gyroscopes": gyroscopes, "accelerometers": {"M": L, "b": accelerometer.bias_mps2}}})
