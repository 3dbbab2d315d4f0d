"""Recordings of several units on one rigid body: ``fit``, ``explain``, ``apply``, ``check``, ``import`` and ``simulate`` of an array."""

from __future__ import annotations

from dataclasses import dataclass

from session.base.features import Feature
from session.base.options import Record, option

# Options that an array adds to commands of the core.

GROUP = "an array, with --units"
#: of one array
MOST_UNITS = 64


@dataclass(frozen=True)
class ArrayOptions(Record):
    """Several units on one body.  Extrinsics and clocks are drawn with the sizes given here (1 sigma), from the session's seed."""

    units: int = option(
        1,
        "on one rigid body, each with errors, place, clock and noise of its own; 2 or more make an array",
        least=1,
        most=MOST_UNITS,
        group=GROUP,
    )
    mounting_deg: float = option(2.0, "about each axis, from the first unit's axes to another's", unit="deg", least=0, most=30, group=GROUP)
    position_mm: float = option(
        20.0, "along each axis, from the first unit to another", unit="mm", least=0, most=1000, group=GROUP, cli=False
    )
    clock_offset_ms: float = option(
        20.0, "another unit's clock against the first one's", unit="ms", least=0, most=10000, group=GROUP, cli=False
    )
    clock_rate: float = option(0.002, "fraction, another unit's clock against the first one's", least=0, most=0.05, group=GROUP, cli=False)
    synchronous: bool = option(False, "one reader takes all units at one moment, by one clock", group=GROUP)
    jerk_deg: float = option(
        0.0,
        "jerks quicker than half the data rate, three a turn, felt by all; 0: none",
        unit="deg",
        least=0,
        most=10,
        group=GROUP,
        cli=False,
    )
    knock_deg: float = option(
        0.0, "of one knock in the middle turn, felt by all; 0: none", unit="deg", least=0, most=10, group=GROUP, cli=False
    )
    false_reading_dps: float = option(
        0.0,
        "of three readings in a row of the last unit in the second turn; 0: none",
        unit="dps",
        least=0,
        most=2000,
        group=GROUP,
        cli=False,
    )
    reference_error_mg: float = option(
        0.0, "a level acceleration in each still, felt by all; 0: none", unit="mg", least=0, most=100, group=GROUP, cli=False
    )


@dataclass(frozen=True)
class ImportOptions(Record):
    """Options of ``import``."""

    array_by: str | None = option(None, "of several sensors' rows: an array, of each value in this column a unit")


@dataclass(frozen=True)
class ApplyOptions(Record):
    """Options of ``apply``."""

    which: str | None = option(None, "of an array's folder with several logs: log0002", metavar="LOG")


FEATURE = Feature(
    public={"array": "library", "Array": "library", "ArraySession": "recording"},
    serves={
        "kind of folder": "points:kind_of_folder",
        "line of a list": "points:listed",
        "options of simulate": "feature:ArrayOptions",
        "options of import": "feature:ImportOptions",
        "options of apply": "feature:ApplyOptions",
        "simulation": "command:simulate",
        "fit of a folder": "command:fit",
        "explanation of a folder": "command:explain",
        "check of a recording": "points:check",
        "use of a model": "points:apply",
        "import of logs": "points:import_logs",
    },
)
