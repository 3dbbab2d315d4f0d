"""Arrays and attributes of the root group of an HDF5 file, as h5py and MATLAB write them by default.

Of the HDF5 File Format Specification 3.0: superblock 0, symbol tables (III.A to III.D), object headers of version 1 (IV.A.1.a), and numbers
that are contiguous or in chunks, packed by deflate or not.  Everything else is refused by name.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from session.io.errors import FormatError
from session.io.files import MOST_ARCHIVE, MOST_PUBLIC, read_bytes

SIGNATURE = b"\x89HDF\r\n\x1a\n"
DATASPACE, DATATYPE, LAYOUT, FILTERS, ATTRIBUTE, CONTINUATION, SYMBOL_TABLE = 0x1, 0x3, 0x8, 0xB, 0xC, 0x10, 0x11
CONTIGUOUS, CHUNKED = 1, 2
DEFLATE = 1
INTEGER, FLOAT, ENUMERATION = 0, 1, 8
#: messages of one object and nodes of one tree: far above what such files have, and an end where addresses run in a circle
MOST_PARTS = 100_000


def read_hdf5(path: Path, names: tuple[str, ...], attributes: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
    """The root group's datasets and attributes of these names, each in its own shape and type.

    Raises FormatError for what is no such file, is damaged, or lacks one of the names.
    """
    data = read_bytes(path, MOST_PUBLIC)
    if not data.startswith(SIGNATURE):
        raise FormatError(f"{path}: no HDF5 file; download it again")
    try:
        file = _File(data)
        root = file.messages(file.integer(0x40, 8))
        held = file.attributes(root)
        links = file.links(*struct.unpack_from("<QQ", _one(root, SYMBOL_TABLE)))
        if missing := [name for name in names if name not in links] + [name for name in attributes if name not in held]:
            raise FormatError(f"{path}: holds no {missing[0]}; is it the authors' file?")
        return {name: file.dataset(links[name]) for name in names} | {name: held[name] for name in attributes}
    except (struct.error, zlib.error, ValueError, TypeError, IndexError, KeyError, OverflowError, MemoryError) as error:
        raise FormatError(f"{path}: not an HDF5 file that can be read here ({error or type(error).__name__}); download it again") from None


class _File:
    """The bytes of a file, and what stands where in them."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        if data[8] != 0 or data[13:15] != b"\x08\x08":
            raise ValueError("its superblock is not of version 0 with 8-byte addresses")

    def integer(self, at: int, size: int) -> int:
        return int.from_bytes(self.part(at, size), "little")

    def part(self, at: int, size: int) -> bytes:
        if at + size > len(self.data):
            raise ValueError("it is cut short")
        return self.data[at : at + size]

    def messages(self, at: int) -> list[tuple[int, bytes]]:
        """Type and body of each message of the object header there."""
        if self.integer(at, 1) != 1:
            raise ValueError("an object header is not of version 1")
        found, blocks = [], [(at + 16, self.integer(at + 8, 4))]
        for start, size in blocks:
            block, place = self.part(start, size), 0
            while place + 8 <= size:
                kind, length = struct.unpack_from("<HH", block, place)
                body = block[place + 8 : place + 8 + length]
                found.append((kind, body))
                if kind == CONTINUATION:
                    blocks.append(struct.unpack_from("<QQ", body))
                place += 8 + length
                if len(found) > MOST_PARTS:
                    raise ValueError("an object header does not end")
        return found

    def links(self, tree: int, heap: int) -> dict[str, int]:
        """Name to object header, of a group's tree and local heap."""
        names, found = self.integer(heap + 24, 8), {}
        for _, node in self.leaves(tree, 0, 8):
            for place in range(node + 8, node + 8 + 40 * self.integer(node + 6, 2), 40):
                start = names + self.integer(place, 8)
                found[self.data[start : self.data.index(b"\0", start)].decode()] = self.integer(place + 8, 8)
        return found

    def leaves(self, root: int, kind: int, key_size: int) -> Iterator[tuple[bytes, int]]:
        """Key and address of each child of the lowest nodes of a B-tree of version 1."""
        nodes = [root]
        for node in nodes:
            if self.part(node, 5) != b"TREE" + bytes([kind]) or len(nodes) > MOST_PARTS:
                raise ValueError("a tree is damaged")
            level, entries = self.integer(node + 5, 1), self.integer(node + 6, 2)
            for place in range(node + 24, node + 24 + entries * (key_size + 8), key_size + 8):
                child = self.integer(place + key_size, 8)
                if level:
                    nodes.append(child)
                else:
                    yield self.part(place, key_size), child

    def attributes(self, messages: list[tuple[int, bytes]]) -> dict[str, np.ndarray]:
        """Those of numbers."""
        found = {}
        for body in (body for kind, body in messages if kind == ATTRIBUTE):
            version, _, *sizes = struct.unpack_from("<BBHHH", body)
            step = 8 if version == 1 else 1
            edges = [0, *np.cumsum([-size % step + size for size in sizes]).tolist()]
            start = 9 if version == 3 else 8
            name, datatype, dataspace = (body[start + a : start + b] for a, b in pairwise(edges))
            if datatype[0] & 15 in (INTEGER, FLOAT):
                shape, dtype = _shape(dataspace), _dtype(datatype)
                values = np.frombuffer(body, dtype, math.prod(shape), start + edges[-1])
                found[name.split(b"\0")[0].decode()] = values.reshape(shape)
        return found

    def dataset(self, at: int) -> np.ndarray:
        """The array whose object header is there."""
        messages = self.messages(at)
        shape, dtype, layout = _shape(_one(messages, DATASPACE)), _dtype(_one(messages, DATATYPE)), _one(messages, LAYOUT)
        size = math.prod(shape) * dtype.itemsize
        if size > MOST_ARCHIVE:
            raise ValueError(f"an array of {size} bytes")
        if layout[0] != 3 or layout[1] not in (CONTIGUOUS, CHUNKED):
            raise ValueError("an array is neither contiguous nor in chunks")
        if layout[1] == CONTIGUOUS:
            return np.frombuffer(self.part(struct.unpack_from("<Q", layout, 2)[0], size), dtype).reshape(shape)
        filters = [body for kind, body in messages if kind == FILTERS]
        if filters and filters[0][:2] + filters[0][8:10] != bytes([1, 1, DEFLATE, 0]):
            raise ValueError("its chunks are packed by something else than deflate")
        rank = layout[2] - 1
        tree, *chunk = struct.unpack_from(f"<Q{rank}I", layout, 3)
        length = math.prod(chunk) * dtype.itemsize
        if rank != len(shape) or not 0 < length <= MOST_ARCHIVE:
            raise ValueError("its chunks have another shape than its array")
        array, filled = np.empty(shape, dtype), 0
        for key, where in self.leaves(tree, 1, 8 + 8 * (rank + 1)):
            packed, _, *start = struct.unpack(f"<II{rank + 1}Q", key)
            raw = self.part(where, packed)
            raw = zlib.decompressobj().decompress(raw, length) if filters else raw
            place = tuple(slice(a, a + b) for a, b in zip(start, chunk, strict=False))
            into = array[place]
            into[...] = np.frombuffer(raw, dtype, math.prod(chunk)).reshape(chunk)[tuple(slice(n) for n in into.shape)]
            filled += into.size
        if filled != array.size:
            raise ValueError("chunks are missing")
        return array


def _one(messages: list[tuple[int, bytes]], kind: int) -> bytes:
    """The body of the first message of a kind."""
    for found, body in messages:
        if found == kind:
            return body
    raise ValueError(f"a header has no message {kind:#x}")


def _shape(body: bytes) -> tuple[int, ...]:
    """Of a dataspace message."""
    return struct.unpack_from(f"<{body[1]}Q", body, {1: 8, 2: 4}[body[0]])


def _dtype(body: bytes) -> np.dtype:
    """Of a datatype message, whole numbers or floating ones; an enumeration is what it is stored as."""
    kind, order, size = body[0] & 15, body[1] & 1, struct.unpack_from("<I", body, 4)[0]
    if kind == ENUMERATION:
        return _dtype(body[8:])
    if kind not in (INTEGER, FLOAT) or size not in (1, 2, 4, 8):
        raise ValueError("an array does not hold numbers")
    letter = "f" if kind == FLOAT else "i" if body[1] & 8 else "u"
    return np.dtype(f"{'<>'[order]}{letter}{size}")
