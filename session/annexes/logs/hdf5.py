"""HDF5 files, MATLAB's of version 7.3 among them, by h5py: datasets of any name, with their attribute ``units``."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from session.annexes.logs.arrays import Array, rate_of, streams_of, topics_of
from session.annexes.logs.source import library, one_line
from session.io.errors import FormatError
from session.io.files import open_file
from session.io.streams import Stream, Topic

NAME = "HDF5"
PACKAGE, EXTRA, LICENCE = "h5py", "logs", "BSD-3-Clause"
EXAMPLE = "any .h5, .hdf5 or MATLAB 7.3 .mat with arrays (N, 3), such as imu_gyr and imu_acc, and a time"
MAGIC = b"\x89HDF\r\n\x1a\n"
#: a global heap, of version 1
HEAP = b"GCOL\1\0\0\0"
UNITS = ("units", "unit", "Units", "Unit", "UNITS")
#: datasets that are looked at
MOST_DATASETS = 10_000


def is_mine(path: Path, head: bytes) -> bool:
    """By HDF5's eight bytes, at the beginning or behind a block of the user's, such as MATLAB's head."""
    return any(head.startswith(MAGIC, begin) for begin in (0, 512, 1024, 2048))


def topics(path: Path, columns: str | None) -> list[Topic]:
    """The streams that the datasets make; FormatError lists the datasets where that is not clear."""
    with one_line(path, "an HDF5 file"), _open(path) as file:
        arrays, _ = _arrays(file)
        return topics_of(path, "an HDF5 file", arrays, columns)


def read(path: Path, names: Sequence[str], columns: str | None) -> list[Stream]:
    """The streams of these names; only their datasets are read."""
    with one_line(path, "an HDF5 file"), _open(path) as file:
        arrays, rate_hz = _arrays(file)

        def values(name: str) -> np.ndarray:
            dataset, _, column = name.rpartition(".") if name not in file else (name, "", "")
            return np.asarray(file[dataset][column] if column else file[dataset][()])

        return streams_of(path, "an HDF5 file", arrays, values, names, columns, rate_hz)


def _open(path: Path) -> Any:
    h5py = library(path, "an HDF5 file", "h5py", PACKAGE)
    _require_heaps(path)
    return h5py.File(path, "r")


def _require_heaps(path: Path) -> None:
    """FormatError for a heap of texts with an object without length, in which HDF5's library goes round for ever (III.E of its format)."""
    with open_file(path) as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        heap = data.find(HEAP)
        while heap >= 0:
            end = min(heap + int.from_bytes(data[heap + 8 : heap + 16], "little"), len(data))
            at = heap + 16
            while at + 16 <= end:
                number, length = struct.unpack_from("<H6xQ", data, at)
                step = 16 + length + -length % 8 if number else length  # the last one, number 0, is the free space with its head
                if step < 16:
                    raise FormatError(f"{path}: an HDF5 file that is damaged at byte {at}; copy it again")
                at += step
            heap = data.find(HEAP, heap + 1)


def _arrays(file: Any) -> tuple[list[Array], float | None]:
    """The datasets of numbers, and of tables the columns; none that lies in another file is opened.  Their rate in Hz."""
    import h5py

    found: list[Array] = []
    rates: dict[str, object] = dict(file.attrs)

    def visit(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            rates.update({f"{name}/{key}": value for key, value in item.attrs.items() if key.lower() not in map(str.lower, UNITS)})
            if item.external or item.is_virtual or len(found) >= MOST_DATASETS:
                return
            if item.dtype.names:
                found.extend(
                    Array(f"{name}.{column}", item.shape, item.dtype[column]) for column in item.dtype.names if not item.dtype[column].shape
                )
            elif item.shape == () or item.size == 1:
                rates[name] = item[()]
            elif item.shape is not None:
                # An attribute that is a text, however it was written
                value = next((item.attrs[key] for key in UNITS if key in item.attrs), "")
                if isinstance(value, np.ndarray):
                    value = value.ravel()[0] if value.size else ""
                unit = value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
                found.append(Array(name, item.shape, item.dtype, unit))
        else:
            rates.update({f"{name}/{key}": value for key, value in item.attrs.items()})

    file.visititems(visit)
    return found, rate_of(rates)
