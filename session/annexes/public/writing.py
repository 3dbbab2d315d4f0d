"""Find the authors' files of a public set, and write a session folder of a recording."""

from __future__ import annotations

import gzip
import tempfile
from collections.abc import Callable, Iterable, Mapping, Set
from pathlib import Path

import numpy as np

from session.annexes.arrays.recording import read_array
from session.detect.accelerometer import REMARK, from_stills, with_section
from session.io.config import read_config
from session.io.errors import CalibrationError, FormatError, SegmentError
from session.io.files import MOST_ARCHIVE, MOST_PUBLIC, MOST_TOML, read_bytes, read_npz, read_text, result_folder
from session.io.folder import read_session
from session.io.names import log_paths
from session.io.rests import read_rest

# The authors' files: found in the folder where they were put, or where a clone of the authors' repository has them; and read.


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


# A session folder of one recording: its log, its ``session.toml``, and an accelerometer calibrated from its own stills on request.

LOG, TRUTH, REST = "log0001.csv.gz", "truth0001.csv.gz", "rest0001.csv.gz"
#: header and lines of a file beside the log
Table = tuple[str, Iterable[str]]


def write_folder(folder: Path, toml: str, header: str, lines: Iterable[str], given: bool = True, truth: Table | None = None) -> Path:
    """``session.toml``, ``log0001.csv.gz`` and, with a truth, ``truth0001.csv.gz``; the same lines make the same bytes.

    given: as in ``placed``, whose errors it raises.
    """

    def write(where: Path) -> None:
        _write_log(where / LOG, header, lines)
        if truth is not None:
            _write_log(where / TRUTH, *truth)
        (where / "session.toml").write_text(toml, encoding="utf-8")

    _refuse_another(folder, {LOG})
    return placed(folder, write, given)


def write_rest_folder(folder: Path, toml: str, header: str, lines: Iterable[str]) -> Path:
    """``session.toml`` and ``rest0001.csv.gz``, a rest log.  Raises what ``placed`` does."""

    def write(where: Path) -> None:
        _write_log(where / REST, header, lines)
        (where / "session.toml").write_text(toml, encoding="utf-8")

    def read(where: Path) -> None:
        read_rest(where / REST, read_config(where / "session.toml").sensor)

    return placed(folder, write, True, read)


def write_array_folder(folder: Path, toml: str, logs: Mapping[str, Table]) -> Path:
    """``session.toml`` and the units' logs, of each its header and its lines.  Raises what ``placed`` does."""

    def write(where: Path) -> None:
        for name, (header, lines) in logs.items():
            _write_log(where / name, header, lines)
        (where / "session.toml").write_text(toml, encoding="utf-8")

    _refuse_another(folder, set(logs))
    return placed(folder, write, True, read_array)


def write_array_of_folders(folder: Path, toml: str) -> Path:
    """``session.toml`` next to the units' folders, which are there.  FormatError where another is in its place."""
    _refuse_another(folder, set())
    refuse_to_replace(folder / "session.toml", toml.encode())
    (folder / "session.toml").write_text(toml, encoding="utf-8")
    read_array(folder)
    return folder


def copied(session: Path, folder: Path) -> Path:
    """A session folder's own recording, its logs and its ``session.toml``, in another place.  Raises what ``placed`` does."""
    paths = [session / "session.toml", *log_paths(session, "log")]

    def write(where: Path) -> None:
        for path in paths:
            (where / path.name).write_bytes(read_bytes(path, MOST_ARCHIVE))

    _refuse_another(folder, {path.name for path in paths})
    return placed(folder, write, True)


def _write_log(path: Path, header: str, lines: Iterable[str]) -> None:
    path.write_bytes(gzip.compress("\n".join([header, *lines, ""]).encode(), compresslevel=6, mtime=0))


def placed(folder: Path, write: Callable[[Path], None], given: bool, read: Callable[[Path], object] = read_session) -> Path:
    """The folder, with what ``write`` writes; not given: with an accelerometer calibrated from its own stills.  read: what reads it.

    A recording that cannot be read again, or not be calibrated so, leaves no file behind, and what lies in the folder from before stays
    as it was.  Raises CalibrationError then, and FormatError where it would take another file's place.
    """
    with result_folder(folder), tempfile.TemporaryDirectory(dir=folder, prefix=".part-") as part:
        write(Path(part))
        try:
            read(Path(part))
        except CalibrationError as error:
            reason = str(error).replace(part, str(folder))
            raise type(error)(f"{folder}: these files make no recording ({reason}); download them again") from None
        if not given:
            try:
                calibrate_from_stills(Path(part))
            except CalibrationError as error:
                raise type(error)(str(error).replace(part, str(folder))) from None
        made = sorted(Path(part).iterdir())
        for path in made:
            refuse_to_replace(folder / path.name, read_bytes(path, MOST_ARCHIVE))
        for path in made:
            path.replace(folder / path.name)
    return folder


def refuse_to_replace(path: Path, data: bytes) -> None:
    """FormatError where a file is there that says something else: another recording's, or what a person has written into it."""
    if path.exists() and read_bytes(path, MOST_ARCHIVE) != data:
        raise FormatError(f"{path.parent}: holds another {path.name}; choose another folder with --out, or remove that one")


def _refuse_another(folder: Path, names: Set[str]) -> None:
    if others := [path.name for path in log_paths(folder, "log") if path.name not in names]:
        raise FormatError(f"{folder}: holds {others[0]} of another recording; choose another folder with --out")


def calibrate_from_stills(folder: Path) -> None:
    """Write the pre-calibration that the folder's own stills give into its ``session.toml``.  SegmentError where they do not."""
    session = read_session(folder)
    config = session.config
    try:
        accelerometer = from_stills([log.samples for log in session.logs], config.site.expected_gravity_mps2, config.protocol.still_s)
    except SegmentError as error:
        raise SegmentError(f"{folder}: {error}") from None
    path = folder / "session.toml"
    path.write_text(with_section(read_text(path, MOST_TOML), accelerometer, REMARK), encoding="utf-8")
