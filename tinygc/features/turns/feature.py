"""A gyroscope alone, by turns of known angle."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from session.base.features import Feature
from session.base.options import Record, option

#: ``protocol.reference`` of a gyroscope alone
TURNS = "turns"


class KnownAngles:
    """The turns' own angles as the reference, of logs without specific force."""

    word: ClassVar[str] = TURNS
    accelerometer: ClassVar[bool] = False


# Options that a gyroscope alone adds to commands of the core.


@dataclass(frozen=True)
class ImportOptions(Record):
    """Options of ``import``."""

    turns: Path | None = option(None, "of a gyroscope alone: turns.csv, the known angles of its turns")


FEATURE = Feature(
    public={"fit_turns": "library", "TurnFit": "result"},
    serves={
        "kind of folder": "points:kind_of_folder",
        "reference": "feature:KnownAngles",
        "fit of a folder": "points:fit",
        "options of import": "feature:ImportOptions",
        "import of logs": "points:import_logs",
    },
)
