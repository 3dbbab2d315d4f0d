"""Whole sessions on a virtual table with a virtual board, in one process: what the board streams follows what the table was told.

Time passes only where the recording waits for samples, so that a session of ten minutes lasts seconds, and is the same each time.
"""

from __future__ import annotations

import contextlib
import queue
import time
from collections.abc import Callable

import numpy as np
from imperfect_tables import TableErrors, motion_on
from virtual_tables import SimulatedClock, VirtualLink

from session.base.units import NS
from session.bench import frames
from session.bench.events import Event
from session.bench.guide import Guide
from session.bench.guided_session import GuidedRecording
from session.bench.recorder import Recorder
from session.bench.session_file import SessionFile
from session.log.written import toml_text
from tinygc.features.tables.machines.description import read_description
from tinygc.features.tables.machines.link import TableFault
from tinygc.features.tables.machines.makes import open_table
from tinygc.features.tables.machines.safety import Guarded, Move
from tinygc.features.tables.machines.virtual import VirtualTable
from tinygc.features.tables.machines.virtual_motion import Fault
from tinygc.features.tables.recording import TurnedRecording
from tinygc.planning.coach import Coach
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.sensor import SensorModel
from tinygc.simulation.simulator import unit_of
from tinygc.simulation.virtual_board import info_of
from tinygc.simulation.write import config_of

PORT = "virtual-bench"
#: s of samples in each arrival
EVERY_S = 0.2
HOLD_S = 0.002  #: of the host's time


class VirtualBench:
    """Table, board and clock.  options: of the sensor; errors: of the table; faults: of the
    table's controller and its line.

    virtual: the table's device; silent: whether the board sends nothing; holds: asked before time passes, it waits while that is true.
    """

    def __init__(
        self,
        description,
        options,
        errors=None,
        faults=(),
    ):
        self.clock, self.options, self.errors = SimulatedClock(), options, errors or TableErrors.none(description)
        self.description = description
        self.virtual = VirtualTable(description, self.clock, faults)
        self.virtual.feed()  # its greeting: it was switched on before its port is opened
        self.unit = unit_of(options)
        motion = motion_on(description, self.errors, self.virtual.tracks, options, self.unit)
        self._sensor = SensorModel(options, self.unit, motion)
        self.info = info_of(options, self.unit)
        self.silent = False
        self.holds: Callable[[], bool] = lambda: False
        self.sent = 0

    def opened(self, description, folder=None):
        """The host's side of the table, as from ``open_table``."""
        return Guarded(open_table(description, folder, VirtualLink(self.virtual, self.clock), self.clock), self.clock)

    def home(self):
        """Search the reference marks, before the board is switched on."""
        with self.opened(self.description) as table:
            table.confirm([Move.home()], None, lambda line: None)
            table.home()
            table.settle()

    def skip(self):
        """Nobody has heard what the board has sent by now."""
        self._take()

    def port(self, name, baudrate, keep, setup):
        """The port of the board, for ``Recorder(port=…)``."""
        return BenchPort(self, keep)

    def arrival(self):
        """Let time pass, and return the frames that the board has sent meanwhile."""
        self.clock.sleep(EVERY_S)
        before, log = self.sent, self._take()
        text = b"" if before and before // self._every == self.sent // self._every else frames.encode_info(before, self.info)
        text += frames.encode_samples(np.arange(before, self.sent) + 1, log.t_us, log.rows).tobytes()
        return b"" if self.silent else text

    @property
    def _every(self):
        """Samples between two infos: one a second."""
        return round(self.unit.odr_hz)

    def _take(self):
        """The samples since the last ones."""
        count = int(self.clock.now_s() * self.unit.odr_hz) - self.sent
        self.sent += count
        return self._sensor.take(count)


class BenchPort:
    """Stands for ``session.bench.port.Port``: it is its own queue of items."""

    def __init__(self, bench, keep):
        self.name, self.items = PORT, self
        self._bench, self._keep = bench, keep
        self._opened = False

    def get(self, timeout=None):
        """The next item; time passes."""
        if self._bench.holds():
            time.sleep(HOLD_S)
            raise queue.Empty
        if not self._opened:
            self._opened = True
            self._bench.skip()
            return self._kept(Event("open", text=self.name))
        text = self._bench.arrival()
        if not text:
            raise queue.Empty
        return self._kept(text)

    def get_nowait(self):
        """There is never more than one."""
        raise queue.Empty

    def empty(self):
        """There is never one that waits."""
        return True

    def close(self):
        """The recording ends."""

    @property
    def _host_ns(self):
        return round(self._bench.clock.now_s() / NS)

    def _kept(self, what):
        item = self._host_ns, what
        self._keep(item)
        return item


OPTIONS = SimulationOptions(odr_hz=62.5, seed=4, bias_instability_dph=0.0)
AXIS = """
[[axis]]
name = "{name}"
direction = {direction}
{limits}
fastest_dps = {fastest}
acceleration_dps2 = 200
sigma_deg = 0.02
word = "{word}"
"""
DIRECTIONS = {"outer": [0, 0, 1], "middle": [0, 1, 0], "inner": [1, 0, 0]}


def table_toml(*names, make="grbl", limits=None, fastest=90.0):
    """A table.toml with some of the axes outer, middle, inner."""
    text = f'schema = "tinygc-table/1"\nname = "bench"\nmake = "{make}"\n'
    for word, name in zip("XYZ", names, strict=False):
        given = (limits or {}).get(name)
        bounds = "" if given is None else f"least_deg = {given[0]}\nmost_deg = {given[1]}"
        text += AXIS.format(name=name, direction=DIRECTIONS[name], limits=bounds, fastest=fastest, word=word)
    return text


class Said:
    """Stands for a screen."""

    def __init__(self):
        self.changes = []

    def change(self, change):
        self.changes.append(change)

    def show(self, guide):
        pass

    @property
    def texts(self):
        return [change.text for change in self.changes]


class Bench:
    """A table.toml and its virtual bench; ``record`` leads a recording to its end, again and again into the same folder."""

    def __init__(self, folder, toml, errors=None, faults=""):
        self.folder, self.file = folder / "session", folder / "table.toml"
        self.file.write_text(toml)
        self.description = read_description(self.file)
        self.bench = VirtualBench(self.description, OPTIONS, errors, faults=Fault.parse(faults))
        self.bench.home()
        self.folder.mkdir()
        text = toml_text(config_of(OPTIONS, self.bench.unit))
        (self.folder / "session.toml").write_text(text.replace("SIM-", ""))

    def repair(self):
        """Somebody has put the table right, and has homed it."""
        mechanics = self.bench.virtual.mechanics
        mechanics.release()
        mechanics.clear()
        mechanics._waiting.clear()
        mechanics._since_s.clear()
        mechanics.unknown = [0.0] * len(mechanics.unknown)  # whoever homes it sees no jump of its angles
        self.bench.home()

    def record(self, segments=4, closure_s=0.0, interrupted=None, each=None):
        """Guide and messages of a recording into the folder, which may hold one already.

        each: called in every round with guide and mover; interrupted(guide): Ctrl-C.
        """
        bench, reported = self.bench, Said()
        session_file = SessionFile(self.folder, None, None, None, None)
        machine = TurnedRecording(self.file, opened=bench.opened, now_s=bench.clock.now_s)
        guide = Guide(session_file.protocol, segments, False, closure_s)
        machine.confirmed(False, segments, False, closure_s, yes=True, quiet=True)
        recorder = Recorder(self.folder, PORT, port=bench.port)

        def configure(info, waited_s):
            return session_file.configure(info, waited_s, recorder.logs.physical, recorder.logs.board, True)

        def stopped():
            if each is not None:
                each(guide, mover)
            return interrupted is not None and interrupted(guide)

        try:
            mover = machine.mover(self.folder, guide)
            coach = Coach(machine=machine.moves)
            guided = GuidedRecording(guide, recorder, configure, coach, reported, session_file, lambda: "", mover=mover)
            bench.holds = lambda: guided.coaching
            guided.lead(stopped)
        except KeyboardInterrupt:
            pass
        finally:
            bench.holds = lambda: False
            recorder.close()
            machine.finish(self.folder, recorder.logs.renamed)
            with contextlib.suppress(TableFault):
                machine.close()
        return guide, reported
