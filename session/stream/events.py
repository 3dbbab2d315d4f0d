"""What a stream says, in order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.stream.board import Board, Done, Faults, SelfTest
from session.stream.form import REGISTERS, Form


@dataclass(frozen=True, eq=False)
class Chunk:
    """Consecutive samples.  t_us (n,) int64, device time, increasing, its 32 bits unrolled; registers (n, 7) int16,
    gx gy gz ax ay az temp, or, of a form in physical units, numbers (n, 6 or 7) float64."""

    t_us: np.ndarray
    registers: np.ndarray
    form: Form = REGISTERS

    def __len__(self) -> int:
        return len(self.t_us)


@dataclass(frozen=True)
class Info:
    """What the board says of itself.  odr_hz is the true rate; serial is text, in frames a decimal number; sensor: its model, or empty."""

    gyro_fs_dps: float
    accel_fs_g: float
    odr_hz: float
    serial: str
    sensor: str = ""

    @property
    def text(self) -> str:
        """As a log's comment says it, without the ``#``."""
        ranges = f"gyro_fs_dps={self.gyro_fs_dps:g} accel_fs_g={self.accel_fs_g:g} odr_hz={self.odr_hz:.4f} serial={self.serial}"
        return ranges + (f" sensor={self.sensor}" if self.sensor else "")


@dataclass(frozen=True)
class Comment:
    """A line of text that began with ``#``, without it."""

    text: str


@dataclass(frozen=True)
class Trouble:
    """What went wrong, and how often.  t_us: device time of the last good sample before it, or None.

    kind    count of
    lost         samples that the sequence, or in text the stamps, show to be missing, for whatever reason
    crc          frames that failed their check
    garbage      bytes that were neither frame nor line
    implausible  samples that were readable, but cannot follow those around them: left out
    reset        device time began anew: a new log
    reconnect    the port was opened again: a new log
    """

    kind: str
    count: int = 1
    t_us: int | None = None


Event = Chunk | Info | Comment | Trouble | Board | Faults | Done | SelfTest
