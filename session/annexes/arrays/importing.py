"""An array out of one log that holds the rows of several sensors, told apart by a column."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from session.annexes.arrays.recording import read_array
from session.io.dialects import Answers
from session.io.errors import CalibrationError, FormatError
from session.io.files import naming
from session.io.reader import Reader
from session.io.texts import command_line
from session.replay.convert import Converted, convert


def import_array(paths: Sequence[Path], out: Path, answers: Answers, column: str, columns: Sequence[str] = ()) -> Converted:
    """``out/unit0`` and so on, a session for each value of the column, and a ``session.toml`` that makes them one array.

    Nothing is left behind where it fails.  Raises FormatError, and what ``convert`` raises.
    """
    if len(paths) != 1:
        raise FormatError(f"--array-by reads one log, not {len(paths)}; give the one that holds the rows of all sensors")
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise FormatError(f"{out}: exists; give --out a new folder")
    values = Reader(paths[0], replace(answers, where=None), picking=column).values_of(column)
    made: list[Converted] = []
    try:
        for number, value in enumerate(values):
            told = replace(answers, where=f"{column}={value}")
            made.append(convert(paths, out / f"unit{number}", told, serial=f"{column}-{value}", columns=columns))
        with naming(out):
            folders = ", ".join(f'"unit{number}"' for number in range(len(values)))
            (out / "session.toml").write_text(f'schema = "tinygc-session/1"\n\n[array]\nfolders = [{folders}]\n', encoding="utf-8")
        read_array(out)
    except (CalibrationError, OSError):
        for each in made:
            shutil.rmtree(each.folder)
        (out / "session.toml").unlink(missing_ok=True)
        if out.is_dir() and not any(out.iterdir()):
            out.rmdir()
        raise
    notes = tuple(f"{each.folder.name}: {note}" for each in made for note in each.notes)
    findings = tuple(replace(finding, where=f"{each.folder.name} {finding.where}") for each in made for finding in each.findings)
    units = ", ".join(f"{column}={value} is {each.folder.name}" for value, each in zip(values, made, strict=True))
    samples = sum(each.samples for each in made)
    steps = (command_line("check", out), command_line("fit", out))
    return Converted(out, out, made[0].dialects, samples, notes, findings, steps, (*made[0].took, units))
