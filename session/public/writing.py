"""A session folder of one recording: its log, its ``session.toml``, and an accelerometer calibrated from its own stills if asked."""

from __future__ import annotations

import gzip
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

from session.accelerometer.calibrated_copy import REMARK
from session.accelerometer.from_stills import from_stills
from session.accelerometer.section import with_section
from session.common.errors import CalibrationError, FormatError, SegmentError
from session.files.reading import MOST_ARCHIVE, MOST_TOML, read_bytes, read_text
from session.files.writing import result_folder
from session.log.folder import log_paths, read_session

LOG = "log0001.csv.gz"


def write_folder(folder: Path, toml: str, header: str, lines: Iterable[str], given: bool = True) -> Path:
    """``session.toml`` and ``log0001.csv.gz``; the same lines make the same bytes.  given: as in ``placed``, whose errors it raises."""

    def write(where: Path) -> None:
        text = "\n".join([header, *lines, ""])
        (where / LOG).write_bytes(gzip.compress(text.encode(), compresslevel=6, mtime=0))
        (where / "session.toml").write_text(toml, encoding="utf-8")

    _refuse_another(folder)
    return placed(folder, write, given)


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


def _refuse_another(folder: Path) -> None:
    if others := [path.name for path in log_paths(folder, "log") if path.name != LOG]:
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
