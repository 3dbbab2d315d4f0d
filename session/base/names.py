"""Names of files: which are a recording's own, which logs a session folder holds, and which folder is no session."""

from __future__ import annotations

import os
import re
from pathlib import Path

from session.base import features
from session.base.errors import FormatError, StorageError

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
    r"session\.toml|raw\.bin|raw\.times|attitudes\.csv|turns\.csv|table\.(toml|csv)|truth\.json|(log|closure|rest|rates|truth|unclosed).*\.csv(\.gz)?"
    r"|.+\.changed[0-9]+",
    re.IGNORECASE,
)


def has_recorded_name(path: Path) -> bool:
    """Whether a file of that name is a recording's own, if it lies in a session folder."""
    return NAMES.fullmatch(path.name) is not None


def is_session(folder: Path) -> bool:
    """Whether a folder holds a session, whole or just begun."""
    return any((folder / sign).exists() for sign in SIGNS)


def refuse_recorded(path: Path) -> None:
    """StorageError where a result would take the place of a recording's own file that is there (a link counts as what it is called)."""
    if has_recorded_name(path) and os.path.lexists(path) and is_session(path.parent):
        raise StorageError(f"{path}: is a file of the recording in {path.parent}, and no result is written over one; give another path")


def log_paths(folder: Path, stem: str) -> list[Path]:
    """``stem*.csv`` and ``stem*.csv.gz`` in name order; FormatError where both forms of one log are there."""
    paths = sorted([*folder.glob(f"{stem}*.csv"), *folder.glob(f"{stem}*.csv.gz")], key=lambda path: path.name)
    bare = [path.name.removesuffix(".gz") for path in paths]
    for name in bare:
        if bare.count(name) > 1:
            raise FormatError(f"{folder}: holds {name} and {name}.gz; keep one, or the log would count twice")
    return paths


# Folders that are no session of one sensor: a feature takes them for something else.

#: a log of one unit among several, ``log0001.unit3.csv``
PART = re.compile(r"log[^.]*\.unit[0-9]+\.csv(\.gz)?")


def is_special(folder: Path) -> bool:
    """Whether a feature takes a folder for something else than a session of one sensor; what cannot be read is nothing else."""
    return features.first("kind of folder", folder) is not None


def refuse_special(folder: Path) -> None:
    """FormatError where a folder that is to be read as one session is something else."""
    if (what := features.first("kind of folder", folder)) is not None:
        raise FormatError(f"{folder}: {what}")
    if parts := sorted(path.name for path in folder.glob("log*.csv*") if PART.fullmatch(path.name)):
        raise FormatError(f"{folder}: {parts[0]} is one unit's log of several, which no feature that is installed reads")
