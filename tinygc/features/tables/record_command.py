"""``table record``: a session that a machine turns, its plan confirmed once."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from session.base.options import option
from session.base.texts import printable
from tinygc.cli.commands.record import EPILOG as EPILOG
from tinygc.cli.commands.record import run as run
from tinygc.cli.recording import Turning


@dataclass(frozen=True)
class Options(Turning):
    """Options of ``table record``."""

    NAME = "table record"

    table: Path = option(Path("table.toml"), "its description (table.toml)")
    table_port: str | None = option(None, "instead of the port in its file", metavar="PORT")
    home: bool = option(False, "it searches its reference marks first, once the plan is confirmed")
    at_zero: bool = option(False, "all axes stand at zero, though its board has restarted")
    yes: bool = option(False, "the plan is confirmed, for those who know their table")

    @contextlib.contextmanager
    def machine(self, folder: Path, port: str) -> Iterator[Any]:
        """Yield the table, its plan confirmed; what can be refused is refused before its port is opened, since --home moves it."""
        from session.bench.port import Port
        from tinygc.features.tables.recording import TurnedRecording, is_raw, require_table_of

        if (words := require_table_of(self.table, folder)) and not self.quiet:
            print(printable(words), file=sys.stderr)
        Port(port, self.baud).close()  # DeviceError where there is no board
        machine = TurnedRecording(self.table, self.table_port, self.home, at_zero=self.at_zero)
        with contextlib.closing(machine):
            machine.confirmed(is_raw(folder, self.like), *self.plan, self.closure, self.yes, self.quiet)
            yield machine
