"""Options that machines add to commands of the core.  Imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import Record, file_written, option

GROUP = "a virtual table under it"


@dataclass(frozen=True)
class TableOptions(Record):
    """Options of ``board``: the virtual table that turns it."""

    PREFIX = "table-"

    file: Path | None = option(
        None,
        "it lies on the virtual table of this table.toml, which has a port of its own, and turns with it",
        flags=("--table",),
        group=GROUP,
    )
    link: Path | None = option(None, "name of the table's port", metavar="PATH", read=file_written, group=GROUP)
    faults: str = option("", "what goes wrong with the table (docs/tables.md)", metavar="NAME@S,…", read=str, group=GROUP)
    resets: bool = option(False, "the table restarts when its port is opened, as an Arduino Uno does", group=GROUP)
