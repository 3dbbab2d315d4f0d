"""A virtual table and the virtual board on it, in one process: what the board streams follows what the table was told.

``VirtualBench.port`` stands where ``Recorder`` opens a port.  Time passes only where the recording waits for samples, so that a session of
ten minutes lasts seconds, and is the same each time.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from session.annexes.machines.description import Description
from session.annexes.machines.mechanics import AxisTrack, TableErrors
from session.annexes.machines.verbs import Where
from session.bench import frames
from session.bench.events import Info
from session.bench.port import Closed, Opened, Received
from session.io.units import NS
from tinygc.annexes.machines.sensor_on_table import SensorOnTable
from tinygc.simulation.options import SimulatedUnit, SimulationOptions, draw_unit
from tinygc.simulation.simulator import Distort

PORT = "virtual-bench"
#: s of samples in each arrival
EVERY_S = 0.1
HOLD_S = 0.002  #: of the host's time


class BenchClock:
    """Time that passes only where somebody waits."""

    def __init__(self) -> None:
        self._now_s = 0.0

    def now_s(self) -> float:
        """Seconds so far."""
        return self._now_s

    def sleep(self, seconds: float) -> None:
        """Let a time pass at once."""
        self._now_s += seconds


class BenchTable:
    """A table whose controller does what it is told, over the mechanics of ``tracks``.  A test may change what it does."""

    def __init__(self, description: Description, errors: TableErrors, now_s: Callable[[], float]):
        self.description, self._now_s, self._latency_s = description, now_s, errors.latency_s
        self.tracks = tuple(AxisTrack(backlash=of.backlash) for of in errors.axes)

    def home(self) -> None:
        """Turn all axes to 0."""
        for axis, of in enumerate(self.description.axes):
            self.turn_to(axis, 0.0, of.fastest_rps)

    def turn_to(self, axis: int, angle_rad: float, rate_rps: float) -> None:
        """Begin to turn an axis to an angle."""
        self.tracks[axis].turn_to(self._now_s(), angle_rad, rate_rps, self.description.axes[axis].acceleration_rps2)

    def turn_at(self, axis: int, rate_rps: float) -> None:
        """Begin to turn an axis at a rate."""
        self.tracks[axis].turn_at(self._now_s(), rate_rps, self.description.axes[axis].acceleration_rps2)

    def where(self) -> Where:
        """Angles of a moment before, by the table's latency."""
        now_s = self._now_s()
        angles = np.array([track.state(now_s - self._latency_s)[0] for track in self.tracks])
        return Where(angles, any(track.busy_until_s > now_s for track in self.tracks), now_s)

    def stop(self) -> None:
        """Brake all axes."""
        for axis in range(len(self.tracks)):
            self.turn_at(axis, 0.0)

    def close(self) -> None:
        """Nothing is held."""


class VirtualBench:
    """Table, board and clock.  options: of the sensor; errors: of the table; distort: hidden physics of the gyroscope.

    silent: whether the board sends nothing; holds: asked before time passes, it waits while that is true.
    """

    def __init__(
        self,
        description: Description,
        options: SimulationOptions,
        errors: TableErrors | None = None,
        distort: Distort | None = None,
        unit: SimulatedUnit | None = None,
    ):
        self.clock, self.options, self.errors = BenchClock(), options, errors or TableErrors.none(description)
        self.table = BenchTable(description, self.errors, self.clock.now_s)
        rng = np.random.default_rng(options.unit_drawn_from).spawn(1)[0]
        self.unit = unit or draw_unit(options, rng)
        self._sensor = SensorOnTable(description, self.errors, options, self.unit, distort)
        self.info = Info(options.gyro_fs_dps, options.accel_fs_g, self.unit.odr_hz, str(options.unit_drawn_from), options.sensor)
        self.silent = False
        self.holds: Callable[[], bool] = lambda: False
        self.sent = 0

    def port(self, name: str, baudrate: int, keep: Callable[[object], None], setup: object) -> BenchPort:
        """The port of the board, for ``Recorder(port=…)``."""
        return BenchPort(self, keep)

    def arrival(self) -> bytes:
        """Let time pass, and return the frames that the board has sent meanwhile."""
        self.clock.sleep(EVERY_S)
        count = int(self.clock.now_s() * self.unit.odr_hz) - self.sent
        log = self._sensor.take(self.table.tracks, count)
        rows = np.column_stack([log.gyro, log.accel, log.temp])
        every = round(self.unit.odr_hz)  # an info once a second
        text = b"" if self.sent // every == (self.sent + count) // every and self.sent else frames.encode_info(self.sent, self.info)
        text += frames.encode_samples(self.sent + np.arange(count) + 1, log.t_us, rows).tobytes()
        self.sent += count
        return b"" if self.silent else text


class BenchPort:
    """Stands for ``session.bench.port.Port``: it is its own queue of items."""

    def __init__(self, bench: VirtualBench, keep: Callable[[object], None]):
        self.name, self.items = PORT, self
        self._bench, self._keep = bench, keep
        self._opened = self._closed = False

    def get(self, timeout: float | None = None) -> object:
        """The next item; time passes."""
        if self._bench.holds():
            time.sleep(HOLD_S)
            raise queue.Empty
        if not self._opened:
            self._opened = True
            return self._kept(Opened(self._host_ns, self.name))
        text = self._bench.arrival()
        if not text:
            raise queue.Empty
        return self._kept(Received(self._host_ns, text))

    def get_nowait(self) -> object:
        """There is never more than one."""
        raise queue.Empty

    def empty(self) -> bool:
        """There is never one that waits."""
        return True

    def close(self) -> None:
        """The recording ends."""

    def unplug(self, why: str = "unplugged") -> Closed:
        """The item of a cable that is pulled; the next ``get`` opens the port again."""
        self._opened = False
        return Closed(self._host_ns, why)

    @property
    def _host_ns(self) -> int:
        return round(self._bench.clock.now_s() / NS)

    def _kept(self, item: object) -> object:
        self._keep(item)
        return item


def perfect(unit: SimulatedUnit) -> SimulatedUnit:
    """The same unit without errors of its gyroscope."""
    return replace(unit, E=np.eye(3), B=np.zeros(3))
