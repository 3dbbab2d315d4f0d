"""``table record``: a session that a machine turns, its plan confirmed once."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from session.base.options import Record, option
from session.base.texts import printable
from tinygc.cli.commands.record import EPILOG as EPILOG
from tinygc.cli.commands.record import run as run
from tinygc.cli.recording import Turning

if TYPE_CHECKING:
    from tinygc.features.tables.recording import TurnedRecording


@dataclass(frozen=True)
class Machine(Record):
    """Options of the machine."""

    table: Path = option(Path("table.toml"), "its description (table.toml)")
    table_port: str | None = option(None, "instead of the port in its file", metavar="PORT")
    home: bool = option(False, "it searches its reference marks first, once the plan is confirmed")
    at_zero: bool = option(False, "all axes stand at zero, though its board has restarted")
    yes: bool = option(False, "the plan is confirmed, for those who know their table")


@contextlib.contextmanager
def opened(options: Any, folder: Path, port: str) -> Iterator[TurnedRecording]:
    """Yield the table of options of ``Machine`` and ``Recording``; what can be refused without it is refused before its port is opened,
    since --home moves it."""
    from session.bench.port import Port
    from tinygc.features.tables.recording import TurnedRecording, require_table_of

    if (words := require_table_of(options.table, folder)) and not options.quiet:
        print(printable(words), file=sys.stderr)
    Port(port, options.baud).close()  # DeviceError where there is no board
    found = TurnedRecording(options.table, options.table_port, options.home, at_zero=options.at_zero)
    try:
        yield found
    finally:
        found.close()


@dataclass(frozen=True)
class Options(Turning, Machine):
    """Options of ``table record``."""

    NAME = "table record"

    @contextlib.contextmanager
    def machine(self, folder: Path, port: str) -> Iterator[Any]:
        """Yield the table, its plan confirmed."""
        from tinygc.features.tables.recording import is_raw

        with opened(self, folder, port) as machine:
            machine.confirmed(is_raw(folder, self.like), *self.plan, self.closure, self.yes, self.quiet)
            yield machine
