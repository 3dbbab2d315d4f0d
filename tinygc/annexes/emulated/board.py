"""The emulated board at the end of a cable, and the session that drives its sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Protocol

import numpy as np

from session.io.registers import DEFAULT, RegisterUnits
from tinygc.annexes.emulated.machine import UID, Machine
from tinygc.annexes.emulated.readings import CLOCK_HZ, FINE_STEP, TEMPERATURE_ZERO_C, Oscillator
from tinygc.annexes.emulated.sensor import Asm330lhh, SensorPort
from tinygc.simulation.options import SimulatedUnit
from tinygc.simulation.virtual_board import STILL_S, BoardSource, HostClock

# A session, simulated or recorded, as input of the register model: its registers, converted to physical units.

SNAP = 1e-3  #: of a sample: times closer to a sample than this get that sample


def oscillator_of(odr_hz: float) -> Oscillator:
    """Return the oscillator of a unit with this true data rate: INTERNAL_FREQ_FINE, and the remainder of its steps of 0.15 %."""
    coefficient = 2 ** round(np.log2(CLOCK_HZ / odr_hz))
    factor = odr_hz * coefficient / Oscillator().clock_hz()
    fine = int(np.clip(round((factor - 1) / FINE_STEP), -128, 127))
    return Oscillator(fine, fine, 1e6 * (factor / (1 + FINE_STEP * fine) - 1))


def with_its_own_rate(unit: SimulatedUnit, nominal_hz: float) -> SimulatedUnit:
    """Return the unit at exactly the data rate of its INTERNAL_FREQ_FINE, from the model's highest rate over 2^n and not from a rounded
    name (416 Hz), so that what a program computes from stamp and register is exact."""
    coefficient = 2 ** round(np.log2(CLOCK_HZ / nominal_hz))
    fine = round((unit.odr_hz / nominal_hz - 1) / FINE_STEP)
    return replace(unit, odr_hz=Oscillator(fine, fine).clock_hz() / coefficient)


class Replayed:
    """A still, the source's samples from ``start`` on, and another still; a ``Motion``.

    A sensor with the source's true data rate, set at any time before the start, returns each row once, unchanged.  At another rate the
    rows are interpolated linearly.
    """

    def __init__(self, source: BoardSource):
        info = source.info
        units = source.units or RegisterUnits(info.sensor or DEFAULT, info.gyro_fs_dps, info.accel_fs_g)
        rows = source.rows.astype(float)
        temp_c = units.temperature_c(rows[:, 6])
        temp_c = np.full(len(rows), TEMPERATURE_ZERO_C) if temp_c is None else np.asarray(temp_c, float)
        self._values = np.column_stack([rows[:, :3] * units.gyro_rps, rows[:, 3:6] * units.accel_mps2, temp_c])
        self._odr_hz = info.odr_hz
        self._still = max(1, min(len(rows), round(STILL_S * info.odr_hz)))
        self._zero_s = 0.0  # origin of the sample grid: the time of a sample before the start
        self._start_s = np.inf

    @property
    def duration_s(self) -> float:
        """Duration of the source."""
        return len(self._values) / self._odr_hz

    def start(self, t_s: float) -> None:
        """Set the time of the first row: more than ``readings.BLOCK_S`` from now, because samples computed ahead belong to the still."""
        self._start_s = t_s

    def __call__(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return rate, force and temperature at these times."""
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
        """Return the source's rows, with the first and the last still repeated before and after them."""
        count = len(self._values)
        before, behind = index % self._still, count - 1 - (index - count) % self._still
        return self._values[np.where(index < 0, before, np.where(index >= count, behind, index))]


# The emulated board at the end of a cable: simulated time paced by the clock, bytes through a pseudo-terminal.

SLICE_S = 0.004
READ_AGAIN_S = 0.001
BEHIND_S = 0.2  #: largest lag that is made up; beyond it the board's clock falls behind the host's


class Cable(Protocol):
    """The board's end, as in ``terminal.Terminal``."""

    @property
    def has_reader(self) -> bool:
        """Whether a reader has the port open."""

    @property
    def waiting(self) -> int:
        """Number of bytes not read yet, as far as known."""

    def write(self, data: bytes) -> bool:
        """Send to the host; returns False without a reader."""

    def read(self) -> bytes:
        """Receive from the host."""


class EmulatedBoard:
    """The firmware of an ELF file, a sensor, a motion and a cable on USART1.

    speed: simulated seconds per second of the clock; None: as fast as the simulation and the reader allow, once there is a reader.
    lead_s: still between the first reader and the session; tail_s: still after it, then ``run`` returns; None: never returns.

    uid: the microcontroller's unique id, 12 bytes, from which it may derive its serial number.

    late_s: total delay of the simulation against the clock, where this machine was too slow or too busy.
    """

    def __init__(
        self,
        elf: Path,
        sensor: Asm330lhh,
        cable: Cable,
        motion: Replayed | None = None,
        speed: float | None = 1.0,
        lead_s: float = 10.0,
        tail_s: float | None = None,
        clock: HostClock | None = None,
        uid: bytes = UID,
        say: Callable[[str], None] = lambda what: None,
    ):
        self.machine = Machine(elf, SensorPort(sensor), uid)
        self.sensor, self._cable, self._motion, self._speed = sensor, cable, motion, speed
        self._lead_s, self._tail_s, self._clock, self._say = lead_s, tail_s, clock or HostClock(), say
        self.late_s = 0.0

    def run(self) -> None:
        """Run until the end of the tail."""
        machine, cable = self.machine, self._cable
        end_s: float | None = None
        began_s, t_s = self._clock.now_s(), 0.0
        while end_s is None or t_s < end_s:
            t_s += SLICE_S
            machine.run_until(t_s)
            if sent := machine.usart1.take():
                cable.write(sent)
            if heard := cable.read():
                machine.usart1.feed(heard)
            if end_s is None and cable.has_reader:
                end_s = self._begin(t_s)
            if self._speed or not cable.has_reader:
                began_s = self._pace(began_s, t_s / (self._speed or 1.0))
            while not self._speed and cable.waiting:
                self._clock.sleep(READ_AGAIN_S)
                cable.write(b"")

    def _begin(self, t_s: float) -> float:
        """Start the motion at the first reader; return the end time."""
        self._say(f"a reader is there: {self._lead_s:g} s still, then the session")
        duration_s = 0.0
        if self._motion:
            self._motion.start(t_s + self._lead_s)
            duration_s = self._motion.duration_s
        return float("inf") if self._tail_s is None else t_s + self._lead_s + duration_s + self._tail_s

    def _pace(self, began_s: float, due_s: float) -> float:
        """Wait for the clock, or skip a lag that cannot be made up."""
        ahead_s = due_s - (self._clock.now_s() - began_s)
        if ahead_s > 0:
            self._clock.sleep(ahead_s)
        elif ahead_s < -BEHIND_S:
            self.late_s -= ahead_s if self._speed else 0.0
            began_s -= ahead_s
        return began_s
