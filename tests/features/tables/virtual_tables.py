"""Tables of each make in this process: a clock that turns on by itself, a line, a make's driver and its virtual table.

``OWN`` is a make's file of one's own, with what no shipped make has; its controller is here.
"""

import threading
from pathlib import Path
from typing import Protocol

import numpy as np

from session.base.units import DEG
from tinygc.features.tables.machines.description import Axis, Description
from tinygc.features.tables.machines.link import PRESS, TableFault
from tinygc.features.tables.machines.makefile import read_make
from tinygc.features.tables.machines.makes import open_table
from tinygc.features.tables.machines.safety import Guarded, Move
from tinygc.features.tables.machines.virtual import FIRMWARE, Firmware, VirtualTable
from tinygc.features.tables.machines.virtual_motion import Fault

#: s between two looks for bytes
POLL_S = 0.01


class SimulatedClock:
    """Time that passes only where somebody waits: hours of a virtual table within a second."""

    def __init__(self, now_s=0.0):
        self._now_s = now_s
        self._lock = threading.Lock()

    def now_s(self):
        """Seconds so far."""
        return self._now_s

    def sleep(self, seconds):
        """Let a time pass at once."""
        with self._lock:
            self._now_s += max(seconds, 0.0)


class Device(Protocol):
    """A virtual device, such as a ``VirtualTable``."""

    @property
    def is_connected(self):
        """Whether the cable is in."""
        ...

    def feed(self, data=b""):
        """Take what was sent; what is received by now."""
        ...


class VirtualLink:
    """A virtual device in this process: what is sent is answered at once, and waiting turns its clock on."""

    def __init__(self, device, clock):
        self.device, self._clock = device, clock
        self._lock, self._received = threading.Lock(), b""
        #: everything that was sent, for tests
        self.sent = b""

    def write(self, data):
        """Send bytes."""
        self._feed(data)

    def read(self, longest_s):
        """What has come."""
        end_s = self._clock.now_s() + longest_s
        while True:
            self._feed(b"")
            with self._lock:
                data, self._received = self._received, b""
            if data or self._clock.now_s() >= end_s:
                return data
            self._clock.sleep(POLL_S)

    def close(self):
        """Nothing is held."""

    def _feed(self, data):
        with self._lock:
            self.sent += data
            self._received += self.device.feed(data)
        if not self.device.is_connected:
            raise TableFault(f"the line to the table is lost (virtual cable); is the cable in? {PRESS}")


OWN = "./own_make.toml"


class Own(Firmware):
    """The controller of ``OWN``: its motors are off until EN; a prompt behind each answer; the last axis homes all."""

    END = "\r"

    def __init__(self, mechanics):
        super().__init__(mechanics)
        self._rates_dps = [10.0] * len(self.words)
        self._is_on = False

    def lines(self, texts):
        return "".join(text if text == ">" else text + self.END for text in texts).encode()

    def alarm(self, problem):
        return [{"estop": "! 1", "limit": "! 2", "home_fails": "! 3"}[problem]]

    def answer(self, line):
        word, *numbers = line.split()
        reported = self._answer(word, int(numbers[0]) - 1 if numbers else 0, float(numbers[1]) if len(numbers) > 1 else 0.0)
        return [] if word == "HM" and self.later else [*reported, ">"]

    def _answer(self, word, axis, number):
        mechanics = self.mechanics
        if word == "TP":
            return [" ".join(f"{name}={round(1000 * self.deg(k))}" for k, name in enumerate(self.words))]
        if word == "ST":
            mechanics.stop()
        elif mechanics.once("unknown_error"):
            return ["? 99"]
        elif word == "CL":
            return [] if mechanics.clear() else ["? 5"]
        elif word == "EN":
            self._is_on = True
        elif mechanics.stopped_by or mechanics.suffers("disabled") or not self._is_on:
            return ["? 5" if mechanics.stopped_by else "? 4"]
        elif word == "SP":
            self._rates_dps[axis] = number
        elif word == "PA":
            mechanics.turn_to(axis, number * DEG, self._rates_dps[axis] * DEG)
        elif axis + 1 == len(self.words) and mechanics.home():
            self.later = [">"]
        return []


FIRMWARE[OWN] = Own
MAKES = tuple(FIRMWARE)
#: deg where it rests once homed
HOMED = {"grbl": 1.0}
WORDS = {"grbl": "XY", "scpi": ("AXIS1", "AXIS2"), "line": ("outer", "inner"), OWN: "AB"}


def axis(name, word, limits=(-90, 270), direction=(0, 0, 1), **more):
    least, most = (-np.inf, np.inf) if limits is None else (limits[0] * DEG, limits[1] * DEG)
    figures = {"fastest_rps": 60 * DEG, "acceleration_rps2": 100 * DEG, "sigma_rad": 0.05 * DEG, "backlash_rad": 0.1 * DEG} | more
    return Axis(name, np.array(direction, dtype=float), least_rad=least, most_rad=most, word=word, **figures)


def description(make, limits=(-90, 270), axes=1, **settings):
    """A GRBL with switches has all its travel on one side of them: here above, by its sense, from 1 deg on, where it rests once homed."""
    if make == "grbl" and limits is not None and settings.get("homing", True):
        limits, settings = (max(1, limits[0]), limits[1]), {"per_deg": -1.0} | settings
    words = WORDS.get(make, "XY")
    rows = [axis("outer", words[0], limits), axis("inner", words[1], limits, (1, 0, 0))][:axes]
    own = read_make(Path(__file__).parent / make).sha256 if make == OWN else ""
    return Description("table", make, tuple(rows), settings=settings, make_sha256=own)


class Bench:
    """A virtual table of a make and what drives it: ``driver`` (the make), ``guarded``, ``virtual``, ``link`` and ``clock``."""

    def __init__(self, table, faults="", folder=None, virtual=None, greets=False, stops=False):
        self.clock, self.table = SimulatedClock(), table
        self.virtual = VirtualTable(virtual or table, self.clock, Fault.parse(faults))
        if not greets:
            self.virtual.feed()  # it was switched on before its port is opened
        self.link = VirtualLink(self.virtual, self.clock)
        self.driver = open_table(table, folder or Path(__file__).parent, self.link, self.clock, stops)
        self.guarded = Guarded(self.driver, self.clock)

    def confirm(self, *moves):
        """All moves of all axes, unless some are given."""
        every = [Move.home()]
        for number, of in enumerate(self.table.axes):
            every += [Move.anywhere(self.table, number, of.fastest_rps), Move.at(number, of.fastest_rps, 600.0)]
        self.guarded.confirm(moves or every, None, lambda line: None)

    def motor(self, number=0):
        """Where its motor is by now, in the sense of its description: angle, rad, and rate, rad/s."""
        sense = np.sign(self.table.settings.get("per_deg", 1.0))
        return sense * np.array(self.virtual.tracks[number].state(self.clock.now_s() - self.virtual.mechanics.begin_s))

    def comes_to_rest(self):
        """Wait until no motor turns any more; False where one turns for ever."""
        end_s = max(track.busy_until_s for track in self.virtual.tracks)
        if end_s < np.inf:
            self.clock.sleep(end_s - self.clock.now_s() + self.virtual.mechanics.begin_s)
        return end_s < np.inf
