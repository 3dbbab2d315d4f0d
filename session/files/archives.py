"""NumPy's archives of arrays (``.npz``), of the size that they say and no larger."""

from __future__ import annotations

import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np

from session.common.errors import FormatError
from session.files.reading import MOST_ARCHIVE, open_file

#: what NumPy and zipfile raise where an archive's bytes are damaged, whatever they meet first
FAULTS = (
    *(OSError, ValueError, KeyError, EOFError, SyntaxError, OverflowError, MemoryError, NotImplementedError, RuntimeError),
    *(zipfile.BadZipFile, zlib.error, struct.error),
)


def read_npz(path: Path, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Arrays of an archive by name.  FormatError where it is none, lacks one of them, or unpacks to more than any recording has."""
    with open_file(path) as file:
        try:
            with zipfile.ZipFile(file) as archive:
                members = {f"{name}.npy": archive.getinfo(f"{name}.npy") for name in names}
                if sum(member.file_size for member in members.values()) > MOST_ARCHIVE:
                    raise FormatError(f"{path}: unpacks to more than {MOST_ARCHIVE} bytes; is it the right one?")
                return {name: _array(archive, member) for name, member in zip(names, members.values(), strict=True)}
        except FAULTS:
            raise FormatError(f"{path}: not an archive of {', '.join(names)}, or a damaged one; download it again") from None


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    """ValueError where its header asks for more than the member has."""
    with archive.open(member) as file:
        version = np.lib.format.read_magic(file)
        read = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}.get(version)
        if read is None:
            raise ValueError(version)
        shape, _, dtype = read(file)
        if dtype.hasobject or int(np.prod(shape, dtype=object)) * dtype.itemsize > member.file_size:
            raise ValueError(shape)
    with archive.open(member) as file:
        return np.lib.format.read_array(file, allow_pickle=False)
