"""The rows of a session folder's small tables: dial readings, known turns, truth files.  Read a line at a time, however long they are."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from session.dialects.lines import Lines


def rows_of(path: Path) -> Iterator[tuple[int, str]]:
    """The number of each line that is neither blank nor a comment, and the line, plain or gzipped, whatever its line ends.

    FormatError for what cannot be read: no file, no UTF-8, packed and broken off, or beyond any table (``session/dialects/lines.py``).
    """
    before = 0
    with Lines(path, strict=True) as file:
        while lines := file.take():
            for number, line in enumerate(lines, start=before + 1):
                if line.strip() and not line.startswith("#"):
                    yield number, line
            before += len(lines)
