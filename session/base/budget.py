"""One budget of memory for what is read of logs, kept before anything is allocated.

A file of some kB may state numbers that were never stored, or unpack to a thousand times its length.  A reader states here what it
is about to hold or to unpack, and is stopped where that is more than the budget: 1 GB, or more for files that take as much on the disk.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from math import ceil
from pathlib import Path

from session.base.errors import FormatError

MB, GB = 10**6, 10**9
LEAST = GB
#: what an honest log needs, in bytes on the disk; the most that was measured is 17.6, of a bag at rest (docs/binary-logs.md#memory)
PACKED = 20
#: what numbers count as, in their own size of 8 bytes each; what they took was measured (docs/binary-logs.md#memory)
TIMES = 2.5
#: bytes of a record that are as much work as unpacking so many
RECORD = 256


class Budget:
    """Bytes that reading some files may take.  most: ``LEAST``, or ``PACKED`` times what they take on the disk; or as the user has set it.

    held: what is taken.  All methods raise FormatError beyond the budget, with the option that raises it.
    """

    def __init__(self, paths: Sequence[Path] = (), most: int | None = None) -> None:
        unpacks = PACKED * sum(map(stored, paths))
        self.most = max(LEAST, unpacks) if most is None else most
        #: what may be read and unpacked in all, and given up again
        self.unpackable = max(self.most, unpacks)
        self.held = self._unpacked = 0

    @property
    def piece(self) -> int:
        """The most that one chunk may unpack to: next to it are its packed bytes, and a copy."""
        return (self.most - self.held) // 3

    def need(self, path: Path, size: int) -> None:
        """State that so many bytes will be held for a moment."""
        if self.held + size > self.most:
            raise FormatError(
                f"{path}: reading it takes more than {amount(self.held + size)} of memory, and {amount(self.most)} may be taken; "
                f"is it the right file? if it is: import --most-memory {_wanted(self.held + size)}"
            )

    def take(self, path: Path, size: int) -> None:
        """State that so many bytes will be held until the end."""
        self.need(path, size)
        self.held += size

    def numbers(self, path: Path, count: int) -> None:
        """State that so many numbers will be read and converted."""
        self.take(path, int(count * 8 * TIMES))

    def unpack(self, path: Path, size: int) -> None:
        """State that so many bytes will be read or unpacked, and given up again: it is their time that is bounded."""
        if self.spends(size):
            raise FormatError(
                f"{path}: unpacks to more than {amount(self.unpackable)}; is it the right file? if it is: "
                f"import --most-memory {_wanted(self._unpacked)}"
            )

    def spends(self, size: int) -> bool:
        """``unpack``, for who cannot raise: whether it is too much."""
        self._unpacked += size
        return self._unpacked > self.unpackable

    @contextmanager
    def again(self) -> Iterator[None]:
        """What the block takes is given up behind it."""
        held = self.held
        yield
        self.held, self._unpacked = held, 0


def amount(size: int) -> str:
    """``1.5 GB``."""
    return f"{size / GB:.3g} GB" if size >= GB else f"{size / MB:.3g} MB"


def _wanted(size: int) -> str:
    """As ``--most-memory`` takes it; what is held for a moment later comes on top."""
    unit, name = (GB, "GB") if 1.5 * size >= GB else (MB, "MB")
    return f"{ceil(15 * size / unit) / 10:.1f}{name}"


def stored(path: Path) -> int:
    """Bytes that a file, or the files of a folder, take on the disk: of a sparse file its holes take none."""
    with suppress(OSError, ValueError):
        if path.is_dir():
            return sum(stored(each) for each in path.iterdir() if each.is_file())
        status = os.stat(path)
        return min(status.st_size, 512 * getattr(status, "st_blocks", status.st_size))
    return 0


_CURRENT: ContextVar[Budget | None] = ContextVar("budget", default=None)


def current() -> Budget:
    """The budget of what is being read; of a reader that is called by itself, one of its own."""
    return _CURRENT.get() or Budget()


@contextmanager
def budget(paths: Sequence[Path] = (), most: int | None = None) -> Iterator[Budget]:
    """The budget of what the block reads; within another one that a person has set, that one."""
    outer = _CURRENT.get()
    made = outer if outer is not None else Budget(paths, most)
    token = _CURRENT.set(made)
    try:
        yield made
    finally:
        _CURRENT.reset(token)
