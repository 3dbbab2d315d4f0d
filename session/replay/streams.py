"""Streams: what a binary log holds of one sensor.  Readers are a feature (``session.replay.binary``); these records are theirs and ours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np


@dataclass(frozen=True, eq=False)
class Stream:
    """One sensor's readings out of a file.

    name: topic, message and instance, or dataset: ``sensor_combined[0]``, ``/imu/data_raw``, ``IMU[0]``, ``gyro``.  t_ns (N,) int64, or
    None where nothing stamps them.  gyro, accel (N, 3) and temp (N,) float64 as written, None where the stream holds none.  Units: words
    of ``session.base.units`` (``rad/s``, ``dps``, ``lsb``, ``0.061dps``), ``""`` where the file does not say.  Full scales and odr_hz where
    the file states them.  frame: what is documented of its axes.  notes: what was repaired, where a damaged file stops, what an assumption
    rests on.  columns as the file calls them.
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
    columns: tuple[str, ...] = ()

    @property
    def topic(self) -> Topic:
        """What is there to choose."""
        return Topic(self.name, len(self), self.holds, self.columns)

    @property
    def holds(self) -> tuple[str, ...]:
        """The quantities that are there, of ``gyro``, ``accel``, ``temp``."""
        return tuple(kind for kind in ("gyro", "accel", "temp") if getattr(self, kind) is not None)

    def __len__(self) -> int:
        """Rows."""
        return next((len(part) for part in (self.gyro, self.accel, self.temp, self.t_ns) if part is not None), 0)


@dataclass(frozen=True)
class Topic:
    """One stream of a file, before it is read: name, rows; holds: of ``gyro``, ``accel``, ``temp``; columns as the file calls them."""

    name: str
    rows: int
    holds: tuple[str, ...]
    columns: tuple[str, ...]
