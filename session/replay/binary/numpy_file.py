"""NumPy's files: archives of arrays (``.npz``), and single arrays (``.npy``) with named columns or with ``--columns`` by number."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from session.base.files import open_file, read_npz
from session.replay.binary.arrays import Array, Opened, Tables, rate_of

MAGIC = b"\x93NUMPY"
ZIP = b"PK\x03\x04"
#: of a zip file's first entry: its name stands behind 30 bytes
NAME_AT = 30
#: arrays that are looked at
MOST_ARRAYS = 1000


def is_mine(path: Path, head: bytes) -> bool:
    """By NumPy's six bytes, or by a zip file whose first entry is an array."""
    if head.startswith(MAGIC):
        return True
    first = head[NAME_AT : NAME_AT + int.from_bytes(head[26:28], "little")]
    return head.startswith(ZIP) and (first.endswith(b".npy") or path.suffix.lower() == ".npz")


@contextmanager
def _opened(path: Path) -> Iterator[Opened]:
    """Arrays are read without pickles."""
    arrays, rate_hz = _arrays(path)
    yield Opened(arrays, lambda names: partial(_values, path), rate_hz)


def _is_archive(path: Path) -> bool:
    with open_file(path) as file:
        return file.read(len(ZIP)) == ZIP


def _arrays(path: Path) -> tuple[list[Array], float | None]:
    """Names, shapes and types by the heads alone; a rate among the scalars."""
    if not _is_archive(path):
        # Shape and type of a single array, which is not read
        array = np.load(path, mmap_mode="r", allow_pickle=False)
        return _columns("", (array.shape, array.dtype)), None
    found: list[Array] = []
    scalars: dict[str, object] = {}
    with open_file(path) as file, zipfile.ZipFile(file) as archive:
        for member in archive.infolist()[:MOST_ARRAYS]:
            if not member.filename.endswith(".npy"):
                continue
            name = member.filename.removesuffix(".npy")
            with archive.open(member) as opened:
                version = np.lib.format.read_magic(opened)
                head = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
                shape, _, dtype = head(opened)
            if dtype.hasobject:
                continue
            if shape == () and dtype.kind in "iuf":
                scalars[name] = read_npz(path, (name,))[name]
            else:
                found += _columns(name, (shape, dtype))
    return found, rate_of(scalars)


def _columns(name: str, head: tuple[tuple[int, ...], np.dtype]) -> list[Array]:
    """An array, or its columns: of a structured one by their names, of a single unnamed one by their numbers from 1."""
    shape, dtype = head
    if dtype.names:
        return [Array(f"{name}.{column}".lstrip("."), (*shape, *dtype[column].shape), dtype[column].base) for column in dtype.names]
    if not name and len(shape) == 2 and shape[1] > 3:
        return [Array(f"{place + 1}", (shape[0],), dtype) for place in range(shape[1])]
    return [Array(name or "array", shape, dtype)]


def _values(path: Path, name: str) -> np.ndarray:
    """An array by the name that ``_columns`` gave it."""
    if _is_archive(path):
        with open_file(path) as file, zipfile.ZipFile(file) as archive:
            whole = f"{name}.npy" in archive.namelist()
        array, _, column = (name, "", "") if whole else name.rpartition(".")
        return read_npz(path, (array,))[array] if whole else read_npz(path, (array or column,))[array][column]
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    if array.dtype.names:
        return np.asarray(array[name])
    return np.asarray(array[:, int(name) - 1] if name.isdigit() else array)


FORMAT = Tables(
    "NumPy",
    "a NumPy file",
    "",
    "",
    "",
    "np.savez('log.npz', t_ns=t, gyro_dps=gyro, accel_g=accel); a .npy with named columns",
    is_mine,
    _opened,
)
