"""Pseudo-terminal for the virtual board: its name is stable, and writes never wait for the reader.  POSIX only."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import tempfile
import time
import tty
from pathlib import Path
from typing import IO

from session.base.errors import CalibrationError
from session.base.files import open_written
from session.bench.port import VIRTUAL_STEM, lock_of
from session.bench.rawfile import lock

#: bytes that a board with some memory can buffer while its host is busy
MEMORY_BYTES = 65_536
DRAIN_S = 0.3


class Terminal:
    """``name`` is a link to the present pseudo-terminal; ``plug`` creates it and ``unplug`` removes it.

    memory: bytes that can be buffered for the reader; dropped: count of writes that did not fit.
    Use as a context manager, which removes the link at its end.
    """

    def __init__(self, link: Path | None = None, memory: int = MEMORY_BYTES):
        usual = (Path(tempfile.gettempdir()) / f"{VIRTUAL_STEM}{number or ''}" for number in range(100))
        self.name, self._lock = _claim([link] if link else list(usual))
        self.dropped, self._memory = 0, memory
        self._master = -1
        self._waiting = b""

    def __enter__(self) -> Terminal:
        try:
            self.plug()
        except CalibrationError:
            self.let_go()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        deadline = time.monotonic() + DRAIN_S
        while self._waiting and self.write(b"") and time.monotonic() < deadline:
            time.sleep(0.01)
        if self.has_reader:
            time.sleep(DRAIN_S)  # closing a pseudo-terminal discards what its reader has not fetched
        self.unplug()
        self.let_go()

    def let_go(self) -> None:
        """Release the name; for use without ``plug`` or after ``unplug``."""
        lock_of(self.name).unlink(missing_ok=True)
        self._lock.close()

    def plug(self) -> None:
        """Create the port; CalibrationError if the link's path is occupied."""
        self._master, slave = pty.openpty()
        tty.setraw(slave)  # no echo, no line discipline
        os.set_blocking(self._master, False)
        try:
            if self.name.is_symlink() and os.readlink(self.name).startswith("/dev/"):
                self.name.unlink()  # left by a board that was killed: this process holds its lock
            self.name.symlink_to(os.ttyname(slave))
        except OSError as error:
            os.close(self._master)
            raise CalibrationError(f"{self.name}: {error.strerror or error}; give --link another path") from None
        finally:
            os.close(slave)  # from now on the master detects whether a reader is present

    def unplug(self) -> None:
        """Pull the cable: the reader gets an error, and the name is removed."""
        if self._master >= 0:
            with contextlib.suppress(OSError):
                self.name.unlink()
            os.close(self._master)
            self._master, self._waiting = -1, b""

    @property
    def has_reader(self) -> bool:
        """Whether a process has the port open."""
        if self._master < 0:
            return False
        poll = select.poll()
        poll.register(self._master, 0)
        return not any(events & (select.POLLHUP | select.POLLERR) for _, events in poll.poll(0))

    def write(self, data: bytes) -> bool:
        """Send data, and buffer what does not fit.  False: ``data`` was dropped, since the buffer is full or there is no reader."""
        if not self.has_reader:
            self._waiting = b""
            return False
        fits = len(self._waiting) + len(data) <= self._memory
        self._waiting += data if fits else b""
        self.dropped += not fits
        with contextlib.suppress(OSError):
            while self._waiting:
                self._waiting = self._waiting[os.write(self._master, self._waiting) :]
        return fits

    def read(self) -> bytes:
        """Bytes that the reader has sent since the last call."""
        data = b""
        with contextlib.suppress(OSError):  # no data, or no reader
            while self._master >= 0 and (part := os.read(self._master, 4096)):
                data += part
        return data


def _claim(names: list[Path]) -> tuple[Path, IO]:
    """Claim the first name that no running board holds; returns it with its lock, which the system releases at the end of the process."""
    for name in names:
        try:
            file = os.fdopen(open_written(lock_of(name), os.O_WRONLY | os.O_APPEND | os.O_CREAT), "a")
        except OSError as error:
            raise CalibrationError(f"{name}: {error.strerror or error}; give --link another path") from None
        if os.fstat(file.fileno()).st_size:  # a board's lock file is empty
            file.close()
            raise CalibrationError(f"{lock_of(name)}: is no lock of a virtual board; give --link another path")
        if lock(file.fileno()):
            return name, file
        file.close()
    raise CalibrationError(f"{names[0]}: another virtual board runs there; give --link another path")
