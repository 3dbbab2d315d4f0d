"""Which files are a recording's own, so that no result is ever written over one.

What was recorded cannot be made again; what a command derives can.  The rule is one of names, so that it also holds for a session that no
argument names (docs/formats.md, session folder).
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from session.common.errors import StorageError

#: what makes a folder a session, or a recording that is just beginning
SIGNS = ("session.toml", "raw.bin", "raw.times")
#: the names of what a person or a port gave; a system that takes LOG0001.CSV for log0001.csv counts it as that
NAMES = re.compile(
    r"session\.toml|raw\.bin|raw\.times|attitudes\.csv|turns\.csv|truth\.json|(log|closure|rest|truth|unclosed|foreign).*\.csv(\.gz)?"
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
