"""A disk that is full, for what a recorder writes: the soak's, and a test's."""

from __future__ import annotations

import errno
import os


class FullDisk:
    """``os``, with a disk on which the raw file may grow by ``room`` bytes."""

    def __init__(self, room: int):
        self.room = room

    def __getattr__(self, name: str) -> object:
        return getattr(os, name)

    def write(self, file: int, data: bytes) -> int:
        """As ``os.write``, while there is room."""
        if not self.room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        written = os.write(file, data[: self.room])
        self.room -= written
        return written
