"""The accelerometer and the sensor that stand beside a calibration of rates in its file."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import isfinite
from typing import Any

import numpy as np

from session.common.errors import FormatError
from session.log.config import OWN_UNITS, Accelerometer, Sensor

EQUATION = "f = matrix @ (measured - bias_mps2), m/s^2"
SOURCES = ("given", "prior", "stills", "none")
FULL_SCALES = ("gyro_fs_dps", "accel_fs_g")


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
    try:
        matrix, bias = (np.asarray(entry[key], dtype=float) for key in ("matrix", "bias_mps2"))
    except (KeyError, TypeError, ValueError):
        matrix, bias = np.empty(0), np.empty(0)
    sound = matrix.shape == (3, 3) and bias.shape == (3,) and np.isfinite(matrix).all() and np.isfinite(bias).all()
    if not sound or abs(np.linalg.det(matrix)) < 1e-6:
        raise FormatError(f"{where}: accelerometer is no calibration, expected matrix 3x3 and bias_mps2 of 3 finite numbers; fit again")
    source = entry.get("source", "given")
    if source not in SOURCES:
        raise FormatError(f"{where}: accelerometer.source is {source!r}, expected one of {', '.join(SOURCES)}; fit again")
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
    entry: Any = table.get("sensor")
    if entry is None:
        return KnownSensor()
    numbers: dict[str, float | None] = {}
    for key in (*FULL_SCALES, *OWN_UNITS):
        value = entry.get(key) if isinstance(entry, dict) else entry
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value)):
            raise FormatError(f"{where}: sensor.{key} is {value!r}, expected a number; fit again")
        numbers[key] = None if value is None else float(value)
    if any(number is not None and number <= 0 for number in (numbers[key] for key in FULL_SCALES)):
        raise FormatError(f"{where}: sensor.gyro_fs_dps and sensor.accel_fs_g must be above 0; fit again")
    model = entry.get("model")
    own = {key: numbers[key] for key in OWN_UNITS if numbers[key] is not None}
    return KnownSensor(numbers["gyro_fs_dps"], numbers["accel_fs_g"], model if isinstance(model, str) and model else None, own)
