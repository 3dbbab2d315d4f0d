"""Which folders are sessions, found one after the other as they are asked for: a hundred thousand of them are never held at once."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from session.common.errors import CalibrationError

CONFIG = "session.toml"
#: some systems name files in capitals, and may put a line end into a name
LOG = re.compile(r"log.*\.csv(\.gz)?", re.IGNORECASE | re.DOTALL)


def session_folders(places: Iterable[Path]) -> Iterator[Path]:
    """Every session folder in these, by name, at any depth; a session's own folders are not looked into.

    A folder that holds a log and no session.toml is one, too: it fails with its line instead of being passed over, and what is in it is
    found besides, since the log may be somebody's notes.  Folders whose names begin with a dot are passed over, and so is what lies behind
    a link, unless that is a session itself.  CalibrationError for a place that is not there.
    """
    for place in places:
        if not place.is_dir():
            hint = "that is a file; --from FILE reads a list of folders" if place.exists() else "not found"
            raise CalibrationError(f"{place}: {hint}; give a folder with session folders in it")
        yield from _inside(os.fspath(place))


def _inside(folder: str) -> Iterator[Path]:
    try:
        with os.scandir(folder) as found:
            entries = [(entry.name, _is_folder(entry), entry.is_symlink()) for entry in found]
    except OSError:  # what nobody may look into is no session that anybody could read; those beside it are found
        return
    names = [name for name, is_folder, _ in entries if not is_folder]
    if CONFIG in names or any(map(LOG.fullmatch, names)):
        yield Path(folder)
    if CONFIG in names:
        return
    for name, is_folder, is_link in sorted(entries):
        inside = os.path.join(folder, name)
        if not is_folder or name.startswith("."):
            continue
        if not is_link:
            yield from _inside(inside)
        elif os.path.exists(os.path.join(inside, CONFIG)):
            yield Path(inside)


def _is_folder(entry: os.DirEntry) -> bool:
    """A link that leads to itself, or where nobody may look, is none, and no reason to pass over what lies beside it."""
    try:
        return entry.is_dir()
    except OSError:
        return False


def listed_folders(lines: Iterable[str]) -> Iterator[Path]:
    """Those of a list, one a line, as they stand; blank lines are passed over.  One that is not there fails with its line."""
    for line in lines:
        if name := line.rstrip("\r\n"):
            yield Path(name)
