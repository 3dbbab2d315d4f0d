"""An array out of one log that holds the rows of several sensors, separated by a column."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from session.base.errors import FormatError
from session.base.files import folder_whole, require_empty, write_new
from session.base.texts import command_line
from session.detect.findings import Finding
from session.replay.convert import Imported, convert
from session.replay.forms import EXAMPLES
from session.replay.options import Answers
from session.replay.sources import BY_NAMES
from session.replay.tables import TableReader
from tinygc.features.arrays.recording import read_array

#: a note or a finding
Stated = TypeVar("Stated", str, Finding)


def import_array(paths: Sequence[Path], out: Path, answers: Answers, column: str, columns: Sequence[str] = ()) -> Imported:
    """``out/unit0`` and so on, a session for each value of the column, and a ``session.toml`` that makes them one array.

    Nothing is left behind where it fails.  Raises FormatError, and what ``convert`` raises.
    """
    if len(paths) != 1:
        raise FormatError(f"--array-by reads one log, not {len(paths)}; give the one that holds the rows of all sensors")
    require_empty(out, "exists; give --out a new folder")
    like = None if answers.like in (BY_NAMES, *EXAMPLES) else answers.like  # each unit's own import holds a form of text to it
    values = TableReader(paths[0], replace(answers, like=like), picking=column).values_of(column)
    made: list[Imported] = []
    with folder_whole(out) as work:
        for number, value in enumerate(values):
            own = replace(answers, where=f"{column}={value}")
            made.append(convert(paths, work / f"unit{number}", own, serial=f"{column}-{value}", columns=columns))
        folders = ", ".join(f'"unit{number}"' for number in range(len(values)))
        write_new(work / "session.toml", f'schema = "tinygc-session/1"\n\n[array]\nfolders = [{folders}]\n')
        read_array(work)
    notes = tuple(f"{', '.join(names)}: {note}" for note, names in _once((note, each) for each in made for note in each.notes))
    # A finding on a unit's whole session is one on its folder.
    within = ((replace(finding, where=finding.where.removeprefix(each.folder.name)), each) for each in made for finding in each.findings)
    findings = tuple(replace(found, where=f"{', '.join(names)} {found.where}".strip()) for found, names in _once(within))
    units = ", ".join(f"{column}={value} is {each.folder.name}" for value, each in zip(values, made, strict=True))
    samples = sum(each.samples for each in made)
    steps = (command_line("check", out), command_line("fit", out))
    return Imported(out, out, made[0].dialects, samples, notes, findings, steps, (*made[0].took, units))


def _once(stated: Iterable[tuple[Stated, Imported]]) -> Iterable[tuple[Stated, list[str]]]:
    """What holds of several units once, with the names of those units."""
    units: dict[Stated, list[str]] = {}
    for what, unit in stated:
        units.setdefault(what, []).append(unit.folder.name)
    return units.items()
