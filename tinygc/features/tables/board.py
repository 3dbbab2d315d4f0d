"""``board --table FILE``: a virtual board on a virtual table, behind a port each, in real time.

What the board streams follows the commands on the table's own port.  The table's device is read whenever the board waits, so that
one thread serves both.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from session.base.errors import CalibrationError
from session.base.options import given
from session.bench.clocks import Clock
from session.log.written import toml_text
from tinygc.features.tables.feature import TableOptions
from tinygc.features.tables.machines.description import attitudes, read_description
from tinygc.features.tables.machines.virtual import TableLine, VirtualTable
from tinygc.features.tables.machines.virtual_motion import Fault
from tinygc.simulation.movement import felt
from tinygc.simulation.options import SimulatedUnit, SimulationOptions
from tinygc.simulation.sensor import Motion, SensorModel, self_heating
from tinygc.simulation.simulator import unit_of
from tinygc.simulation.virtual_board import BoardSource, info_of
from tinygc.simulation.write import config_of, head_of


def motion_on(attitudes_at: Callable[[np.ndarray], np.ndarray], options: SimulationOptions, unit: SimulatedUnit) -> Motion:
    """Motion of a sensor at ``options.lever_m`` on the innermost stage, of its attitudes R_tb (N, 3, 3) at times (N,) s.

    A track has no derivatives at its corners: rates are means over a step of the grid of times, about each time.
    """

    def motion(t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        step = (t_s[-1] - t_s[0]) / (len(t_s) - 1)
        body = Rotation.from_matrix(attitudes_at(np.append(t_s, t_s[-1] + step) - step / 2))
        rate = (body[:-1].inv() * body[1:]).as_rotvec() / step
        middle = (body[:-1] * Rotation.from_rotvec(rate * step / 2)).inv()
        inputs = felt(options, unit.heading_deg, rate, np.gradient(rate, step, axis=0), middle.apply)
        return *inputs, self_heating(options, t_s)

    return motion


def table_under(args: Any, options: SimulationOptions) -> TableUnderBoard | None:
    """The table of ``board --table``; None without one.  Raises CalibrationError for options that do not go with it."""
    table: TableOptions = args.of_feature(TableOptions)
    if table.file is None:
        if others := given(table):
            raise CalibrationError(f"board: {', '.join(others)}: of a table; add --table FILE")
        return None
    if args.folder or args.speed != 1:
        raise CalibrationError("board: --table is a board of its own, in real time; leave the folder and --speed out")
    return TableUnderBoard(table.file, table.link, options, not args.raw_accelerometer, table.faults, table.resets)


class TableUnderBoard:
    """A context: ``source`` and ``clock`` of the board, ``name`` of the table's port.

    file: table.toml; link: of the table's port; faults and resets: as ``table virtual`` takes them.
    """

    def __init__(self, file: Path, link: Path | None, options: SimulationOptions, calibrated: bool, faults: str, resets: bool):
        from tinygc.simulation.terminal import Terminal  # of POSIX alone

        description = read_description(file)
        table = VirtualTable(description, Clock(), Fault.parse(faults), options.seed)
        unit = unit_of(options)

        def attitudes_at(t_s: np.ndarray) -> np.ndarray:
            return attitudes(description, np.stack([track.reported(t_s) for track in table.tracks], axis=-1))

        sensor = SensorModel(options, unit, motion_on(attitudes_at, options, unit))
        text = (head_of(options) + toml_text(config_of(options, unit, calibrated))).replace("SIM-", "")  # as the board reports its serial

        def rows(count: int) -> np.ndarray:
            if not sensor.next:  # the board was switched on later than the table
                sensor.next = round(table.mechanics.now_s() * unit.odr_hz)
            return sensor.take(count).rows

        self.source = BoardSource(np.zeros((0, 7), np.int16), info_of(options, unit), text, live=rows)
        self._terminal = Terminal(link)
        self.clock, self.name = TableLine(table, self._terminal, resets), self._terminal.name

    def __enter__(self) -> TableUnderBoard:
        self._terminal.__enter__()
        return self

    def __exit__(self, *error: object) -> None:
        self._terminal.__exit__(*error)
