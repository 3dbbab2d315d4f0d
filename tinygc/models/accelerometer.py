"""The accelerometer and the sensor that stand beside a calibration of rates in its file."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from session.files.shapes import Array, Keys, Maybe, Number, Text, require
from session.log.config import OWN_UNITS, Accelerometer, Sensor
from tinygc.models.shapes import FORCE, MATRIX

EQUATION = "f = matrix @ (measured - bias_mps2), m/s^2"
SOURCES = ("given", "prior", "stills", "none")
FULL_SCALES = ("gyro_fs_dps", "accel_fs_g")
_KEYS = Keys({"matrix": MATRIX, "bias_mps2": Array((3,), FORCE)}, {"source": Text(SOURCES), "equation": Text()})
_ABOVE_0 = Maybe(Number(0, above=True))
_SENSOR = Keys(
    may={
        "model": Maybe(Text()),
        "serial": Maybe(Text()),
        "odr_hz": _ABOVE_0,
        **dict.fromkeys((*FULL_SCALES, *OWN_UNITS), _ABOVE_0),
        "temp_at_zero_c": Maybe(Number(-1e4, 1e4)),
    }
)


def accelerometer_table(accelerometer: Accelerometer) -> dict:
    """``accelerometer`` of ``tinygc-model/1``."""
    return {
        "equation": EQUATION,
        "matrix": accelerometer.matrix.tolist(),
        "bias_mps2": accelerometer.bias_mps2.tolist(),
        "source": accelerometer.source,
    }


def accelerometer_of(table: dict, where: str = "model") -> Accelerometer | None:
    """That of a model file; None where it has none, or nobody has calibrated it.  FormatError for what is no calibration."""
    entry = table.get("accelerometer")
    if entry is None:
        return None
    require(table, Keys({"accelerometer": _KEYS}), where)
    matrix, bias = (np.asarray(entry[key], dtype=float) for key in ("matrix", "bias_mps2"))
    source = entry.get("source", "given")
    return None if source == "none" else Accelerometer(matrix, bias, source)


def sensor_table(sensor: Sensor) -> dict:
    """``sensor`` of ``tinygc-model/1``."""
    return {
        "model": sensor.model,
        "serial": sensor.serial,
        "odr_hz": sensor.odr_hz,
        "gyro_fs_dps": sensor.gyro_fs_dps,
        "accel_fs_g": sensor.accel_fs_g,
    } | {name: value for name, value in sensor.own_units.items() if value is not None}


@dataclass(frozen=True)
class KnownSensor:
    """What a model file says of its sensor's registers: full scales, model, units of its own (``OWN_UNITS``); None where it does not."""

    gyro_fs_dps: float | None = None
    accel_fs_g: float | None = None
    model: str | None = None
    own_units: dict[str, float | None] = field(default_factory=dict)


def sensor_of(table: dict, where: str = "model") -> KnownSensor:
    """That of a model file.  FormatError for what is no number."""
    entry = table.get("sensor")
    if entry is None:
        return KnownSensor()
    require(table, Keys({"sensor": _SENSOR}), where)
    gyro, accel = (entry.get(key) for key in FULL_SCALES)
    own: dict[str, float | None] = {key: float(entry[key]) for key in OWN_UNITS if entry.get(key) is not None}
    return KnownSensor(None if gyro is None else float(gyro), None if accel is None else float(accel), entry.get("model") or None, own)
