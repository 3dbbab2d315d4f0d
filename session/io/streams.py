"""What a reader of a binary log gives: the topics that a file holds, and one sensor's readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Stream:
    """One sensor's readings out of a file.

    name: of the topic, the message and its instance, or the dataset (``sensor_combined[0]``, ``/imu/data_raw``, ``IMU[0]``); t_ns (N,)
    int64, or None where nothing stamps them; gyro, accel (N, 3) and temp (N,) float64 as written, None where there are none.  Units are
    words of ``session.io.units`` (``rad/s``, ``lsb``, ``0.061dps``), empty where the file does not say.  gyro_fs_dps, accel_fs_g, odr_hz,
    sensor: where the file states them; frame: what is documented of its axes; notes: what was repaired, where a damaged file stops, and
    what an assumption rests on.
    """

    name: str
    t_ns: np.ndarray | None
    gyro: np.ndarray | None
    accel: np.ndarray | None
    temp: np.ndarray | None
    gyro_unit: str = ""
    accel_unit: str = ""
    temp_unit: str = ""
    gyro_fs_dps: float | None = None
    accel_fs_g: float | None = None
    odr_hz: float | None = None
    sensor: str | None = None
    frame: str = ""
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Topic:
    """Readings that a file holds: name; rows; holds, of ``gyro``, ``accel`` and ``temp``; columns as the file calls them."""

    name: str
    rows: int
    holds: tuple[str, ...]
    columns: tuple[str, ...]
