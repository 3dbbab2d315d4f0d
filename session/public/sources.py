"""The authors' files: found in the folder where they were put, or where a clone of the authors' repository has them; and read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from session.common.errors import FormatError
from session.files.archives import read_npz
from session.files.reading import MOST_PUBLIC, read_bytes, read_text


def found(folder: Path, pattern: str, below: str = "") -> list[Path]:
    """Files of a pattern in the folder itself, else in ``folder/below``, in name order.  FormatError where there is none."""
    if not folder.is_dir():
        raise FormatError(f"{folder}: {'that is a file' if folder.exists() else 'not found'}; give the folder with the authors' files")
    for place in (folder, folder / below):
        if paths := sorted(place.glob(pattern)):
            return paths
    nor = f", nor does its {below}" if below else ""
    raise FormatError(f"{folder}: holds no {pattern}{nor}; download the authors' files first (docs/real-recordings.md)")


def rows_of_numbers(path: Path, columns: tuple[str, ...], separator: str | None = None, skip: int = 0) -> list[list[str]]:
    """The cells of each line as they are written, all finite numbers; separator: None for white space.  Lines with # are left out, and
    the first ``skip``.

    Raises FormatError with the number of the line.
    """
    expected = f"expected {len(columns)} numbers: {' '.join(columns)}"
    rows = []
    for number, line in enumerate(text_of(path).splitlines(), start=1):
        if number <= skip or not line.strip() or line.startswith("#"):
            continue
        cells = [cell.strip() for cell in line.split(separator)]
        if len(cells) != len(columns) or not all(map(_finite, cells)):
            raise FormatError(f"{path} line {number}: {line[:60]!r}, {expected}; download it again")
        rows.append(cells)
    if len(rows) < 2:
        raise FormatError(f"{path}: {len(rows)} lines of numbers, {expected} in each of many")
    return rows


def arrays_of(path: Path, kinds: dict[str, str]) -> list[np.ndarray]:
    """Arrays of a NumPy archive by their names, each of a kind of numbers: ``i`` whole, ``f`` finite or not.

    Raises FormatError for what is no such archive, or not sound.
    """
    found = [*read_npz(path, tuple(kinds)).values()]
    for (name, kind), array in zip(kinds.items(), found, strict=True):
        if not (np.issubdtype(array.dtype, np.integer) or (kind == "f" and np.issubdtype(array.dtype, np.floating))):
            raise FormatError(f"{path}: {name} holds {array.dtype}, expected {'whole ' if kind == 'i' else ''}numbers; download it again")
    return found


def text_of(path: Path) -> str:
    """A text file; FormatError where it is missing or no text."""
    return read_text(path, MOST_PUBLIC, "download it again")


def bytes_of(path: Path) -> np.ndarray:
    """A binary file as (N,) uint8; FormatError where it cannot be read."""
    return np.frombuffer(read_bytes(path, MOST_PUBLIC), dtype=np.uint8)


def _finite(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell)))
    except ValueError:
        return False
