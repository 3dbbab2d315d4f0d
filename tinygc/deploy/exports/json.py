"""The project's own JSON: the model file, made complete (docs/model-json.md).  ``tinygc.load`` reads it, and so does anything else."""

from __future__ import annotations

import json

from tinygc import models
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._self_test import self_test
from tinygc.fitting.versions import versions
from tinygc.models import linear
from tinygc.models.model import Model

NAME = "json"
UNITS = "E: 1, B: rad/s, of an effect as theta_si; product of the two parameters' units"
SUMMARY = "documented JSON with covariance, units, hashes and a self-test"


def export(model: Model, context: Context) -> dict[str, str]:
    """Every model can be carried."""
    sensor, accelerometer = context.config.sensor, context.config.accelerometer
    table = models.to_dict(model)
    table |= {"method": context.method, "session": context.session, "versions": versions()}
    if context.covariance is not None:
        table |= {
            "covariance": context.covariance.tolist(),
            "covariance_of": context.table.get("covariance_of", list(linear.NAMES)),
            "covariance_units": context.table.get("covariance_units", UNITS),
            "unobserved": context.table.get("unobserved", []),
        }
    table |= {key: context.table[key] for key in ("remaining_rps", "accel_change_mps2") if key in context.table}
    table |= {
        "frame": "the sensor's own axes, right-handed, as in the log that was fitted; specific force is -g on the axis that points down",
        "sensor": {
            "model": sensor.model,
            "serial": sensor.serial,
            "odr_hz": sensor.odr_hz,
            "gyro_fs_dps": sensor.gyro_fs_dps,
            "accel_fs_g": sensor.accel_fs_g,
        }
        | {name: value for name, value in sensor.own_units.items() if value is not None},
        "accelerometer": {
            "equation": "f = matrix @ (measured - bias_mps2), m/s^2",
            "matrix": accelerometer.matrix.tolist(),
            "bias_mps2": accelerometer.bias_mps2.tolist(),
        },
        "noise": {key: context.fit.get("noise", {}).get(key) for key in ("gyro_dps_rthz", "accel_g_rthz")},
        "sha256": context.hashes,
        "self_test": self_test(model, sensor),
    }
    return {f"{context.stem}.json": json.dumps(table, indent=1, ensure_ascii=False, allow_nan=False) + "\n"}
