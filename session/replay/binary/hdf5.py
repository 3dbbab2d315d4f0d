"""HDF5 files, MATLAB's of version 7.3 among them, by h5py: datasets of any name, with their attribute ``units``."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from session.base.budget import current
from session.base.errors import FormatError
from session.replay.binary.arrays import Array, Opened, Tables, is_rate, rate_of
from session.replay.binary.source import Source, library

PACKAGE = "h5py"
MAGIC = b"\x89HDF\r\n\x1a\n"
#: a global heap, of version 1
HEAP = b"GCOL\1\0\0\0"
BLOCK = 1 << 22
UNITS = ("units", "unit", "Units", "Unit", "UNITS")
#: groups and datasets that are looked at, and groups in one another
MOST_OBJECTS, DEEPEST = 50_000, 32
#: of a rate or a unit
LONGEST_TEXT = 1 << 16


def is_mine(path: Path, head: bytes) -> bool:
    """By HDF5's eight bytes, at the beginning or behind a block of the user's, such as MATLAB's head."""
    return any(head.startswith(MAGIC, begin) for begin in (0, 512, 1024, 2048))


@contextmanager
def _opened(path: Path) -> Iterator[Opened]:
    h5py = library(path, "an HDF5 file", "h5py", PACKAGE)
    _require_heaps(path)
    with h5py.File(path, "r") as file:
        arrays, rate_hz = _arrays(path, file)

        def value(name: str) -> np.ndarray:
            dataset, _, column = name.rpartition(".") if name not in file else (name, "", "")
            stored = file[dataset]
            if stored.chunks is not None:  # a chunk is unpacked whole, next to its packed bytes
                current().need(path, 2 * math.prod(stored.chunks) * stored.dtype.itemsize)
            return np.asarray(stored[column] if column else stored[()])

        yield Opened(arrays, lambda names: value, rate_hz)


def _require_heaps(path: Path) -> None:
    """FormatError for a heap of texts with an object without length, in which HDF5's library goes round for ever (III.E of its format)."""
    with Source(path) as source:
        left = source.size // 16 + 1  # objects that the file has room for: heaps in one another would be gone through again and again
        for heap in _heaps(source):
            source.seek(heap + 8)
            end = min(heap + int.from_bytes(source.read(8), "little"), source.size)
            at = heap + 16
            while at + 16 <= end:
                source.seek(at)
                number, length = struct.unpack("<H6xQ", source.read(16))
                step = 16 + length + -length % 8 if number else length  # the last one, number 0, is the free space with its head
                left -= 1
                if step < 16 or left < 0:
                    raise FormatError(f"{path}: an HDF5 file that is damaged at byte {at}; copy it again")
                at += step


def _heaps(source: Source) -> Iterator[int]:
    """Where heaps begin."""
    start, data = 0, b""
    while start + len(HEAP) < source.size:
        source.seek(start)
        data = source.read(min(BLOCK, source.size - start))
        at = data.find(HEAP)
        while at >= 0:
            if start + at + 16 <= source.size:
                yield start + at
            at = data.find(HEAP, at + 1)
        start += len(data) - len(HEAP) + 1


def _attributes(item: Any, wanted: Any) -> dict[str, Any]:
    """The attributes of these names that are one number or one text; no other is read."""
    found = {}
    for name in filter(wanted, item.attrs):
        stored = item.attrs.get_id(name)
        if math.prod(stored.shape) == 1 and stored.dtype.itemsize <= LONGEST_TEXT:
            found[name] = item.attrs[name]
    return found


def _arrays(path: Path, file: Any) -> tuple[list[Array], float | None]:
    """The datasets of numbers, and of tables the columns; none that lies in another file is opened.  Their rate in Hz.

    FormatError where more lies in the file, or lies deeper, than any log has.
    """
    import h5py

    found: list[Array] = []
    rates = _attributes(file, is_rate)
    seen = {hash(file["/"].id)}

    def visit(group: Any, above: str, depth: int) -> None:
        for key in group:
            if not isinstance(group.get(key, getlink=True), h5py.HardLink):
                continue
            item, name = group[key], f"{above}{key}"
            if hash(item.id) in seen:
                continue
            seen.add(hash(item.id))
            if len(seen) > MOST_OBJECTS or depth > DEEPEST:
                what = f"groups more than {DEEPEST} deep" if depth > DEEPEST else f"more than {MOST_OBJECTS} groups and datasets"
                raise FormatError(f"{path}: an HDF5 file with {what}; is it the right file? copy what is of the log into one of its own")
            rates.update({f"{name}/{key}": value for key, value in _attributes(item, is_rate).items()})
            if isinstance(item, h5py.Group):
                visit(item, f"{name}/", depth + 1)
            elif isinstance(item, h5py.Dataset) and not (item.external or item.is_virtual or item.shape is None):
                found.extend(_columns(item, name))
                if is_rate(name) and item.size == 1 and item.dtype.itemsize <= LONGEST_TEXT:
                    rates[name] = item[()]

    visit(file, "", 1)
    return found, rate_of(rates)


def _columns(item: Any, name: str) -> list[Array]:
    """A dataset, or the columns of a table; none of a single number."""
    if item.dtype.names:
        return [Array(f"{name}.{column}", item.shape, item.dtype[column]) for column in item.dtype.names if not item.dtype[column].shape]
    if item.size == 1:
        return []
    # An attribute that is a text, however it was written
    value = next((np.ravel(value)[0] for value in _attributes(item, UNITS.__contains__).values()), "")
    return [Array(name, item.shape, item.dtype, value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value))]


FORMAT = Tables(
    "HDF5",
    "an HDF5 file",
    PACKAGE,
    "logs",
    "BSD-3-Clause",
    "any .h5, .hdf5 or MATLAB 7.3 .mat with arrays (N, 3), such as imu_gyr and imu_acc, and a time",
    is_mine,
    _opened,
)
