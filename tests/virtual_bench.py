"""A virtual table and the virtual board on it, in one process: what the board streams follows what the table was told.

``VirtualBench.port`` stands where ``Recorder`` opens a port.  Time passes only where the recording waits for samples, so that a session of
ten minutes lasts seconds, and is the same each time.
"""

from __future__ import annotations

import queue
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from virtual_line import SimulatedClock, VirtualLink

from session.annexes.machines.description import Description
from session.annexes.machines.makes import open_table
from session.annexes.machines.mechanics import TableErrors
from session.annexes.machines.safety import Guarded, Move
from session.annexes.machines.virtual import VirtualTable
from session.annexes.machines.virtual_motion import Fault
from session.bench import frames
from session.bench.events import Info
from session.bench.port import Closed, Opened, Received
from session.io.units import NS
from tinygc.annexes.machines.sensor_on_table import SensorOnTable
from tinygc.simulation.options import SimulatedUnit, SimulationOptions, draw_unit
from tinygc.simulation.simulator import Distort, RegisterLog

PORT = "virtual-bench"
#: s of samples in each arrival
EVERY_S = 0.1
HOLD_S = 0.002  #: of the host's time


class VirtualBench:
    """Table, board and clock.  options: of the sensor; errors: of the table; distort: hidden physics of the gyroscope; faults: of the
    table's controller and its line.

    virtual: the table's device; silent: whether the board sends nothing; holds: asked before time passes, it waits while that is true.
    """

    def __init__(
        self,
        description: Description,
        options: SimulationOptions,
        errors: TableErrors | None = None,
        distort: Distort | None = None,
        unit: SimulatedUnit | None = None,
        faults: Sequence[Fault] = (),
    ):
        self.clock, self.options, self.errors = SimulatedClock(), options, errors or TableErrors.none(description)
        self.description = description
        self.virtual = VirtualTable(description, self.errors, self.clock, faults)
        self.virtual.feed()  # its greeting: it was switched on before its port is opened
        rng = np.random.default_rng(options.unit_drawn_from).spawn(1)[0]
        self.unit = unit or draw_unit(options, rng)
        self._sensor = SensorOnTable(description, self.errors, options, self.unit, distort)
        self.info = Info(options.gyro_fs_dps, options.accel_fs_g, self.unit.odr_hz, str(options.unit_drawn_from), options.sensor)
        self.silent = False
        self.holds: Callable[[], bool] = lambda: False
        self.sent = 0

    def opened(self, description: Description, folder: Path | None = None) -> Guarded:
        """The host's side of the table, as from ``open_table``."""
        return Guarded(open_table(description, folder, VirtualLink(self.virtual, self.clock), self.clock), self.clock)

    def home(self) -> None:
        """Search the reference marks, before the board is switched on."""
        with self.opened(self.description) as table:
            table.confirm([Move.home()], None, lambda line: None)
            table.home()
            table.settle()

    def skip(self) -> None:
        """Nobody has heard what the board has sent by now."""
        self._take()

    def port(self, name: str, baudrate: int, keep: Callable[[object], None], setup: object) -> BenchPort:
        """The port of the board, for ``Recorder(port=…)``."""
        return BenchPort(self, keep)

    def arrival(self) -> bytes:
        """Let time pass, and return the frames that the board has sent meanwhile."""
        self.clock.sleep(EVERY_S)
        before, log = self.sent, self._take()
        text = b"" if before and before // self._every == self.sent // self._every else frames.encode_info(before, self.info)
        rows = np.column_stack([log.gyro, log.accel, log.temp])
        text += frames.encode_samples(np.arange(before, self.sent) + 1, log.t_us, rows).tobytes()
        return b"" if self.silent else text

    @property
    def _every(self) -> int:
        """Samples between two infos: one a second."""
        return round(self.unit.odr_hz)

    def _take(self) -> RegisterLog:
        """The samples since the last ones."""
        count = int(self.clock.now_s() * self.unit.odr_hz) - self.sent
        self.sent += count
        return self._sensor.take(self.virtual.tracks, count)


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
            self._bench.skip()
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
