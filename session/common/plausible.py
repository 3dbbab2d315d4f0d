"""What no sensor measures: a value beyond it is a fault of the file, or is in another unit."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG, G

#: the fastest gyroscopes end at some 5 000 dps, shock sensors at some thousand g; generous, in SI
BEYOND = {"gyro": 1e5 * DEG, "accel": 1e4 * G, "temp": 1e4}
#: units of the same in memory
SI = {"gyro": "rad/s", "accel": "m/s^2", "temp": "degC"}
SAID = {"gyro": "100000 dps", "accel": "10000 g", "temp": "10000 degC"}


def beyond_any_sensor(values: np.ndarray, si: float, kind: str) -> np.ndarray:
    """Which of values (…), finite and in units of si, no sensor can have measured; kind: gyro, accel or temp."""
    return np.abs(values) > BEYOND[kind] / si


def complaint(name: str, value: float, kind: str) -> str:
    """What is said of such a value in a column."""
    return f"{name} is {value:g}, beyond any sensor ({SAID[kind]}); is its unit right? mend or remove that line"
