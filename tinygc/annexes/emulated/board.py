"""The emulated board at the end of a cable, and the session that its sensor feels."""

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

# A session, simulated or recorded, as what the register model feels: its registers, back in physical units.

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

    def __init__(self, source: BoardSource):
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


# The emulated board at the end of a cable: simulated time against the clock's, bytes through a pseudo-terminal.

SLICE_S = 0.004
READ_AGAIN_S = 0.001
BEHIND_S = 0.2  #: what is not made up for: the board's clock then loses against the host's


class Cable(Protocol):
    """The board's end, as ``terminal.Terminal`` has it."""

    @property
    def has_reader(self) -> bool:
        """Whether somebody listens."""

    @property
    def waiting(self) -> int:
        """Bytes that have not been read yet, as far as it knows."""

    def write(self, data: bytes) -> bool:
        """To the host; False where nobody listens."""

    def read(self) -> bytes:
        """From the host."""


class EmulatedBoard:
    """The firmware of an ELF file, a sensor, a motion and a cable on USART1.

    speed: simulated seconds in one of the clock's; None: as quickly as it goes and is read, once there is a reader.
    lead_s: still time between the first reader and the
    session; tail_s: still time behind it, then ``run`` returns; None: never returns.

    uid: the microcontroller's unique id, 12 bytes, from which it may make its serial number.

    late_s: by how much the clock went on without it, since this machine was too slow or too busy.
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
        """Until the tail is over."""
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
        """Somebody reads: when all will be over."""
        self._say(f"a reader is there: {self._lead_s:g} s still, then the session")
        duration_s = 0.0
        if self._motion:
            self._motion.start(t_s + self._lead_s)
            duration_s = self._motion.duration_s
        return float("inf") if self._tail_s is None else t_s + self._lead_s + duration_s + self._tail_s

    def _pace(self, began_s: float, due_s: float) -> float:
        """Wait for the clock, or give up what cannot be made up for."""
        ahead_s = due_s - (self._clock.now_s() - began_s)
        if ahead_s > 0:
            self._clock.sleep(ahead_s)
        elif ahead_s < -BEHIND_S:
            self.late_s -= ahead_s if self._speed else 0.0
            began_s -= ahead_s
        return began_s
