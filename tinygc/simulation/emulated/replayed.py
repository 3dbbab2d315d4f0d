"""A session, simulated or recorded, as what the register model feels: its registers, back in physical units."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.sensor.known import DEFAULT
from session.sensor.registers import RegisterUnits
from tinygc.simulation.asm330lhh.readings import Oscillator
from tinygc.simulation.asm330lhh.registers import CLOCK_HZ, FINE_STEP, TEMPERATURE_ZERO_C
from tinygc.simulation.board.source import STILL_S, Source
from tinygc.simulation.unit import SimulatedUnit

SNAP = 1e-3  #: of a sample: what is nearer to one than this is that one


def oscillator_of(odr_hz: float) -> Oscillator:
    """That of a unit with this true data rate: INTERNAL_FREQ_FINE, and what its steps of 0.15 % leave."""
    coefficient = 2 ** round(np.log2(CLOCK_HZ / odr_hz))
    factor = odr_hz * coefficient / CLOCK_HZ
    fine = int(np.clip(round((factor - 1) / FINE_STEP), -128, 127))
    return Oscillator(fine, fine, 1e6 * (factor / (1 + FINE_STEP * fine) - 1))


def with_its_own_rate(unit: SimulatedUnit, nominal_hz: float) -> SimulatedUnit:
    """The unit at exactly the data rate that INTERNAL_FREQ_FINE states, of 6667 Hz / 2^n and not of its rounded name (416 Hz): what a
    program computes from the register is then true."""
    coefficient = 2 ** round(np.log2(CLOCK_HZ / nominal_hz))
    fine = round((unit.odr_hz / nominal_hz - 1) / FINE_STEP)
    return replace(unit, odr_hz=CLOCK_HZ / coefficient * (1 + FINE_STEP * fine))


class Replayed:
    """Still, and from ``start`` on the source's samples, then still again; a ``Motion``.

    A sensor with the source's true data rate, from whenever it was last set before the start, makes each of its rows once, unchanged;
    one of another rate what lies between them, linearly.
    """

    def __init__(self, source: Source):
        info = source.info
        units = source.units or RegisterUnits(info.sensor or DEFAULT, info.gyro_fs_dps, info.accel_fs_g)
        rows = source.rows.astype(float)
        temp_c = units.temperature_c(rows[:, 6])
        temp_c = np.full(len(rows), TEMPERATURE_ZERO_C) if temp_c is None else np.asarray(temp_c, float)
        self._values = np.column_stack([rows[:, :3] * units.gyro_rps, rows[:, 3:6] * units.accel_mps2, temp_c])
        self._odr_hz = info.odr_hz
        self._still = max(1, min(len(rows), round(STILL_S * info.odr_hz)))
        self._zero_s = 0.0  # of the grid of samples: one of them before the start
        self._start_s = np.inf

    @property
    def duration_s(self) -> float:
        """Of the source."""
        return len(self._values) / self._odr_hz

    def start(self, t_s: float) -> None:
        """The first row is felt at this time: more than ``readings.BLOCK_S`` from now, or what was computed ahead is still."""
        self._start_s = t_s

    def __call__(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """At these times."""
        if t_s[0] < self._start_s:
            self._zero_s = float(t_s[0])
        place = (t_s - self._zero_s) * self._odr_hz
        if np.isfinite(self._start_s):
            place -= np.ceil((self._start_s - self._zero_s) * self._odr_hz)
        else:
            place = -1 - np.abs(place)
        near = np.rint(place)
        place = np.where(np.abs(place - near) < SNAP, near, place)
        below = np.floor(place).astype(np.int64)
        part = (place - below)[:, None]
        values = self._rows(below) * (1 - part) + self._rows(below + 1) * part
        return values[:, :3], values[:, 3:6], values[:, 6]

    def _rows(self, index: np.ndarray) -> np.ndarray:
        """The source's, and the first and the last still again and again before and behind it."""
        count = len(self._values)
        before, behind = index % self._still, count - 1 - (index - count) % self._still
        return self._values[np.where(index < 0, before, np.where(index >= count, behind, index))]
