"""MATLAB files of versions 4 to 7.2 by SciPy, which is installed with this project; version 7.3 is HDF5."""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from session.annexes.logs.arrays import Array, rate_of, streams_of, topics_of
from session.annexes.logs.source import one_line
from session.io.errors import FormatError
from session.io.files import MB, open_file, require_file
from session.io.streams import Stream, Topic

NAME = "MATLAB"
PACKAGE, EXTRA, LICENCE = "", "", ""
EXAMPLE = "any .mat of MATLAB 4 to 7.2 with arrays or structs of them: imu.gyro (N, 3), imu.acc (N, 3), imu.t"
MAGIC = b"MATLAB 5.0 MAT-file"
#: type of a matrix of version 4, and the length of its name: numbers of a few kinds, and a short name
FOURTH = (0, 10, 20, 30, 40, 50, 1000, 1010, 1020, 1030, 1040, 1050)
LONGEST_NAME = 64
#: of unpacked bytes: two days of seven columns at 208 Hz have 2 GB
MOST = 4096 * MB
COMPRESSED = 15
#: structs in structs that are opened
DEEPEST = 6


def is_mine(path: Path, head: bytes) -> bool:
    """By the text that version 5 begins with; of version 4, which has none, by the name and the first matrix."""
    if head.startswith(MAGIC):
        return True
    if path.suffix.lower() != ".mat" or len(head) < 20:
        return False
    kind, rows, columns, _, length = struct.unpack("<5i", head[:20])
    return kind in FOURTH and rows >= 0 and columns >= 0 and 0 < length <= LONGEST_NAME


def topics(path: Path, columns: str | None) -> list[Topic]:
    """The streams that the arrays make; FormatError lists the arrays where that is not clear."""
    return topics_of(path, "a MATLAB file", _load(path)[0], columns)


def read(path: Path, names: Sequence[str], columns: str | None) -> list[Stream]:
    """The streams of these names."""
    arrays, values, rate_hz = _load(path)
    return streams_of(path, "a MATLAB file", arrays, values.__getitem__, names, columns, rate_hz)


def _load(path: Path) -> tuple[list[Array], dict[str, np.ndarray], float | None]:
    """Every array of numbers by name, ``imu.gyro`` of a struct.  FormatError for what SciPy cannot read."""
    require_file(path)
    with one_line(path, "a MATLAB file"):
        _require_size(path)
        from scipy.io import loadmat

        values: dict[str, np.ndarray] = {}
        scalars: dict[str, object] = {}
        texts: dict[str, str] = {}
        for name, value in _parts(loadmat(path, simplify_cells=True, verify_compressed_data_integrity=True), "", 0):
            if isinstance(value, str):
                texts[name] = value
            elif value.size == 1:
                scalars[name] = value
            else:
                values[name] = value
    arrays = [Array(name, value.shape, value.dtype, _unit(name, texts)) for name, value in values.items()]
    return arrays, values, rate_of(scalars)


def _parts(value: Any, name: str, depth: int) -> Iterator[tuple[str, Any]]:
    """The arrays and texts of a struct and of those in it."""
    if isinstance(value, dict) and depth <= DEEPEST:
        for key, inner in value.items():
            if not key.startswith("__"):
                yield from _parts(inner, f"{name}.{key}" if name else key, depth + 1)
    elif isinstance(value, (str, np.ndarray)):
        yield name, value
    elif isinstance(value, (int, float, np.number)):
        yield name, np.asarray(value)


def _unit(name: str, texts: dict[str, str]) -> str:
    """A text beside an array that names its unit: ``gyro_units``, ``imu.units.gyro``."""
    group, _, last = name.rpartition(".")
    near = [f"{name}_{word}" for word in ("unit", "units")] + [f"{group}.{word}.{last}".lstrip(".") for word in ("unit", "units")]
    return next((texts[key] for key in near if key in texts), "")


def _require_size(path: Path) -> None:
    """FormatError for a file whose compressed parts unpack to more than any recording has, before SciPy unpacks them."""
    with open_file(path) as file:
        if not re.match(MAGIC, head := file.read(128)):
            return
        order, whole = ("<" if head[126:128] == b"IM" else ">"), 0
        while len(tag := file.read(8)) == 8:
            kind, length = struct.unpack(f"{order}II", tag)
            if kind != COMPRESSED:
                whole += length
                file.seek(length, 1)
            else:
                unpack = zlib.decompressobj()
                while length > 0 and (block := file.read(min(length, MB))):
                    length -= len(block)
                    while block:
                        whole += len(unpack.decompress(block, MB))
                        block = unpack.unconsumed_tail
                        if whole > MOST:
                            break
            if whole > MOST:
                raise FormatError(f"{path}: unpacks to more than {MOST / MB:g} MB; is it the right one?")
