"""``table record``: the table is opened, its plan is confirmed, and a recording gets its mover and its coach."""

from __future__ import annotations

import sys
import textwrap
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np

from session.base.errors import FormatError
from session.base.files import copy_new, read_text
from session.base.names import log_paths
from session.base.texts import printable
from session.base.units import DEG
from session.bench.guide import HOLD_STILLS, Guide, Mover
from session.bench.rawfile import put_aside
from session.bench.rest_guide import in_words
from session.detect import accelerometer
from session.detect.segments import LONGEST_TURN_SEGMENTS
from session.log.config import Protocol, read_config
from tinygc.features.tables.machines import angles, description
from tinygc.features.tables.machines.angles import AngleFile, write_attitudes
from tinygc.features.tables.machines.description import Axis, Description, read_description
from tinygc.features.tables.machines.makes import open_table
from tinygc.features.tables.machines.mover import MOST_OF_SCALE, TableDriver, TableMover
from tinygc.features.tables.machines.safety import Guarded, Move, ask_person
from tinygc.features.tables.planner import TableMoves, plan_of
from tinygc.models.linear import PARAMETERS
from tinygc.planning.turns import Turn

MOST_BYTES = 1_000_000
MASTER = "its own emergency stop stays master: keep it in reach; s stops the table at once, p pauses"
HOME = "first all axes search their reference marks, at the machine's own rate"
WAY_FREE = "is the way free, and does the table stand at its angles (--home)?"
UNCONFIRMED = "the plan is not confirmed, and nothing was moved"
#: what is requested of a table that shows less than this share of the parameters
LEAST_SHOWN, SHOWS_LITTLE = 0.5, "such a session calibrates little of the sensor: turn nevertheless? (yes)"
LINE, HARD_SPACE = 138, "\N{NO-BREAK SPACE}"  #: characters of a line of the plan


Opened = Callable[[Description, Path], Guarded]


def _opened(table: Description, folder: Path) -> Guarded:
    return Guarded(open_table(table, folder))


def require_table_of(file: Path, folder: Path) -> str:
    """FormatError where a recording in a folder is of another table: its ``table.csv`` would hold other angles from here on.

    The entries on how the table and the sensor lie (mounting, direction), its limits and what it can do may have been corrected since:
    returns what that means, in words, or an empty text.
    """
    copy = folder / description.NAME
    if not copy.exists() or read_text(copy, MOST_BYTES) == read_text(file, MOST_BYTES):
        return ""
    before, now = read_description(copy), read_description(file)
    if (before.make, before.settings) != (now.make, now.settings) or [each.name for each in before.axes] != [
        each.name for each in now.axes
    ]:
        differs = f"{copy}: make, settings or names of the axes are not those of {file}"
        raise FormatError(f"{differs}; a session is of one table: give --table {copy}, or another --out")
    return f"{copy}: {file} takes its place, for what is recorded already too; the one before is kept next to it"


class TurnedRecording:
    """A table for the recordings of one command.  ``confirmed`` before the first; ``mover`` for each; ``finish`` at the end.

    file: table.toml; port: instead of its own; home: search the reference marks once the plan is confirmed; at_zero: a person confirms that
    every axis stands at its zero; opened: opens the description in its folder; now_s: of a clock that is not the host's, and then the table
    has no thread.  Raises FormatError, TableFault, and TableLimit for a table that has
    restarted and lost its angles.
    """

    def __init__(
        self,
        file: Path,
        port: str | None = None,
        home: bool = False,
        opened: Opened = _opened,
        now_s: Callable[[], float] | None = None,
        at_zero: bool = False,
    ):
        self.file, self._home, self._opened, self._now_s = file, home, opened, now_s
        described = read_description(file)
        self.description = described if port is None else replace(described, port=port)
        self._guards = ExitStack()
        self._plan: list[Move] = []
        angles = np.zeros(len(described.axes))
        try:
            self._table: Guarded | None = self._open()
            self._notes = self._table.notes
            if at_zero:
                self._table.stands_at_zero()
            if not home:
                self._table.require_angles()
                angles = self._table.where().angles
        except BaseException:
            self.close()
            raise
        self.moves = TableMoves(self.description, angles, HOLD_STILLS * Protocol().still_s)

    def confirmed(self, own: bool, segments: int, stop_at_target: bool, closure_s: float, yes: bool, quiet: bool = False) -> None:
        """Print the plan, have it confirmed, and search the reference marks where that was requested: it is part of the plan.

        CalibrationError where no one confirms it, or where the table can make no turn.

        own: whether the accelerometer is not calibrated.
        """
        turns, unseen = plan_of(self.moves, own, segments, stop_at_target)
        parameters = PARAMETERS + accelerometer.PARAMETERS * own
        shows_little = len(unseen) > (1 - LEAST_SHOWN) * parameters
        axes = enumerate(zip(self.description.axes, self.moves.limits, strict=True))
        self.moves.first = turns[0].moves
        if not (quiet and yes):
            lines = self._turns_lines(turns, unseen, segments, closure_s, parameters)
            of = [*self._notes, *([HOME] if self._home else []), *lines, MASTER, WAY_FREE]
            table = self.description
            plan = [f"plan of {table.name} ({table.make}): from here on it turns by itself", *(f"  {line}" for line in of)]
            print("\n".join(map(printable, plan)), file=sys.stderr, flush=True)
        for question in () if yes else ("turn? (yes)", *([SHOWS_LITTLE] if shows_little else [])):
            ask_person(question, UNCONFIRMED)
        self._plan = [Move(k, least, most, axis.fastest_rps) for k, (axis, (least, most)) in axes]
        if self._home and self._table is not None:
            self._table.confirm([Move.home()], None, lambda line: None)
            self._table.home()
            self.moves.angles = self._table.settle().angles

    def _turns_lines(self, plan: Sequence[Turn], unseen: Sequence[str], segments: int, closure_s: float, parameters: int) -> list[str]:
        """Axes with the largest angle and rate that will be used, likely turns, their time, and what they do not show."""
        lines = [
            _axis_line(axis, limits, self.moves.reach_rad(k))
            for k, (axis, limits) in enumerate(zip(self.description.axes, self.moves.limits, strict=True))
        ]
        closing = f", then a closure run of {closure_s:.0f} s" if closure_s else ""
        lines.append(f"{segments} turns at most; {len(plan)} in {in_words(sum(turn.cost_s for turn in plan))} if all goes well{closing}")
        turns = [f"{number} {', '.join(part.words for part in turn.parts)}" for number, turn in enumerate(plan, 1)]
        lines += _wrapped("likely turns:", turns)
        if unseen:
            # Names of parameters, those of one kind together: ``scale of x, y``
            kinds: dict[str, list[str]] = {}
            for name in unseen:
                kind, _, which = name.rpartition(" ")
                kinds.setdefault(kind, []).append(which)
            lines += _wrapped(
                f"no turn of this table shows {len(unseen)} of {parameters} parameters:",
                [f"{kind} {', '.join(which)}" for kind, which in kinds.items()],
            )
            lines.append("  set the sensor on another side and record once more, or use a table with one more axis")
        return lines

    def mover(self, folder: Path, guide: Guide) -> Mover:
        """The mover of a recording in a folder, which gets a copy of table.toml; a copy that was corrected since is put aside.

        FormatError where it is of another table.
        """
        copy = folder / description.NAME
        if require_table_of(self.file, folder):
            put_aside(copy)
        if not copy.exists():
            folder.mkdir(parents=True, exist_ok=True)
            copy_new(self.file, copy)
        table, self._table = self._table or self._open(), None
        table.confirm(self._plan, None, lambda line: None)  # it was shown by ``confirmed``
        self.moves.hold_s, self.moves.longest_s = guide.hold_s, LONGEST_TURN_SEGMENTS * guide.protocol.segment_s
        file, alone = AngleFile(folder / angles.NAME, self.description), self._now_s is None
        driver = TableDriver(table, file, self._now_s or time.monotonic, in_thread=alone)
        return TableMover(driver, self.moves)

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

    def _open(self) -> Guarded:
        return self._guards.enter_context(self._opened(self.description, self.file.parent))


def _axis_line(axis: Axis, limits: tuple[float, float], reach_rad: float) -> str:
    least, most = (limit / DEG for limit in limits)
    reach = f"; too slow for turns of more than {reach_rad / DEG:.0f} deg" if reach_rad < min(2 * np.pi, limits[1] - limits[0]) else ""
    endless = " (it has no limits; a cable may)" if axis.is_endless else ""
    rate = f"at most {axis.fastest_rps / DEG:g} dps, and {MOST_OF_SCALE:.0%} of the sensor's full scale{reach}"
    return f"{axis.name:8s} {least:.0f} to {most:.0f} deg{endless}, {rate}"


def _wrapped(begin: str, items: Sequence[str]) -> list[str]:
    """Lines of items, none of them torn apart."""
    text = f"{begin} {'; '.join(item.replace(' ', HARD_SPACE) for item in items)}"
    return [line.replace(HARD_SPACE, " ") for line in textwrap.wrap(text, LINE, subsequent_indent="  ")]


def is_raw(folder: Path, like: Path | None) -> bool:
    """Whether a recording will have to calibrate its accelerometer, as far as it is known before its first sample."""
    known = next((path for path in (folder / "session.toml", like) if path is not None and path.exists()), None)
    return known is None or read_config(known).accelerometer.source == "none"
