"""Recordings of several units on one rigid body: ``fit``, ``explain``, ``apply``, ``check``, ``import`` and ``simulate`` of an array."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from session.base.errors import FormatError
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
    mounting_deg: float = option(
        2.0, "about each axis, from the first unit's axes to another's", unit="deg", least=0, most=30, group=GROUP, rare=True
    )
    position_mm: float = option(
        20.0, "along each axis, from the first unit to another", unit="mm", least=0, most=1000, group=GROUP, cli=False, rare=True
    )
    clock_offset_ms: float = option(
        20.0, "another unit's clock against the first one's", unit="ms", least=0, most=10000, group=GROUP, cli=False, rare=True
    )
    clock_rate: float = option(0.002, "fraction, another unit's clock against the first one's", least=0, most=0.05, group=GROUP, cli=False)
    synchronous: bool = option(False, "one reader takes all units at one moment, by one clock", group=GROUP, rare=True)
    jerk_deg: float = option(
        0.0,
        "jerks quicker than half the data rate, three a turn, felt by all; 0: none",
        unit="deg",
        least=0,
        most=10,
        group=GROUP,
        cli=False,
        rare=True,
    )
    knock_deg: float = option(
        0.0, "of one knock in the middle turn, felt by all; 0: none", unit="deg", least=0, most=10, group=GROUP, cli=False, rare=True
    )
    false_reading_dps: float = option(
        0.0,
        "of three readings in a row of the last unit in the second turn; 0: none",
        unit="dps",
        least=0,
        most=2000,
        group=GROUP,
        cli=False,
        rare=True,
    )
    reference_error_mg: float = option(
        0.0, "a level acceleration in each still, felt by all; 0: none", unit="mg", least=0, most=100, group=GROUP, cli=False, rare=True
    )


@dataclass(frozen=True)
class ImportOptions(Record):
    """Options of ``import``."""

    array_by: str | None = option(None, "of several sensors' rows: an array, of each value in this column a unit", rare=True)


@dataclass(frozen=True)
class ApplyOptions(Record):
    """Options of ``apply``."""

    which: str | None = option(None, "of an array's folder with several logs: log0002", metavar="LOG", rare=True)


# What is an array: a folder by the names of its logs, or by ``[array]`` in its session.toml.

#: schema of an array's model
SCHEMA = "tinygc-array-model/1"
#: log0001.unit3.csv: what it is, which, and of which unit
UNIT_LOG = re.compile(r"(?P<which>(?:log|closure|rest).*)\.unit(?P<number>[0-9]+)\.csv(?:\.gz)?", re.DOTALL)
#: far beyond any board
LARGEST_NUMBER = 9999
#: what a section [array] may hold
FOLDERS, UNIT = "folders", "unit"


def unit_of(path: Path) -> tuple[str, int] | None:
    """``log0001`` and 3 of ``log0001.unit3.csv``, packed or not; None of a log that names no unit.  FormatError for a number like 007."""
    found = UNIT_LOG.fullmatch(path.name)
    if found is None:
        return None
    number = int(found["number"]) if len(found["number"]) <= len(str(LARGEST_NUMBER)) else LARGEST_NUMBER + 1
    if str(number) != found["number"] or number > LARGEST_NUMBER:
        raise FormatError(f"{path}: expected a unit's number from 0 to {LARGEST_NUMBER} without leading zeros, as in log0001.unit3.csv")
    return found["which"], number


def array_section(table: dict) -> dict | None:
    """``[array]`` of a parsed session.toml; None where it has none."""
    section = table.get("array")
    return section if isinstance(section, dict) else None


def is_array(folder: Path) -> bool:
    """Whether a folder holds several units that were recorded together; what cannot be read is none."""
    return array_size(folder) is not None


def array_size(folder: Path) -> int | None:
    """How many units the folder's names, or its session.toml, speak of; None of what is no array, or cannot be read."""
    from session.base.toml import read_toml

    named = [UNIT_LOG.fullmatch(path.name) for stem in ("log*.csv", "log*.csv.gz") for path in folder.glob(stem)]
    numbers = {found["number"] for found in named if found}
    try:
        section = array_section(read_toml(folder / "session.toml")) if (folder / "session.toml").exists() else None
    except (FormatError, OSError):  # the reader of the folder reports it
        section = None
    if section is None and not numbers:
        return None
    folders = (section or {}).get(FOLDERS)
    return len(folders) if isinstance(folders, list) else len(numbers)


def array_folders(folder: Path) -> list[str]:
    """What ``[array]`` lists as its units' folders, as it stands there; empty of an array whose logs name their units."""
    from session.base.toml import read_toml

    listed = (array_section(read_toml(folder / "session.toml")) or {}).get(FOLDERS, [])
    return [name for name in listed if isinstance(name, str)] if isinstance(listed, list) else []


FEATURE = Feature(
    public={"array": "library", "Array": "library", "ArraySession": "recording"},
    serves={
        "kind of folder": "points:kind_of_folder",
        "line of a list": "points:listed",
        "options of simulate": "feature:ArrayOptions",
        "options of import": "feature:ImportOptions",
        "options of apply": "feature:ApplyOptions",
        "simulation": "points:simulate",
        "fit of a folder": "points:fit",
        "explanation of a folder": "points:explain",
        "check of a recording": "points:check",
        "use of a model": "points:apply",
        "import of logs": "points:import_logs",
    },
)
