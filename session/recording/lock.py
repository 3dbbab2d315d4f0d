"""Locks of files, which the system takes away with the process that holds them, however it ends."""

from __future__ import annotations

import errno
import os
import sys
from pathlib import Path

if sys.platform == "win32":
    import msvcrt
else:
    try:
        import fcntl
    except ImportError:  # a POSIX system without it: nobody can be told to wait
        fcntl = None  # type: ignore[assignment]  # a module or none

#: what a system says of a file that somebody else has locked; anything else is a file system without locks
TAKEN = (errno.EAGAIN, errno.EACCES, errno.EDEADLK)
#: Windows locks bytes, and nobody else may then read them: one that no recording reaches
BEYOND = 1 << 62


def lock(file: int, shared: bool = False) -> bool:
    """Lock an open file until it is closed; False where another holder has it.  A file system without locks says nothing of others.

    shared: with others who ask so, as who only wants to know does; Windows knows no such thing.
    """
    try:
        if sys.platform == "win32":
            os.lseek(file, BEYOND, os.SEEK_SET)
            msvcrt.locking(file, msvcrt.LK_NBLCK, 1)
        elif fcntl is not None:
            fcntl.flock(file, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)
    except OSError as error:
        return error.errno not in TAKEN
    return True


def is_locked(path: Path) -> bool:
    """Whether somebody holds the lock of a file; False for one that is not there."""
    try:
        file = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    except OSError:
        return False
    try:
        return not lock(file, shared=True)
    finally:
        os.close(file)
