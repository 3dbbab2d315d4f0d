"""Names of files: which are a recording's own, which logs a session folder holds, and of which unit of an array each log is."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

from session.base.errors import FormatError, StorageError
from session.base.texts import command_line
from session.base.toml import read_toml

# Which files are a recording's own, so that no result is ever written over one.
#
# What was recorded cannot be made again; what a command derives can.  The rule is one of names, so that it also holds for a session that no
# argument names (docs/formats.md, session folder).

#: whose clock times the logs: the board's, which stamped them, or the computer's, by the ratio that the arrivals of the bytes gave
CLOCKS = ("board", "arrivals")
#: what makes a folder a session, or a recording that is just beginning
SIGNS = ("session.toml", "raw.bin", "raw.times")
#: the names of what a person or a port gave; a system that takes LOG0001.CSV for log0001.csv counts it as that
NAMES = re.compile(
    r"session\.toml|raw\.bin|raw\.times|attitudes\.csv|turns\.csv|table\.(toml|csv)|truth\.json|(log|closure|rest|rates|truth|unclosed|foreign).*\.csv(\.gz)?"
    r"|.+\.changed[0-9]+",
    re.IGNORECASE,
)


def has_recorded_name(path: Path) -> bool:
    """Whether a file of that name is a recording's own, if it lies in a session folder."""
    return NAMES.fullmatch(path.name) is not None


def is_session(folder: Path) -> bool:
    """Whether a folder holds a session, whole or just begun."""
    return any((folder / sign).exists() for sign in SIGNS)


def is_recorded(path: Path) -> bool:
    """Whether a path, as it stands, is a recording's own file that is there (a link counts as what it is called)."""
    return has_recorded_name(path) and os.path.lexists(path) and is_session(path.parent)


def refuse_recorded(path: Path) -> None:
    """StorageError where a result would take the place of a recording's own file."""
    if is_recorded(path):
        raise StorageError(f"{path}: is a file of the recording in {path.parent}, and no result is written over one; give another path")


def log_paths(folder: Path, stem: str) -> list[Path]:
    """``stem*.csv`` and ``stem*.csv.gz`` in name order; FormatError where both forms of one log are there."""
    paths = sorted([*folder.glob(f"{stem}*.csv"), *folder.glob(f"{stem}*.csv.gz")], key=lambda path: path.name)
    bare = [path.name.removesuffix(".gz") for path in paths]
    for name in bare:
        if bare.count(name) > 1:
            raise FormatError(f"{folder}: holds {name} and {name}.gz; keep one, or the log would count twice")
    return paths


# Whether a folder holds an array, and of which units: by the names of its logs, or by ``[array]`` in its session.toml.

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


def unit_numbers(paths: Iterable[Path]) -> tuple[int, ...]:
    """Numbers of the units that any of the logs names, increasing."""
    return tuple(sorted({unit[1] for unit in map(unit_of, paths) if unit is not None}))


def array_section(table: dict) -> dict | None:
    """``[array]`` of a parsed session.toml; None where it has none."""
    section = table.get("array")
    return section if isinstance(section, dict) else None


def is_array(folder: Path) -> bool:
    """Whether a folder holds several units that were recorded together; what cannot be read is none."""
    return array_size(folder) is not None


def array_size(folder: Path) -> int | None:
    """How many units the folder's names, or its session.toml, speak of; None of what is no array, or cannot be read."""
    named = [UNIT_LOG.fullmatch(path.name) for stem in ("log*.csv", "log*.csv.gz") for path in folder.glob(stem)]
    numbers = {found["number"] for found in named if found}
    try:
        section = array_section(read_toml(folder / "session.toml")) if (folder / "session.toml").exists() else None
    except (FormatError, OSError):  # who reads the folder says it
        section = None
    if section is None and not numbers:
        return None
    folders = (section or {}).get(FOLDERS)
    return len(folders) if isinstance(folders, list) else len(numbers)


def array_folders(folder: Path) -> list[str]:
    """What ``[array]`` lists as its units' folders, as it stands there; empty of an array whose logs name their units."""
    listed = (array_section(read_toml(folder / "session.toml")) or {}).get(FOLDERS, [])
    return [name for name in listed if isinstance(name, str)] if isinstance(listed, list) else []


def refuse_array(folder: Path) -> None:
    """FormatError where a folder that is to be read as one session is an array."""
    if (count := array_size(folder)) is not None:
        raise FormatError(
            f"{folder}: an array of {count} unit{'s' * (count != 1)} on one body, and no single session; "
            f"`{command_line('check', folder)}` and `{command_line('fit', folder)}` take it whole; "
            "to read one unit alone, give it a folder of its own"
        )


# Whether a folder is of a gyroscope alone, whose turns are known: by the reference in its session.toml.

#: ``protocol.reference`` of a gyroscope alone (``tinygc.features.turns``)
TURNS = "turns"


def is_of_turns(table: dict) -> bool:
    """Whether the reference of a parsed session.toml is turns of known angle."""
    protocol = table.get("protocol")
    return isinstance(protocol, dict) and protocol.get("reference") == TURNS


def is_gyroscope_alone(folder: Path) -> bool:
    """Whether that is the reference of a folder; what cannot be read is none."""
    try:
        return is_of_turns(read_toml(folder / "session.toml")) if (folder / "session.toml").exists() else False
    except (FormatError, OSError):  # who reads the folder says it
        return False
