"""``record --table FILE``: the table is opened, its plan is confirmed, and a recording gets its mover and its coach."""

from __future__ import annotations

import shutil
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from session.annexes.machines import angles, description
from session.annexes.machines.chamber import Chamber, ChamberDescription, ChamberOfRecording, open_chamber, read_chamber
from session.annexes.machines.clocks import Clock, HostClock
from session.annexes.machines.description import Axis, Description, read_description
from session.annexes.machines.dials import write_attitudes
from session.annexes.machines.driver import AngleFile, TableDriver
from session.annexes.machines.makes import open_table
from session.annexes.machines.mover import MOST_OF_SCALE, TableMover
from session.annexes.machines.rates import RateMover, RatesGuide, RateStep, steps_of
from session.annexes.machines.safety import Guarded, Move
from session.annexes.machines.verbs import TableFault, TableLimit, Where
from session.bench.guide import HOLD_STILLS, Guide
from session.bench.mover import Mover
from session.bench.rest_guide import in_words
from session.io.config import Protocol, read_config
from session.io.errors import CalibrationError, FormatError
from session.io.files import read_text
from session.io.names import log_paths
from session.io.texts import printable
from session.io.units import DEG
from tinygc.annexes.machines.planner import TableMoves, TablePlan, plan_of

MOST_BYTES = 1_000_000
MASTER = "its own emergency stop stays master: keep it in reach; s stops the table at once, p pauses"
HOME = "first all axes search their reference marks, at the machine's own rate"
WAY_FREE = "is the way free, and does the table stand where its angles say (--home)?"
UNCONFIRMED = "the plan is not confirmed, and nothing was moved"


Opened = Callable[[Description, Path], Guarded]


def _opened(table: Description, folder: Path) -> Guarded:
    return Guarded(open_table(table, folder))


class TurnedRecording:
    """A table for the recordings of one command.  ``confirmed`` before the first; ``mover`` for each; ``finish`` at the end.

    file: table.toml; port: instead of its own; home: search the reference marks once the plan is confirmed; opened: opens the description
    in its folder; now_s: of a clock that is not the host's, and then the table has no thread; chamber_opened, chamber_clock: of a chamber.
    Raises FormatError and TableFault.
    """

    def __init__(
        self,
        file: Path,
        port: str | None = None,
        home: bool = False,
        opened: Opened = _opened,
        now_s: Callable[[], float] | None = None,
        chamber_opened: Callable[[ChamberDescription, Clock], Chamber] = open_chamber,
        chamber_clock: Clock | None = None,
    ):
        self.file, self._home, self._opened, self._now_s = file, home, opened, now_s
        described = read_description(file)
        self.description = described if port is None else replace(described, port=port)
        self._chamber: ChamberOfRecording | None = None
        self._chamber_clock = chamber_clock or HostClock()
        self._chamber_opened = chamber_opened
        self._guards = ExitStack()
        self._plan: list[Move] = []
        self._steps: list[RateStep] = []
        angles = np.zeros(len(described.axes))
        try:
            self._table: Guarded | None = self._open()
            if not home:
                angles = self._angles(self._table.where())
        except BaseException:
            self.close()
            raise
        self.moves = TableMoves(self.description, angles, HOLD_STILLS * Protocol().still_s)

    def confirmed(self, own: bool, segments: int, stop_at_target: bool, closure_s: float, yes: bool, quiet: bool = False) -> None:
        """Print the plan, and have it confirmed.  CalibrationError where nobody does, or where the table can make no turn.

        own: whether the accelerometer is not calibrated.
        """
        plan = plan_of(self.moves, own, segments, stop_at_target)
        self._ask(self.plan_lines(plan, segments, closure_s), yes, quiet)
        self.moves.first = plan.turns[0].moves
        self._plan = [
            Move(k, *limits, axis.fastest_rps)
            for k, (axis, limits) in enumerate(zip(self.description.axes, self.moves.limits, strict=True))
        ]
        self._homed()

    def confirmed_rates(
        self,
        rates_dps: Sequence[float],
        dwell_s: float,
        axis: str | None,
        yes: bool,
        quiet: bool = False,
        chamber: Path | None = None,
        temperatures_c: Sequence[float] = (),
    ) -> None:
        """Print the plan of rate steps, and have it confirmed.  axis: its name, None: the innermost one; chamber: its chamber.toml, and the
        temperatures at each of which all steps are made."""
        table = self.description
        number = len(table.axes) - 1 if axis is None else table.axis(axis)
        self._steps = steps_of(table, number, [rate * DEG for rate in rates_dps], dwell_s)
        of, seconds = table.axes[number], sum(step.seconds(table) for step in self._steps)
        rates = ", ".join(f"{step.rate_rps / DEG:+g}" for step in self._steps)
        lines = [f"plan of {table.name} ({table.make}): from here on it turns by itself"]
        lines += [f"  {HOME}"] if self._home else []
        lines.append(f"  {of.name} at {rates} dps, {dwell_s:g} s each, with rests between: {len(self._steps)} steps in {in_words(seconds)}")
        limits = "it turns many times: may the sensor's cable?" if of.is_endless else "each step begins at a limit of the axis"
        lines.append(f"  {limits}")
        described = None if chamber is None else read_chamber(chamber)
        lines += [] if described is None else _chamber_lines(described, temperatures_c)
        self._ask([*lines, f"  {MASTER}", f"  {WAY_FREE}"], yes, quiet)
        if described is not None:
            self._chamber = ChamberOfRecording(self._chamber_opened(described, self._chamber_clock), self._chamber_clock)
            self._guards.callback(self._chamber.close)
            self._steps = [replace(step, temperature_c=temperature_c) for temperature_c in temperatures_c for step in self._steps]
        fastest = max(abs(step.rate_rps) for step in self._steps)
        back = [] if of.is_endless else [Move.anywhere(table, number, of.fastest_rps)]
        self._plan = [Move.at(number, fastest), *back]
        self._homed()

    @staticmethod
    def _ask(lines: list[str], yes: bool, quiet: bool) -> None:
        if not (quiet and yes):
            print("\n".join(map(printable, lines)), file=sys.stderr, flush=True)
        if yes:
            return
        if not sys.stdin.isatty():
            raise CalibrationError(f"{UNCONFIRMED}: standard input is no terminal; --yes where you know the table")
        print("turn? (yes) ", end="", file=sys.stderr, flush=True)
        if sys.stdin.readline().strip().lower() not in ("y", "yes"):
            raise CalibrationError(UNCONFIRMED)

    def guide(self, protocol: Protocol) -> RatesGuide:
        """The guide of the rate steps that were confirmed."""
        return RatesGuide(protocol, len(self._steps), self._chamber is not None)

    def plan_lines(self, plan: TablePlan, segments: int, closure_s: float) -> list[str]:
        """The plan: axes with the largest angle and rate that will be used, the number of turns and the time, what will not be seen."""
        table, count = self.description, len(plan.turns)
        lines = [f"plan of {table.name} ({table.make}): from here on it turns by itself"]
        lines += [f"  {HOME}"] if self._home else []
        lines += [_axis_line(axis, limits) for axis, limits in zip(table.axes, self.moves.limits, strict=True)]
        closing = f", then a closure run of {closure_s:.0f} s" if closure_s else ""
        lines.append(f"  {segments} turns at most; {count} in {in_words(plan.seconds)} if all goes well{closing}")
        if plan.unseen:
            lines.append(f"  this table shows nothing of {', '.join(plan.unseen)}: set the sensor on it in another way too")
        return [*lines, f"  {MASTER}", f"  {WAY_FREE}"]

    def mover(self, folder: Path, guide: Guide) -> Mover:
        """The mover of a recording in a folder, which gets a copy of table.toml.  FormatError where it is of another table."""
        text, copy = read_text(self.file, MOST_BYTES), folder / description.NAME
        if copy.exists() and read_text(copy, MOST_BYTES) != text:
            raise FormatError(f"{copy}: differs from {self.file}; a session is of one table: give --table {copy}, or another --out")
        if not copy.exists():
            folder.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(self.file, copy)
        table, self._table = self._table or self._open(), None
        table.confirm(self._plan, None, lambda line: None)  # it was shown by ``confirmed``
        self.moves.hold_s = guide.hold_s
        file, alone = AngleFile(folder / angles.NAME, self.description), self._now_s is None
        driver = TableDriver(table, file, self._now_s or time.monotonic, in_thread=alone)
        return RateMover(driver, self._steps, self._chamber) if self._steps else TableMover(driver, self.moves)

    def finish(self, folder: Path, renamed: Mapping[str, str]) -> str:
        """Name the logs in ``table.csv`` as they are named now, and write ``attitudes.csv``; returns what was written, in words."""
        if not (folder / angles.NAME).exists() or not log_paths(folder, "log"):
            return ""
        file = AngleFile(folder / angles.NAME, self.description)
        for old, new in renamed.items():
            file.rename(old, new)
        file.close()
        count = write_attitudes(folder)
        return f"attitudes.csv: the machine's angles in {count} stills"

    def close(self) -> None:
        """Bring the table to rest, and let go of it."""
        self._guards.close()

    def _angles(self, where: Where) -> np.ndarray:
        """Angles (K,) rad of a table that knows them."""
        if where.fault or not np.isfinite(where.angles).all():
            why = where.fault or "it does not know its angles"
            raise TableFault(f"{self.description.name}: {why}; --home, or `table home`, then begin again")
        return where.angles

    def _homed(self) -> None:
        """Search the reference marks, where that was asked for: it is part of the plan that was confirmed."""
        if not self._home or self._table is None:
            return
        self._table.confirm([Move.home()], None, lambda line: None)
        self._table.home()
        self.moves.angles = self._angles(self._table.settle())

    def _open(self) -> Guarded:
        return self._guards.enter_context(self._opened(self.description, self.file.parent))


def _axis_line(axis: Axis, limits: tuple[float, float]) -> str:
    least, most = (limit / DEG for limit in limits)
    endless = " (it has no limits; a cable may)" if axis.is_endless else ""
    rate = f"at most {axis.fastest_rps / DEG:g} dps, and {MOST_OF_SCALE:.0%} of the sensor's full scale"
    return f"  {axis.name:8s} {least:.0f} to {most:.0f} deg{endless}, {rate}"


def _chamber_lines(of: ChamberDescription, temperatures_c: Sequence[float]) -> list[str]:
    """The plan of a chamber.  TableLimit where it may not go to one of the temperatures."""
    for each in temperatures_c:
        if not of.least_c <= each <= of.most_c:
            raise TableLimit(f"chamber: {each:g} degC, expected {of.least_c:g} to {of.most_c:g}; nothing was sent")
    asked = ", ".join(f"{each:g}" for each in temperatures_c)
    stable = f"within {of.within_c:g} degC for {in_words(of.stable_s)}, at most {in_words(of.longest_s)} after it was set"
    rest = "it stays as it is" if of.rest_c is None else f"it is set to {of.rest_c:g} degC"
    return [
        f"  all of that at each of {asked} degC, once the chamber has been stable: {stable}",
        f"  when the recording ends, also by Ctrl-C, the chamber stays on: {rest}",
    ]


def is_raw(folder: Path, like: Path | None) -> bool:
    """Whether a recording will have to calibrate its accelerometer, as far as it is known before its first sample."""
    known = next((path for path in (folder / "session.toml", like) if path is not None and path.exists()), None)
    return known is None or read_config(known).accelerometer.source == "none"
