"""A virtual table behind a pseudo-terminal, as a program opens a real one's port.  POSIX only."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from session.annexes.machines.clocks import Clock
from session.annexes.machines.virtual import VirtualTable
from tinygc.simulation.terminal import Terminal

#: name of the port where none is given
LINK = Path(tempfile.gettempdir()) / "tinygc-table"
POLL_S = 0.002


def serve(table: VirtualTable, terminal: Terminal, clock: Clock, resets: bool, is_over: Callable[[], bool]) -> None:
    """Answer at a terminal until it is over; resets: an opened port restarts the controller, as it does an Arduino Uno.

    Where the cable drops, the port goes away; the motion goes on.
    """
    had_reader = False
    while not is_over():
        if not table.is_connected:
            terminal.unplug()
        has_reader = terminal.has_reader
        if resets and has_reader and not had_reader:
            table.mechanics.restart()
        had_reader = has_reader
        if answer := table.feed(terminal.read()):
            terminal.write(answer)
        clock.sleep(POLL_S)
