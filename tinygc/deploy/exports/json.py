"""The project's own JSON: the complete model file (docs/model-json.md), for ``tinygc.load`` and any other reader."""

from __future__ import annotations

from session.base.records import json_text, table_of
from tinygc import models
from tinygc.deploy.exports._context import Context
from tinygc.deploy.exports._text import self_test
from tinygc.models import linear
from tinygc.models.model import Model, accelerometer_table, sensor_table
from tinygc.models.versions import versions

NAME = "json"
UNITS = "E: 1, B: rad/s, of an effect as theta_si; product of the two parameters' units"


def export(model: Model, context: Context) -> dict[str, str]:
    """Export any model."""
    table = models.to_dict(model)
    table |= {"method": context.method, "session": context.session, "versions": versions()}
    if context.covariance is not None:
        table |= {
            "covariance": context.covariance.tolist(),
            "covariance_of": context.table.get("covariance_of", list(linear.NAMES)),
            "covariance_units": context.table.get("covariance_units", UNITS),
            "unobserved": context.table.get("unobserved", []),
        }
    if context.any_session_covariance is not None:
        table["any_session_covariance"] = context.any_session_covariance.tolist()
    if context.accelerometer_any_session is not None:
        table["accelerometer_any_session_sigma"] = context.accelerometer_any_session.tolist()
    table |= {key: context.table[key] for key in ("temperature_c", "remaining_rps", "accel_change_mps2") if key in context.table}
    if "joint_covariance" in context.table:
        table["joint_covariance"] = context.table["joint_covariance"]
    table |= {
        "frame": "the sensor's own axes, right-handed, as in the log that was fitted; specific force is -g on the axis that points down",
        "sensor": sensor_table(context.config.sensor),
        "accelerometer": accelerometer_table(context.accelerometer),
        "noise": {key: context.fit.get("noise", {}).get(key) for key in ("gyro_dps_rthz", "accel_g_rthz")},
        **({} if context.noise is None else {"noise_figures": table_of(context.noise)}),
        "sha256": context.hashes,
        "self_test": self_test(model, context.config.sensor),
    }
    return {f"{context.stem}.json": json_text(table) + "\n"}
