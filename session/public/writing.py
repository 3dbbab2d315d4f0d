"""A session folder of one recording: its log, its ``session.toml``, and an accelerometer calibrated from its own stills if asked."""

from __future__ import annotations

import gzip
import tempfile
from collections.abc import Callable, Iterable, Mapping, Set
from pathlib import Path

from session.accelerometer.calibrated_copy import REMARK
from session.accelerometer.from_stills import from_stills
from session.accelerometer.section import with_section
from session.common.errors import CalibrationError, FormatError, SegmentError
from session.files.reading import MOST_ARCHIVE, MOST_TOML, read_bytes, read_text
from session.files.writing import result_folder
from session.log.array_reading import read_array
from session.log.folder import log_paths, read_session

LOG = "log0001.csv.gz"


def write_folder(folder: Path, toml: str, header: str, lines: Iterable[str], given: bool = True) -> Path:
    """``session.toml`` and ``log0001.csv.gz``; the same lines make the same bytes.  given: as in ``placed``, whose errors it raises."""

    def write(where: Path) -> None:
        _write_log(where / LOG, header, lines)
        (where / "session.toml").write_text(toml, encoding="utf-8")

    _refuse_another(folder, {LOG})
    return placed(folder, write, given)


def write_array_folder(folder: Path, toml: str, logs: Mapping[str, tuple[str, Iterable[str]]]) -> Path:
    """``session.toml`` and the units' logs, of each its header and its lines.  Raises what ``placed`` does."""

    def write(where: Path) -> None:
        for name, (header, lines) in logs.items():
            _write_log(where / name, header, lines)
        (where / "session.toml").write_text(toml, encoding="utf-8")

    _refuse_another(folder, set(logs))
    return placed(folder, write, True, read_array)


def write_array_of_folders(folder: Path, toml: str) -> Path:
    """``session.toml`` beside the units' folders, which are there.  FormatError where another is in its place."""
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
            said = str(error).replace(part, str(folder))
            raise type(error)(f"{folder}: these files make no recording ({said}); download them again") from None
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
