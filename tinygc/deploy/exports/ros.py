"""ROS 2: a parameter file with the calibration and sensor_msgs/Imu covariances, noise separate from calibration covariance.

ROS has no common format for a calibrated IMU: the file is for a node of one's own, and states it."""

from __future__ import annotations

from typing import Any

import numpy as np

from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._noise import Densities, densities, noise_remarks
from tinygc.deploy.exports._text import linear_part, remarks, yaml_text
from tinygc.models.linear import NAMES
from tinygc.models.model import Model

NAME = "ros"
FILE = "imu_calibration.yaml"
OWN_NODE = "No program reads this file as it is: its parameters are for a node of your own, which declares them."


def export(model: Model, context: Context) -> dict[str, str]:
    """Export linear models, with g-sensitivity."""
    part = linear_part(model, NAME, carries=("force",))
    found = densities(context, NAME, walks=False, of_rate=True)
    accelerometer = context.accelerometer
    head = remarks(
        context,
        OWN_NODE,
        "omega = gyroscope.matrix m + gyroscope.offset - gyroscope.g_sensitivity a        rad/s; a: calibrated specific force, m/s^2",
        "a = accelerometer.matrix (a_measured - accelerometer.bias)        m/s^2, specific force: at rest +g on the axis that points up",
        f"    {context.accelerometer_words}",
        "Matrices are row-major.  Publish what is measured on imu/data_raw, what is calibrated on imu/data (REP 145).",
        *_of_covariances(context, found),
        "calibration_covariance is apart, since it does not average out: 12 x 12, of " + ", ".join(NAMES) + " (E: 1, B: rad/s);",
        "the rate's own is J P J^T with J = [kron(I, m^T), I].  Without it the method has none.",
        "It holds for the session that was fitted: how the bias differs from session to session is not known."
        if context.any_session_covariance is None
        else "It holds for any session: the spread of the bias between sessions is in it.",
        part.example(),
    )
    values = {
        "gyroscope.matrix": part.E.ravel(),
        "gyroscope.offset": part.B,
        "gyroscope.g_sensitivity": part.K.ravel(),
        "accelerometer.matrix": accelerometer.matrix.ravel(),
        "accelerometer.bias": accelerometer.bias_mps2,
    } | _covariances(context, found, part.E, accelerometer.matrix)
    if context.covariance is None:
        context.remark(f"ros: method {context.method} has no covariance: calibration_covariance is left out")
    else:
        other = context.any_session_covariance
        values["calibration_covariance"] = (context.covariance if other is None else other).ravel()
    return {FILE: head + yaml_text({"/**": {"ros__parameters": _nested(values)}})}


def export_noise(context: Context) -> dict[str, str]:
    """Export the covariances alone, of the readings as they are measured, which needs no model."""
    found = densities(context, NAME, walks=False, of_rate=True)
    values = _covariances(context, found, np.eye(3), np.eye(3))
    head = remarks(context, OWN_NODE, *_of_covariances(context, found))
    return {FILE: head + yaml_text({"/**": {"ros__parameters": _nested(values)}})}


def _covariances(context: Context, found: dict[str, Densities], gyro: np.ndarray, accel: np.ndarray) -> dict[str, np.ndarray]:
    """The three of sensor_msgs/Imu, row by row: N^2 times the data rate, through the matrices (3, 3) that calibrate a reading."""
    rate_hz = context.config.sensor.odr_hz
    of_sample = {kind: np.diag(both.white.each**2 * rate_hz) for kind, both in found.items()}
    return {
        "orientation_covariance": np.array([-1.0] + [0.0] * 8),
        "angular_velocity_covariance": (gyro @ of_sample["gyro"] @ gyro.T).ravel(),
        "linear_acceleration_covariance": (accel @ of_sample["accel"] @ accel.T).ravel(),
    }


def _of_covariances(context: Context, found: dict[str, Densities]) -> tuple[str, ...]:
    return (
        "*_covariance are the three of sensor_msgs/Imu: white noise of one sample, up to half the data rate, and nothing else:",
        f"covariance = N^2 rate, N the two-sided density, rate = {context.config.sensor.odr_hz:g} Hz.  It grows with the rate;",
        "orientation_covariance begins with -1: there is no estimate of it.",
        *(() if context.noise is None else noise_remarks(context, found)),
    )


def _nested(values: dict[str, np.ndarray]) -> dict[str, Any]:
    """Convert names such as ``gyroscope.matrix`` to nested tables."""
    table: dict[str, Any] = {}
    for name, value in values.items():
        group, _, key = name.rpartition(".")
        (table.setdefault(group, {}) if group else table)[key] = value
    return table
