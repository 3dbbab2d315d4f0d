"""Machines that turn the table: makes, limits, sessions that they turn, rates from files, and the table's own errors."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from session.base.errors import FormatError
from session.base.features import Feature
from session.base.options import Record, file_written, option

GROUP = "a virtual table under it"
COLUMNS = "a CSV whose header does not name its columns"


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
    link: Path | None = option(None, "name of the table's port", metavar="PATH", read=file_written, group=GROUP, rare=True)
    faults: str = option(
        "", "what goes wrong with the table (docs/features/tables/tables.md)", metavar="NAME@S", read=str, group=GROUP, rare=True
    )
    resets: bool = option(False, "the table restarts when its port is opened, as an Arduino Uno does", group=GROUP, rare=True)


@dataclass(frozen=True)
class Columns(Record):
    """Options of ``rates``: what a person knows of a CSV."""

    rate_column: str = option("", "the column of the table's rate", read=str, group=COLUMNS)
    output_column: str = option("", "the column of the sensor's mean output", read=str, group=COLUMNS)
    unit: str = option("", "unit of the output: V, mV, LSB, dps", metavar="UNIT", read=str, group=COLUMNS, flags=("--output-unit",))
    readings: int | None = option(None, "readings behind each mean, if the CSV has their std", least=2, group=COLUMNS)


def explained(explanation: Any, seed: int) -> Any:
    """Explain the table's own errors; None where no machine turned what was recorded, or its files cannot be read, which is a warning."""
    folder = explanation.session.folder
    if explanation.session.in_memory or not all((folder / name).exists() for name in ("table.csv", "table.toml")):
        return None
    from session.detect.findings import Finding
    from tinygc.features.tables.explanation import explain_table

    try:
        return explain_table(explanation.problem, seed)
    except FormatError as error:  # the session is explained, and its report written, all the same
        do = "correct it, and explain again: the table's own errors were not looked for"
        explanation.warnings.append(Finding("warning", folder.name, "table", str(error), do))
        return None


FEATURE = Feature(
    commands={
        "table": ("command", "a table with motors: describe it, home it, turn it", "lab"),
        "table record": ("record_command", "record a session that a table turns", "lab"),
        "rates": ("rates.command", "scale and linearity of a sensor from rate steps", "lab"),
    },
    public={"estimate_rates": "rates.library"},
    serves={
        "options of board": "feature:TableOptions",
        "table under a virtual board": "board:table_under",
        "explanation of what turned": "feature:explained",
    },
)
