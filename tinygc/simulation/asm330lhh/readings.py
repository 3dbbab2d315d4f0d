"""The true sample times, and the int16 registers at each of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.simulation.asm330lhh.motion import STANDARD_GRAVITY, Motion
from tinygc.simulation.asm330lhh.registers import (
    ACCEL_MG,
    CLOCK_HZ,
    FINE_STEP,
    GYRO_MDPS,
    TEMPERATURE_LSB,
    TEMPERATURE_ZERO_C,
    TICKS_HZ,
)

BLOCK, BLOCK_S = 256, 0.25  #: samples, and at most so much time, that are computed at once
REGISTER_BYTES = 14  #: temperature, gyroscope, accelerometer: 0x20 to 0x2D


@dataclass(frozen=True)
class Oscillator:
    """fine_off, fine_on: INTERNAL_FREQ_FINE while both sensors are off, and while one is on; residual_ppm: by how much the true
    frequency is above the one that the register states."""

    fine_off: int = 0
    fine_on: int = 0
    residual_ppm: float = 0.0

    def factor(self, on: bool) -> float:
        """True frequency over the typical one."""
        return (1 + FINE_STEP * (self.fine_on if on else self.fine_off)) * (1 + 1e-6 * self.residual_ppm)

    def clock_hz(self) -> float:
        """Of the samples: 6667 Hz, typically."""
        return CLOCK_HZ * self.factor(True)

    def ticks_hz(self, on: bool) -> float:
        """Of the timestamp: 40 kHz, typically."""
        return TICKS_HZ * self.factor(on)


@dataclass(frozen=True)
class SelfTest:
    """What the sensors' own actuators add to every axis."""

    gyro_dps: float = 400.0
    accel_mg: float = 500.0

    def gyro(self, code: int) -> float:
        """The rate in dps that st_g adds."""
        return {1: self.gyro_dps, 3: -self.gyro_dps}.get(code, 0.0)

    def accel(self, code: int) -> float:
        """The force in mg that st_xl adds."""
        return {1: self.accel_mg, 2: -self.accel_mg}.get(code, 0.0)


def to_registers(
    rate: np.ndarray, force: np.ndarray, temp_c: np.ndarray, fs_g: int, fs_xl: int, added_dps: float = 0.0, added_mg: float = 0.0
) -> np.ndarray:
    """(N, 7) int16, temperature, gyroscope, accelerometer, in the order of the map; what is beyond a register stays at its end.

    rate (N, 3) rad/s, force (N, 3) m/s^2, temp_c (N,) degC; fs_g, fs_xl: the codes of the full scales.  A code of fs_g that has no
    meaning reads as 250 dps (code 0).
    """
    gyro = (np.degrees(rate) + added_dps) * (1000 / GYRO_MDPS.get(fs_g, GYRO_MDPS[0]))
    accel = (force * (1000 / STANDARD_GRAVITY) + added_mg) / ACCEL_MG[fs_xl]
    temp = (temp_c - TEMPERATURE_ZERO_C) * TEMPERATURE_LSB
    table = np.rint(np.column_stack([temp, gyro, accel]))
    return np.clip(table, -32768, 32767).astype("<i2")


class Readings:
    """Samples at every ``step``-th tick of a clock, computed in blocks."""

    def __init__(self, motion: Motion, zero_s: float, clock_hz: float):
        self._motion, self.zero_s, self.clock_hz = motion, zero_s, clock_hz
        self._settings: tuple[int, int, float, float] = (0, 0, 0.0, 0.0)
        self.step = 1
        self._first, self._data = 0, b""

    def set(self, step: int, fs_g: int, fs_xl: int, added_dps: float, added_mg: float) -> None:
        """What holds from the next sample on."""
        self.step, self._settings, self._data = step, (fs_g, fs_xl, added_dps, added_mg), b""

    def time_s(self, tick: int) -> float:
        """When that tick of the clock is."""
        return self.zero_s + tick / self.clock_hz

    def after(self, t_s: float) -> int:
        """The first tick with a sample behind a time."""
        tick = int((t_s - self.zero_s) * self.clock_hz) // self.step * self.step
        while self.time_s(tick) <= t_s or tick <= 0:
            tick += self.step
        return tick

    def at(self, tick: int) -> bytes:
        """The 14 bytes of the output registers at a tick with a sample; ticks are asked for in their order."""
        place = (tick - self._first) // self.step * REGISTER_BYTES
        if place < 0 or place >= len(self._data):
            ticks = tick + self.step * np.arange(max(1, min(BLOCK, int(BLOCK_S * self.clock_hz / self.step))))
            self._first, place = tick, 0
            rate, force, temp_c = self._motion(self.zero_s + ticks / self.clock_hz)
            self._data = to_registers(rate, force, temp_c, *self._settings).tobytes()
        return self._data[place : place + REGISTER_BYTES]
