"""MATLAB files of versions 5 to 7.2 (MAT-File Format, MathWorks), by a reader of our own; version 7.3 is HDF5.

SciPy reads them, too.  But its compiled part ends the whole program where damaged bytes state an unknown type of numbers, and it gives
nothing of a file that is cut.  Full arrays of numbers and texts are read here, in structs and cells as well; sparse arrays and objects are
passed over.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from session.base.budget import RECORD, current
from session.replay.binary.arrays import Array, Opened, Tables, rate_of
from session.replay.binary.source import Cut, Source, begins, reason

MAGIC = b"MATLAB 5.0 MAT-file"
HEAD = 128
#: packed bytes that are unpacked at once, and letters of a text that are kept
AT_ONCE, LONGEST_TEXT = 1 << 14, 256
#: types of data -> NumPy's; texts
NUMBERS = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
TEXTS = {1: "latin-1", 2: "latin-1", 4: "utf-16", 16: "utf-8", 17: "utf-16", 18: "utf-32"}
MATRIX, COMPRESSED = 14, 15
#: classes of arrays
CELL, STRUCT, CHAR, NUMERIC = 1, 2, 4, range(6, 16)
#: structs in structs, and elements of one struct or cell, that are opened
DEEPEST, MOST_ELEMENTS = 8, 1000
#: what a variable may be: its numbers, or a text
Value = np.ndarray | str


@contextmanager
def _opened(path: Path) -> Iterator[Opened]:
    """Names, shapes and units of the arrays, which are not kept until some are wanted; notes on where the file is damaged."""
    notes: list[str] = []
    shapes: dict[str, np.ndarray] = {}
    texts: dict[str, str] = {}
    scalars: dict[str, object] = {}
    for name, value in _variables(path, notes):
        if isinstance(value, str):
            texts[name] = value[:LONGEST_TEXT]
        elif value.size == 1:
            scalars[name] = value.copy()
        else:
            shapes[name] = np.broadcast_to(value.dtype.type(0), value.shape)
    arrays = [Array(name, value.shape, value.dtype, _unit(name, texts)) for name, value in shapes.items()]

    def values(names: set[str]) -> Callable[[str], np.ndarray]:
        kept = {key: value.copy() for key, value in _variables(path, []) if key in names and isinstance(value, np.ndarray)}
        return kept.__getitem__

    yield Opened(arrays, values, rate_of(scalars), notes, f"a MATLAB file ({notes[0]})" if notes else "")


def _unit(name: str, texts: dict[str, str]) -> str:
    """A text next to an array that names its unit: ``gyro_units``, ``imu.units.gyro``."""
    group, _, last = name.rpartition(".")
    near = [f"{name}_{word}" for word in ("unit", "units")] + [f"{group}.{word}.{last}".lstrip(".") for word in ("unit", "units")]
    return next((texts[key] for key in near if key in texts), "")


def _variables(path: Path, notes: list[str]) -> Iterator[tuple[str, Value]]:
    """Name and value of each array and text, one variable of the file in memory at a time; a damaged file ends with a note."""
    with Source(path) as source:
        head = source.read(min(HEAD, source.size))
        order = "<" if head[126:128] != b"MI" else ">"
        source.seek(HEAD)
        while (at := source.tell()) < source.size:
            try:
                made = list(_variable(source, order))
            except Cut:
                notes.append(f"cut in the variable at byte {at}")
                return
            except (struct.error, ValueError, KeyError, IndexError, UnicodeDecodeError, zlib.error, OverflowError, RecursionError) as error:
                notes.append(f"damaged at byte {at}, read up to there: {reason(error)}")
                return
            yield from made


def _variable(source: Source, order: str) -> Iterator[tuple[str, Value]]:
    """What the next variable of a file holds."""
    kind, length = struct.unpack(f"{order}II", source.read(8))
    body = memoryview(source.read(length))
    if kind == COMPRESSED:
        kind, body, _ = _element(_unpacked(source, body, order), 0, order)
    if kind == MATRIX:
        yield from _matrix(source.path, body, order, "", 0)


def _unpacked(source: Source, packed: memoryview, order: str) -> memoryview:
    """A variable, of the length that its head states.  ValueError where it has another."""
    unpack = zlib.decompressobj()
    head = unpack.decompress(packed, 8)
    length = 8 + struct.unpack(f"{order}4xI", head)[0]
    current().need(source.path, length + len(packed))
    whole = np.empty(length, np.uint8).data
    whole[:8], at = head, 8
    rest = memoryview(unpack.unconsumed_tail)
    for begin in range(0, len(rest), AT_ONCE):
        part = unpack.decompress(rest[begin : begin + AT_ONCE])
        current().unpack(source.path, len(part))
        if at + len(part) > len(whole):
            break
        whole[at : at + len(part)] = part
        at += len(part)
    if not unpack.eof or at != len(whole):
        raise ValueError("a variable does not end, or unpacks to another length than it states")
    return whole


def _element(data: memoryview, at: int, order: str) -> tuple[int, memoryview, int]:
    """Type and body of the data element there, and where the next one begins.  ValueError where it is longer than what holds it."""
    (word,) = struct.unpack_from(f"{order}I", data, at)
    if word >> 16:
        kind, length, begin, behind = word & 0xFFFF, word >> 16, at + 4, at + 8
    else:
        (length,) = struct.unpack_from(f"{order}I", data, at + 4)
        kind, begin, behind = word, at + 8, at + 8 + length + -length % 8
    if begin + length > len(data):
        raise ValueError("an element is longer than its variable")
    return kind, data[begin : begin + length], behind


def _matrix(path: Path, data: memoryview, order: str, name: str, depth: int) -> Iterator[tuple[str, Value]]:
    """The arrays and texts of a matrix; name: of what holds it."""
    current().unpack(path, RECORD)
    if depth > DEEPEST or not len(data):
        return
    _, flags, at = _element(data, 0, order)
    _, sizes, at = _element(data, at, order)
    _, own, at = _element(data, at, order)
    kind = struct.unpack_from(f"{order}I", flags)[0] & 0xFF
    shape = struct.unpack(f"{order}{len(sizes) // 4}i", sizes)
    name = name or bytes(own).decode("latin-1")
    count = math.prod(shape)
    if min(shape, default=0) < 0:
        raise ValueError("a matrix of negative size")
    if kind in NUMERIC:
        stored, numbers, _ = _element(data, at, order)
        values = np.frombuffer(numbers, np.dtype(f"{order}{NUMBERS[stored]}"))
        yield name, values.reshape(shape, order="F")
    elif kind == CHAR:
        stored, letters, _ = _element(data, at, order)
        code = TEXTS[stored]
        code = code if code[:3] != "utf" or code == "utf-8" else f"{code}-{'le' if order == '<' else 'be'}"
        kept = 4 * LONGEST_TEXT
        yield name, bytes(letters[:kept]).decode(code, "strict" if len(letters) <= kept else "replace")
    elif kind == STRUCT and count <= MOST_ELEMENTS:
        _, length, at = _element(data, at, order)
        _, words, at = _element(data, at, order)
        (width,) = struct.unpack_from(f"{order}i", length)
        if len(words) > MOST_ELEMENTS * max(width, 1):
            raise ValueError("a struct of more fields than any log has")
        fields = [bytes(words[begin : begin + width]).split(b"\0")[0].decode("latin-1") for begin in range(0, len(words), max(width, 1))]
        for place in range(count):
            for field in fields:
                _, inner, at = _element(data, at, order)
                yield from _matrix(path, inner, order, f"{name}[{place}].{field}" if count > 1 else f"{name}.{field}", depth + 1)
    elif kind == CELL and count <= MOST_ELEMENTS:
        for place in range(count):
            _, inner, at = _element(data, at, order)
            yield from _matrix(path, inner, order, f"{name}[{place}]", depth + 1)


FORMAT = Tables(
    "MATLAB",
    "a MATLAB file",
    "",
    "",
    "",
    "any .mat of MATLAB 5 to 7.2 with arrays or structs of them: imu.gyro (N, 3), imu.acc (N, 3), imu.t",
    begins(MAGIC),
    _opened,
)
