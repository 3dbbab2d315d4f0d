"""What an ELF file brings to the board's memory."""

from __future__ import annotations

import struct
from pathlib import Path

from session.files.reading import MB, read_bytes

#: with all that a debugger wants; the memory of the largest such controller has 2 MB
MOST_PROGRAM = 64 * MB
LOAD, ARM = 1, 40


def segments(path: Path) -> list[tuple[int, bytes]]:
    """(load address, bytes) of each loadable part.  Raises ValueError where it is no 32-bit little-endian ELF file for ARM; FormatError
    where it cannot be read."""
    data = read_bytes(path, MOST_PROGRAM)
    if data[:6] != b"\x7fELF\x01\x01" or len(data) < 52 or struct.unpack_from("<H", data, 18)[0] != ARM:
        raise ValueError(f"{path}: is no program for ARM; expected the ELF file that the firmware's make writes")
    (table,), (size, count) = struct.unpack_from("<I", data, 28), struct.unpack_from("<HH", data, 42)
    found = []
    for number in range(count):
        kind, offset, _, address, length = struct.unpack_from("<5I", data, table + number * size)
        if kind == LOAD and length:
            if offset + length > len(data):
                raise ValueError(f"{path}: is cut off")
            found.append((address, data[offset : offset + length]))
    return found
