"""``board --table FILE``: a virtual board on a virtual table, behind a port each, in real time.

What the board streams follows what the table is told through its own port.  The table's device is asked whenever the board waits, so that
one thread serves both.
"""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np

from session.bench.events import Info
from tinygc.features.tables.machines.clocks import HostClock
from tinygc.features.tables.machines.description import read_description
from tinygc.features.tables.machines.mechanics import TableErrors
from tinygc.features.tables.machines.virtual import VirtualTable
from tinygc.features.tables.machines.virtual_motion import Fault
from tinygc.features.tables.sensor_on_table import SensorOnTable
from tinygc.features.tables.virtual_line import TableLine
from tinygc.simulation.options import SimulationOptions, draw_unit
from tinygc.simulation.virtual_board import BoardSource
from tinygc.simulation.write import config_text


class SensorSource(BoardSource):
    """A board's source without an end: its sensor is turned by a virtual table.  config: text of its session.toml."""

    _sensor: SensorOnTable
    _table: VirtualTable

    def __init__(self, info: Info, config: str, sensor: SensorOnTable, table: VirtualTable):
        super().__init__(np.zeros((0, 7), np.int16), info, config)
        object.__setattr__(self, "_sensor", sensor)
        object.__setattr__(self, "_table", table)

    def take(self, start: int, stop: int, rng: np.random.Generator) -> np.ndarray:
        """The next samples, up to now."""
        sensor, table = self._sensor, self._table
        if not sensor.taken:
            sensor.skip_to(table.mechanics.now_s())
        log = sensor.take(table.tracks, stop - start)
        return np.column_stack([log.gyro, log.accel, log.temp])


class TableClock(HostClock):
    """The board's clock: while it waits, the table answers."""

    def __init__(self, line: TableLine):
        self._line = line

    def sleep(self, seconds: float) -> None:
        """Answer the table's host, then wait."""
        self._line.answer()
        super().sleep(seconds)


class TableUnderBoard:
    """A context: ``source`` and ``clock`` of the board, ``name`` of the table's port.

    file: table.toml; link: of the table's port; faults and resets: as ``table virtual`` takes them.
    """

    def __init__(
        self, file: Path, link: Path | None, options: SimulationOptions, calibrated: bool = True, faults: str = "", resets: bool = False
    ):
        from tinygc.simulation.terminal import Terminal  # of POSIX alone

        description = read_description(file)
        errors = TableErrors.none(description)
        table = VirtualTable(description, errors, HostClock(), Fault.parse(faults), options.seed)
        unit = draw_unit(options, np.random.default_rng(options.unit_drawn_from).spawn(1)[0])
        info = Info(options.gyro_fs_dps, options.accel_fs_g, unit.odr_hz, str(options.unit_drawn_from), options.sensor)
        text = config_text(SimpleNamespace(options=options, unit=unit), concealed=False, calibrated=calibrated)  # type: ignore[arg-type]
        sensor = SensorOnTable(description, errors, options, unit)
        self.source = SensorSource(info, text.replace("SIM-", ""), sensor, table)
        self._terminal = Terminal(link)
        self.clock, self.name = TableClock(TableLine(table, self._terminal, resets)), self._terminal.name

    def __enter__(self) -> TableUnderBoard:
        self._terminal.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._terminal.__exit__(*error)
