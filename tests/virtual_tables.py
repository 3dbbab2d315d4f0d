"""Tables of each make in this process: a description, the make's driver, and its virtual table at a clock that waits for nobody."""

from __future__ import annotations

import numpy as np

from session.annexes.machines.clocks import SimulatedClock
from session.annexes.machines.description import Axis, Description
from session.annexes.machines.makes import open_table
from session.annexes.machines.safety import Guarded, Move
from session.annexes.machines.virtual import VirtualTable
from session.annexes.machines.virtual_makes import FIRMWARE
from session.annexes.machines.virtual_motion import Fault
from session.annexes.machines.wire import VirtualLink
from session.io.units import DEG

MAKES = tuple(FIRMWARE)
WORDS = {"grbl": "XY", "marlin": "XY", "scpi": ("AXIS1", "AXIS2"), "line": ("outer", "inner")}
#: makes of one axis
SINGLE = ("aerosmith", "drive")


def axis(name, word, limits=(-90, 270), direction=(0, 0, 1), **more):
    least, most = (None, None) if limits is None else (limits[0] * DEG, limits[1] * DEG)
    figures = {"fastest_rps": 60 * DEG, "acceleration_rps2": 100 * DEG, "sigma_rad": 0.05 * DEG, "backlash_rad": 0.1 * DEG} | more
    return Axis(name, np.array(direction, dtype=float), least, most, word=word, **figures)


def description(make, limits=(-90, 270), axes=1, **settings):
    words = WORDS.get(make, "12")
    rows = [axis("outer", words[0], limits), axis("inner", words[1], limits, (1, 0, 0))][:axes]
    return Description("table", make, tuple(rows), settings=settings)


class Bench:
    """A virtual table of a make and what drives it: ``driver`` (the make), ``guarded``, ``virtual``, ``link`` and ``clock``."""

    def __init__(self, table, faults="", errors=None, folder=None, virtual=None, greets=False, stops=False):
        self.clock, self.table = SimulatedClock(), table
        self.virtual = VirtualTable(virtual or table, errors, self.clock, Fault.parse(faults))
        if not greets:
            self.virtual.feed()  # it was switched on before its port is opened
        self.link = VirtualLink(self.virtual, self.clock)
        self.driver = open_table(table, folder, self.link, self.clock, stops)
        self.guarded = Guarded(self.driver, self.clock)

    def confirm(self, *moves):
        """All moves of all axes, unless some are given."""
        every = [Move.home()]
        for number, of in enumerate(self.table.axes):
            every += [Move.anywhere(self.table, number, of.fastest_rps), Move.at(number, of.fastest_rps, 600.0)]
        self.guarded.confirm(moves or every, None, lambda line: None)

    def motor(self, number=0):
        """Where its motor is by now: angle, rad, and rate, rad/s."""
        return self.virtual.tracks[number].state(self.clock.now_s() - self.virtual.begin_s)

    def comes_to_rest(self):
        """Wait until no motor turns any more; False where one turns for ever."""
        end_s = max(track.busy_until_s for track in self.virtual.tracks)
        if end_s < np.inf:
            self.clock.sleep(end_s - self.clock.now_s() + self.virtual.begin_s)
        return end_s < np.inf
