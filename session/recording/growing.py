"""A log that only grows: what it holds already is never written again.

After Ctrl-C or a crash the logs are made again from the raw bytes, and somebody may have fitted them meanwhile.  So what is there is
compared with what would be written, and only what lies behind it is added; a log that somebody has changed is kept under another name.
"""

from __future__ import annotations

import errno
import os
from pathlib import Path

ASIDE = ".changed"


class GrowingFile:
    """Write to it as to a new file, or behind what it holds.  aside: where a file went whose beginning was another one, or None.
    Raises OSError."""

    def __init__(self, path: Path, behind: bool = False):
        self.path = path
        self.aside: Path | None = None
        self._same = 0  # bytes of the old file that were found again
        if path.is_fifo():  # opening it would wait for its reader
            raise FileExistsError(errno.EEXIST, f"{path.name} is a named pipe", str(path))
        self._left = path.stat().st_size if path.is_file() else 0
        self._file = path.open("r+b" if self._left else "wb")
        if behind:
            self._left, self._same = 0, self._file.seek(0, os.SEEK_END)

    def write(self, text: str) -> None:
        """Add text, or find it there already."""
        data = text.encode()
        if self._left:
            there = self._file.read(min(len(data), self._left))
            if there != data[: len(there)]:
                self._put_aside()
            else:
                self._same, self._left, data = self._same + len(there), self._left - len(there), data[len(there) :]
        if data:
            self._file.write(data)

    def flush(self) -> None:
        """Hand what is buffered to the operating system."""
        self._file.flush()

    def close(self) -> None:
        """End it."""
        self._file.close()

    def _put_aside(self) -> None:
        """Go on in a new file that begins as far as the old one did right."""
        self._file.seek(0)
        right, self._left = self._file.read(self._same), 0
        self._file.close()
        self.aside = put_aside(self.path)
        self._file = self.path.open("xb")
        self._file.write(right)


def put_aside(path: Path) -> Path | None:
    """Give a file that is in the way another name, and return it; None where there is none.  Raises OSError."""
    if not path.exists():
        return None
    number = 1
    while (aside := path.with_name(f"{path.name}{ASIDE}{number}")).exists():
        number += 1
    return path.rename(aside)
