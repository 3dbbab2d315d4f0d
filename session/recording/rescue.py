"""Files that are being written and have no name any more: noticed, and saved under another one.

Who removes, moves or replaces the folder of a recording that runs takes away the names; the open files still hold every byte.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

RESCUED = "_rescued"
BLOCK = 1 << 20
#: Windows would turn line ends into its own
BINARY = getattr(os, "O_BINARY", 0)


def is_gone(file: int, path: Path) -> bool:
    """Whether an open file cannot be found under its path any more.

    A file system that numbers files anew shows another number, but the same size; one that does not answer at the moment says nothing.
    """
    mine = os.fstat(file)
    try:
        there = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return True
    except OSError:
        return False
    same = (there.st_dev, there.st_ino) == (mine.st_dev, mine.st_ino)
    return not same and (mine.st_nlink == 0 or there.st_size != mine.st_size)


def new_folder(folder: Path) -> Iterator[Path]:
    """Make a folder for what was saved: beside the lost one, where we stand, or in the temporary folder; each that can be made."""
    name = folder.resolve().name
    for parent in dict.fromkeys((Path(os.path.abspath(folder)).parent, _here(), Path(tempfile.gettempdir()))):
        for number in range(1, 1000):
            place = parent / f"{name}{RESCUED}{'' if number == 1 else number}"
            try:
                place.mkdir(parents=True)
            except FileExistsError:
                continue
            except OSError:
                break
            yield place
            break


def _here() -> Path:
    try:
        return Path.cwd()
    except OSError:  # that was removed, too
        return Path(tempfile.gettempdir())


def copied(files: Sequence[int], paths: Sequence[Path]) -> list[int]:
    """Open files with the same bytes under those new names, to append to.  Raises OSError, and leaves then what it has copied."""
    made: list[int] = []
    try:
        for path in paths:
            made.append(os.open(path, os.O_RDWR | os.O_APPEND | os.O_CREAT | os.O_EXCL | BINARY, 0o644))
        for source, target in zip(files, made, strict=True):
            catch_up(source, target)
    except OSError:
        for file in made:
            os.close(file)
        raise
    return made


def discard(folder: Path, paths: Sequence[Path]) -> None:
    """Take away a copy that could not be made."""
    with contextlib.suppress(OSError):
        for path in paths:
            path.unlink(missing_ok=True)
        folder.rmdir()


def catch_up(source: int, target: int) -> None:
    """Append to a copy what its source holds beyond it.  Raises OSError."""
    os.lseek(source, os.fstat(target).st_size, os.SEEK_SET)  # appending does not mind where it stands
    while data := os.read(source, BLOCK):
        while data:
            data = data[os.write(target, data) :]
