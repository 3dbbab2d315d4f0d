"""The virtual table's port, alone or beneath a board: what a dropped cable and a restart do to it."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from table_recordings import OPTIONS, table_toml
from virtual_line import SimulatedClock

pytest.importorskip("tinygc.simulation.terminal", reason="a pseudo-terminal is POSIX's", exc_type=ImportError)

from session.annexes.machines.description import read_description
from session.annexes.machines.virtual import VirtualTable
from tinygc.annexes.machines.board import TableUnderBoard
from tinygc.annexes.machines.virtual_line import TableLine


def test_each_opening_of_the_port_restarts_a_controller_that_resets(tmp_path):
    (tmp_path / "table.toml").write_text(table_toml("outer"))
    table = VirtualTable(read_description(tmp_path / "table.toml"), None, SimulatedClock())
    terminal = SimpleNamespace(has_reader=False, read=lambda: b"", write=lambda text: True)
    counts = []
    for resets in (False, True):
        line = TableLine(table, terminal, resets)
        for terminal.has_reader in (False, True, True, False, True):
            line.answer()
        counts.append(table.mechanics.restarts)
    assert counts == [0, 2]


def test_the_port_beneath_a_board_goes_when_its_cable_drops(tmp_path):
    """It stayed, and the host read that the table does not answer; an Uno could not be tried with a board on it."""
    (tmp_path / "table.toml").write_text(table_toml("outer"))
    with TableUnderBoard(tmp_path / "table.toml", tmp_path / "port", OPTIONS, faults="cable", resets=True) as bench:
        assert (tmp_path / "port").is_symlink()
        bench.clock.sleep(0.001)
        assert not (tmp_path / "port").exists()
