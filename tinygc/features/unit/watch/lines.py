"""JSON lines of the events: each is written at once; what cannot be written is kept, and tried again with the next."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from collections import deque
from io import FileIO
from pathlib import Path

from session.base.errors import StorageError
from session.base.files import open_written
from session.base.progress import Told
from session.base.records import json_line

#: lines that are kept while they cannot be written
MOST_KEPT = 10_000


class JsonLines:
    """path: a file that is begun anew, or None for standard output; say: one line when writing fails, and when it works again.

    Raises StorageError for a file that cannot be opened.
    """

    def __init__(self, path: Path | None, say: Told):
        self._path, self._say = path, say
        self._waiting: deque[bytes] = deque(maxlen=MOST_KEPT)
        self._whole = 0  # bytes of whole lines in the file
        self._lost, self._failed = 0, False
        self._file: FileIO | None = None
        if path is not None:
            try:
                self._file = os.fdopen(open_written(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), "wb", buffering=0)
            except OSError as error:
                raise StorageError(f"{path}: cannot be written ({error.strerror}); give --json another path") from None

    def write(self, table: dict) -> None:
        """Write a line, or keep it."""
        line = json_line(table)
        if self._path is None:
            sys.stdout.write(line + "\n")
            sys.stdout.flush()
            return
        self._lost += len(self._waiting) == MOST_KEPT
        self._waiting.append(f"{line}\n".encode())
        self._try()

    def _try(self) -> None:
        assert self._path is not None
        try:
            file = self._file = self._file or os.fdopen(open_written(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND), "ab", buffering=0)
            while self._waiting:
                line = self._waiting[0]
                if file.write(line) != len(line):
                    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
                self._whole += len(line)
                self._waiting.popleft()
        except OSError as error:
            self._close()
            if not self._failed:
                self._say(f"{self._path}: {error.strerror or error}; its lines are kept, and written as soon as they can be")
            self._failed = True
        else:
            if self._failed:
                self._say(f"{self._path}: can be written again; {self._lost} lines were lost")
            self._failed = False

    def _close(self) -> None:
        """Close the file without the part of a line that did not fit."""
        file, self._file = self._file, None
        if file is not None:
            with contextlib.suppress(OSError):
                os.ftruncate(file.fileno(), self._whole)
            with contextlib.suppress(OSError):
                file.close()

    def end(self) -> None:
        """Write what is left.  Raises StorageError where that still fails."""
        if self._path is None:
            return
        if self._waiting:
            self._try()
        left = len(self._waiting) + self._lost
        self._close()
        if left:
            raise StorageError(f"{self._path}: {left} lines could not be written; free space there, or give --json another path")
