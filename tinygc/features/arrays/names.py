"""Whether a folder holds an array, and of which units: by the names of its logs, or by ``[array]`` in its session.toml."""

from __future__ import annotations

import re
from pathlib import Path

from session.base.errors import FormatError
from session.base.results import read_json
from session.base.toml import read_toml

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


def is_array_model(path: Path) -> bool:
    """Whether a file is an array's model, by its schema; False if it cannot be read."""
    try:
        table = read_json(path) if path.is_file() else None
    except (FormatError, OSError):
        return False
    return isinstance(table, dict) and table.get("schema") == SCHEMA
