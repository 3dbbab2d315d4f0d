"""Whole sessions on a virtual table with a virtual board, in one process and in simulated time."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

from virtual_bench import PORT, VirtualBench

from session.annexes.machines.description import read_description
from session.annexes.machines.mechanics import TableErrors
from session.annexes.machines.verbs import TableFault
from session.annexes.machines.virtual_motion import Fault
from session.bench.guide import Guide
from session.bench.guided_session import GuidedRecording
from session.bench.recorder import Recorder
from session.bench.session_file import SessionFile
from tinygc.annexes.machines.recording import TurnedRecording
from tinygc.planning.coach import Coach
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.write import config_text

OPTIONS = SimulationOptions(odr_hz=104, seed=4, bias_instability_dph=0.0)
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


def table_toml(*names: str, make: str = "grbl", limits: dict | None = None, fastest: float = 90.0) -> str:
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
    def texts(self) -> list[str]:
        return [change.text for change in self.changes]


class Bench:
    """A table.toml and its virtual bench; ``record`` leads a recording to its end, again and again into the same folder."""

    def __init__(self, folder: Path, toml: str, options=OPTIONS, errors: TableErrors | None = None, faults: str = "", homed: bool = True):
        self.folder, self.file, self.options = folder / "session", folder / "table.toml", options
        self.file.write_text(toml)
        self.description = read_description(self.file)
        self.bench = VirtualBench(self.description, options, errors, faults=Fault.parse(faults))
        if homed:
            self.bench.home()
        self.folder.mkdir()
        text = config_text(SimpleNamespace(options=options, unit=self.bench.unit), concealed=False)
        (self.folder / "session.toml").write_text(text.replace("SIM-", ""))
        self.keys = ""

    def typed(self) -> str:
        keys, self.keys = self.keys, ""
        return keys

    def press(self, keys: str) -> None:
        self.keys += keys

    def repair(self) -> None:
        """Somebody has put the table right, and has homed it."""
        mechanics = self.bench.virtual.mechanics
        mechanics.release()
        mechanics.clear()
        mechanics._waiting.clear()
        mechanics._since_s.clear()
        mechanics.unknown = [0.0] * len(mechanics.unknown)  # whoever homes it sees no jump of its angles
        self.bench.home()

    def record(self, segments=4, stop_at_target=False, closure_s=0.0, interrupted=None, each=None, rates=None, dwell_s=4.0, home=False):
        """Guide and messages of a recording into the folder, which may hold one already.

        each: called in every round with guide and mover; interrupted(guide): Ctrl-C; rates: dps, of rate steps instead of turns.
        ``closed_with``: the error with which the table was let go of.
        """
        bench, said = self.bench, Said()
        session_file = SessionFile(self.folder, None, None, None, None)
        machine = TurnedRecording(self.file, None, home, bench.opened, bench.clock.now_s)
        if rates is None:
            guide = Guide(session_file.protocol, segments, stop_at_target, closure_s)
            machine.confirmed(False, segments, stop_at_target, closure_s, yes=True, quiet=True)
        else:
            machine.confirmed_rates(rates, dwell_s, None, True, True)
            guide = machine.guide(session_file.protocol)
        recorder = Recorder(self.folder, PORT, port=bench.port)
        self.closed_with, self.mover = None, None

        def configure(info, waited_s):
            return session_file.configure(info, waited_s, recorder.logs.physical, recorder.logs.board, True)

        def stopped():
            if each is not None:
                each(guide, mover)
            return interrupted is not None and interrupted(guide)

        try:
            self.mover = mover = machine.mover(self.folder, guide)
            coach = Coach(machine=machine.moves) if rates is None else None
            guided = GuidedRecording(guide, recorder, configure, coach, said, session_file, self.typed, mover=mover)
            bench.holds = lambda: guided.coaching
            guided.lead(stopped)
        except KeyboardInterrupt:
            pass
        finally:
            bench.holds = lambda: False
            recorder.close()
            machine.finish(self.folder, recorder.logs.renamed)
            try:
                machine.close()
            except TableFault as fault:
                self.closed_with = fault
        return guide, said
