"""Writing results: a failure names what was to be written, and leaves no empty folder behind."""

from __future__ import annotations

import contextlib
import errno
from collections.abc import Iterator
from pathlib import Path

from session.common.errors import StorageError

FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))


@contextlib.contextmanager
def naming(path: Path, *aliases: Path) -> Iterator[None]:
    """Give a failure to write the name of the result, which it lacks, or which it says by an alias or by that of a file it copies.

    Raises StorageError for a full disk, else the OSError with that name.
    """
    try:
        yield
    except OSError as error:
        if error.errno in FULL:
            raise StorageError(f"{path}: {error.strerror}; free space there, or choose another folder") from None
        if error.filename is None or str(error.filename) in map(str, aliases):
            error.filename = str(path)
        raise


@contextlib.contextmanager
def result_folder(folder: Path) -> Iterator[None]:
    """Make a folder for the block to write into; where it fails, take away again what was made here and is empty."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        with naming(folder):
            folder.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException:
        for path in missing:
            with contextlib.suppress(OSError):
                path.rmdir()
        raise
