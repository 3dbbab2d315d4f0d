"""A host of the register model without a microcontroller, and a motion whose samples can be counted."""

from __future__ import annotations

import numpy as np

from tinygc.annexes.emulated.readings import Silicon
from tinygc.annexes.emulated.sensor import Asm330lhh, SensorPort

BYTE_S = 8 / 5.25e6
READY_S = 0.02
GYRO, ACCEL = 1, 2
RATE_HZ = 40000 / 6 / 8  #: of code 7, typically
SETTLED = Silicon(settling=0.0)


def counting(t_s: np.ndarray):
    """At 833 Hz and +-500 dps the gyroscope's registers are the sample's number, its negative and itself; at 4 g the accelerometer's
    are, too."""
    number = np.rint(t_s * RATE_HZ) % 30000
    axes = [1, -1, 1]
    return np.outer(number * np.radians(0.0175), axes), np.outer(number * 0.122e-3 * 9.80665, axes), np.full(len(t_s), 30.0)


class Wire:
    """A host that knows the protocol: reads and writes at a time that it keeps."""

    def __init__(self, sensor: Asm330lhh, t_s: float = READY_S):
        self.port, self.sensor, self.t_s = SensorPort(sensor), sensor, t_s

    def _exchange(self, out: bytes) -> bytes:
        self.port.select(True, self.t_s)
        answer = self.port.transfer(out, self.t_s, BYTE_S)
        self.t_s += len(out) * BYTE_S
        self.port.select(False, self.t_s)
        return answer

    def read(self, address: int, count: int = 1) -> bytes:
        return self._exchange(bytes([0x80 | address]) + bytes(count))[1:]

    def write(self, address: int, *values: int) -> None:
        self._exchange(bytes([address, *values]))

    def int16(self, address: int, count: int = 1) -> np.ndarray:
        return np.frombuffer(self.read(address, 2 * count), "<i2")

    def wait(self, seconds: float) -> None:
        self.t_s += seconds


def level(link: Wire) -> int:
    low, high = link.read(0x3A, 2)
    return low | (high & 3) << 8


def words(link: Wire, count: int | None = None) -> np.ndarray:
    """(N, 7) uint8: so many, or all that are there, in one burst that wraps."""
    count = level(link) if count is None else count
    return np.frombuffer(link.read(0x78, 7 * count), np.uint8).reshape(-1, 7)


def data(table: np.ndarray, tag: int) -> np.ndarray:
    return np.ascontiguousarray(table[table[:, 0] >> 3 == tag, 1:]).view("<i2").astype(int)
