"""``record --table FILE``: the table is opened, its plan is confirmed, and a recording gets its mover and its coach."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from session.annexes.machines import angles, description
from session.annexes.machines.description import Axis, read_description
from session.annexes.machines.dials import write_attitudes
from session.annexes.machines.driver import AngleFile, TableDriver
from session.annexes.machines.mover import MOST_OF_SCALE, TableMover
from session.annexes.machines.verbs import Table, TableFault
from session.bench.guide import HOLD_STILLS, Guide
from session.io.config import Protocol, read_config
from session.io.errors import CalibrationError, FormatError
from session.io.files import read_text
from session.io.texts import printable
from session.io.units import DEG
from tinygc.annexes.machines.planner import TableMoves, TablePlan, plan_of

MOST_BYTES = 1_000_000
MASTER = "its own emergency stop stays master: keep it in reach; s stops the table at once, p pauses"
UNCONFIRMED = "the plan is not confirmed, and nothing was moved"


class TurnedRecording:
    """A table for the recordings of one command.  ``confirmed`` before the first; ``mover`` for each; ``finish`` at the end.

    file: table.toml; port: instead of its own; opened: opens a description in a folder.  Raises FormatError and TableFault.
    """

    def __init__(self, file: Path, port: str | None, opened: Callable[[Path, str | None], Table] | None = None):
        self.file, self._port, self._opened = file, port, opened or open_machine
        self._described = read_description(file)
        self._table: Table | None = self._opened(file, port)
        try:
            where = self._table.where()
        except BaseException:
            self._table.close()
            raise
        if where.fault:
            self._table.close()
            raise TableFault(f"{self._described.name}: {where.fault}; put it right, then begin again")
        self.moves = TableMoves(self._described, where.angles, HOLD_STILLS * Protocol().still_s)

    def confirmed(self, own: bool, segments: int, stop_at_target: bool, closure_s: float, yes: bool, quiet: bool = False) -> None:
        """Print the plan, and have it confirmed.  CalibrationError where nobody does, or where the table can make no turn.

        own: whether the accelerometer is not calibrated.
        """
        plan = plan_of(self.moves, own, segments, stop_at_target)
        if not (quiet and yes):
            print(printable_lines(self.plan_lines(plan, segments, closure_s)), file=sys.stderr, flush=True)
        if yes:
            return
        if not sys.stdin.isatty():
            raise CalibrationError(f"{UNCONFIRMED}: standard input is no terminal; --yes where you know the table")
        print("turn? (yes) ", end="", file=sys.stderr, flush=True)
        if sys.stdin.readline().strip().lower() not in ("y", "yes"):
            raise CalibrationError(UNCONFIRMED)

    def plan_lines(self, plan: TablePlan, segments: int, closure_s: float) -> list[str]:
        """The plan: axes with the largest angle and rate that will be used, the number of turns and the time, what will not be seen."""
        table, count = self._described, len(plan.rehearsal.turns)
        lines = [f"plan of {table.name} ({table.make}): from here on it turns by itself"]
        lines += [_axis_line(axis, limits) for axis, limits in zip(table.axes, self.moves.limits, strict=True)]
        closing = f", then a closure run of {closure_s:.0f} s" if closure_s else ""
        lines.append(f"  {segments} turns at most; {count} in {plan.seconds / 60:.0f} min if all goes well{closing}")
        if plan.unseen:
            lines.append(f"  this table shows nothing of {', '.join(plan.unseen)}: set the sensor on it in another way too")
        return [*lines, f"  {MASTER}", "  is the way free, and does the table stand where its angles say (table home)?"]

    def mover(self, folder: Path, guide: Guide) -> TableMover:
        """The mover of a recording in a folder, which gets a copy of table.toml.  FormatError where it is of another table."""
        text, copy = read_text(self.file, MOST_BYTES), folder / description.NAME
        if copy.exists() and read_text(copy, MOST_BYTES) != text:
            raise FormatError(f"{copy}: differs from {self.file}; a session is of one table: give --table {copy}, or another --out")
        if not copy.exists():
            folder.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(self.file, copy)
        table, self._table = self._table or self._opened(self.file, self._port), None
        self.moves.hold_s = guide.hold_s
        return TableMover(TableDriver(table, AngleFile(folder / angles.NAME, self._described)), self.moves)

    def finish(self, folder: Path, renamed: Mapping[str, str]) -> str:
        """Name the logs in ``table.csv`` as they are named now, and write ``attitudes.csv``; returns what was written, in words."""
        if not (folder / angles.NAME).exists():
            return ""
        file = AngleFile(folder / angles.NAME, self._described)
        for old, new in renamed.items():
            file.rename(old, new)
        file.close()
        count = write_attitudes(folder)
        return f"attitudes.csv: the machine's angles in {count} stills"

    def close(self) -> None:
        """Let go of a table that no recording took over."""
        if self._table is not None:
            self._table.close()


def open_machine(file: Path, port: str | None) -> Table:
    """Open the machine of a table.toml."""
    from session.annexes.machines.makes import open_table

    table = read_description(file)
    return open_table(table if port is None else replace(table, port=port), file.parent)


def printable_lines(lines: list[str]) -> str:
    """Lines for a terminal."""
    return "\n".join(map(printable, lines))


def _axis_line(axis: Axis, limits: tuple[float, float]) -> str:
    least, most = (limit / DEG for limit in limits)
    endless = " (it has no limits; a cable may)" if axis.is_endless else ""
    rate = f"at most {axis.fastest_rps / DEG:g} dps, and {MOST_OF_SCALE:.0%} of the sensor's full scale"
    return f"  {axis.name:8s} {least:.0f} to {most:.0f} deg{endless}, {rate}"


def is_raw(folder: Path, like: Path | None) -> bool:
    """Whether a recording will have to calibrate its accelerometer, as far as it is known before its first sample."""
    known = next((path for path in (folder / "session.toml", like) if path is not None and path.exists()), None)
    return known is None or read_config(known).accelerometer.source == "none"
