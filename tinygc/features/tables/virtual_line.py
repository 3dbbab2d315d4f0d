"""A virtual table behind a pseudo-terminal, as a program opens a real one's port.  POSIX only."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from session.bench.clocks import Clock
from tinygc.features.tables.machines.virtual import VirtualTable

if TYPE_CHECKING:
    from tinygc.simulation.terminal import Terminal

#: name of the port where none is given
LINK = Path(tempfile.gettempdir()) / "tinygc-table"
POLL_S = 0.002


class TableLine:
    """A virtual table at a terminal; resets: an opened port restarts the controller, as it does an Arduino Uno."""

    def __init__(self, table: VirtualTable, terminal: Terminal, resets: bool):
        self._table, self._terminal, self._resets = table, terminal, resets
        self._had_reader = False

    def answer(self) -> None:
        """Take what has come, and answer it.  Where the cable drops, the port goes away; the motion goes on."""
        if not self._table.is_connected:
            self._terminal.unplug()
        has_reader = self._terminal.has_reader
        if self._resets and has_reader and not self._had_reader:
            self._table.mechanics.restart()
        self._had_reader = has_reader
        if answer := self._table.feed(self._terminal.read()):
            self._terminal.write(answer)


def serve(table: VirtualTable, terminal: Terminal, clock: Clock, resets: bool, is_over: Callable[[], bool]) -> None:
    """Answer at a terminal until it is over."""
    line = TableLine(table, terminal, resets)
    while not is_over():
        line.answer()
        clock.sleep(POLL_S)
