"""Options that machines add to commands of the core, and those of ``rates``.  Imports nothing heavy."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from session.base.options import Record, file_written, option

COLUMNS = "a CSV whose header does not say it"
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
    faults: str = option("", "what goes wrong with the table (docs/features/tables/tables.md)", metavar="NAME@S,…", read=str, group=GROUP)
    resets: bool = option(False, "the table restarts when its port is opened, as an Arduino Uno does", group=GROUP)


@dataclass(frozen=True)
class Columns(Record):
    """What a person says of a CSV."""

    rate_column: str = option("", "the column of the table's rate", read=str, group=COLUMNS)
    output_column: str = option("", "the column of the sensor's mean output", read=str, group=COLUMNS)
    unit: str = option("", "unit of the output: V, mV, LSB, dps", metavar="UNIT", read=str, group=COLUMNS, flags=("--output-unit",))
    readings: int | None = option(None, "readings behind each mean, if the CSV has their std", least=2, group=COLUMNS)
