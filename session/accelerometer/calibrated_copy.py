"""A copy of a session folder, with the accelerometer's calibration that its own stills give."""

from __future__ import annotations

import shutil
from pathlib import Path

from session.accelerometer.section import with_section
from session.common.errors import FormatError
from session.files.reading import MOST_TOML, read_text
from session.files.writing import naming, result_folder
from session.log.config import Accelerometer

REMARK = "From the recording's own stills: in each of them the corrected force has gravity's length."


def write_calibrated_copy(folder: Path, out: Path, accelerometer: Accelerometer) -> None:
    """Copy the folder's files, not what was made of them (its sub-folders), and put the calibration into session.toml.

    Raises FormatError where ``out`` is there and not empty, and StorageError for a full disk.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise FormatError(f"{out}: is there already; give --out another folder, nothing is written over")
    if out.resolve().is_relative_to(folder.resolve()):
        raise FormatError(f"{out}: lies within the session folder; give --out another folder")
    with result_folder(out):
        for path in sorted(path for path in folder.iterdir() if path.is_file() and not path.name.startswith(".")):
            with naming(out / path.name):
                if path.name == "session.toml":
                    text = with_section(read_text(path, MOST_TOML).replace("\r\n", "\n"), accelerometer, REMARK)
                    (out / path.name).write_text(text, encoding="utf-8")
                else:
                    shutil.copy2(path, out / path.name)
