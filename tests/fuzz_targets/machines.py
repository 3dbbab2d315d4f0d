"""What ``table`` reads: ``table.toml``, a make's file, and what comes back over the line, by the input's first byte."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from virtual_line import SimulatedClock, VirtualLink

from fuzz_targets.rules import choose, finite
from session.annexes.machines.description import Axis, Description, read_description
from session.annexes.machines.dialogue import Dialogue, example
from session.annexes.machines.makefile import FOLDER, make_names, read_make
from session.annexes.machines.makes import makes
from session.annexes.machines.safety import Guarded, Move
from session.annexes.machines.template import template
from session.annexes.machines.verbs import TableFault
from session.annexes.machines.virtual import VirtualTable
from session.io.units import DEG

LINES = tuple(make_names())
CHOICES = ("table", "make", *LINES)
WORDS = {"grbl": "X", "scpi": "AXIS1", "line": "outer"}


class Played:
    """A link on which everything that comes back is given: a piece to each look."""

    def __init__(self, data: bytes, clock: SimulatedClock):
        self._pieces = data.splitlines(keepends=True)[::-1]
        self._clock = clock

    def write(self, data: bytes) -> None:
        """Nobody hears it."""

    def read(self, longest_s: float) -> bytes:
        """The next line."""
        if self._pieces:
            return self._pieces.pop()
        self._clock.sleep(longest_s)
        return b""

    def close(self) -> None:
        """Nothing is held."""


def table_of(make: str) -> Description:
    """One axis."""
    axis = Axis("outer", np.array([0.0, 0.0, 1.0]), -DEG * 180, DEG * 180, DEG * 30, DEG * 100, DEG * 0.1, 0.0, WORDS[make])
    return Description("table", make, (axis,))


def run(data: bytes, folder: Path) -> None:
    """Read it; a table that is spoken to says finite angles or a fault."""
    kind, data = choose(data, CHOICES)
    path = folder / f"{kind}.toml"
    if kind in ("table", "make"):
        path.write_bytes(data)
    if kind == "table":
        table = read_description(path)
        finite(table.mounting, *(axis.direction for axis in table.axes))
    elif kind == "make":
        make = read_make(path)
        for _, text in example(table_of("line"), make):
            assert "\n" not in text
    else:
        clock = SimulatedClock()
        driver = Dialogue(table_of(kind), read_make(FOLDER / f"{kind}.toml"), Played(data, clock), clock)
        guarded = Guarded(driver, clock)
        guarded.confirm([Move.home(), Move.anywhere(guarded.description, 0, 30 * DEG)], None, lambda line: None)
        for verb in (guarded.where, guarded.home, guarded.where, lambda: guarded.turn_to(0, DEG, DEG), guarded.settle, guarded.stop):
            try:
                found = verb()
            except TableFault:
                continue
            assert found is None or found.angles.shape == (1,)
            finite(found.angles if found is not None and not found.moving else None)  # nothing is known while it homes first


class Recorded(VirtualLink):
    """A virtual table's line that keeps what came back."""

    heard = b""

    def read(self, longest_s: float) -> bytes:
        """What has come."""
        data = super().read(longest_s)
        self.heard += data
        return data


def seeds() -> list[bytes]:
    """Descriptions and makes' files that come with the tool, and what virtual tables say."""
    found = [bytes([CHOICES.index("table")]) + template(make).encode() for make in makes()]
    found += [bytes([CHOICES.index("make")]) + (FOLDER / f"{make}.toml").read_bytes() for make in LINES]
    for make in LINES:
        clock = SimulatedClock()
        link = Recorded(VirtualTable(table_of(make), None, clock), clock)
        guarded = Guarded(Dialogue(table_of(make), read_make(FOLDER / f"{make}.toml"), link, clock), clock)
        guarded.confirm([Move.home(), Move.anywhere(guarded.description, 0, 30 * DEG)], None, lambda line: None)
        guarded.home()
        guarded.settle()
        guarded.turn_to(0, DEG, DEG)
        guarded.settle()
        guarded.stop()
        found.append(bytes([CHOICES.index(make)]) + link.heard)
    return found
