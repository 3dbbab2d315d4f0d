"""Laws as effect files in a folder, where a person may have edited what an earlier run wrote: no edit is ever lost.

A file's last line has the hash of what stands above it.  A file whose hash is right is this tool's own: the next run replaces it, or takes
it away where its law was not found again.  Any other file is a person's, and stays; a law that would have its name gets another.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from session.common.errors import FormatError
from session.common.texts import printable
from session.files.reading import MB, read_bytes
from session.files.results import write_text_whole
from session.files.writing import naming, result_folder
from tinygc.discovery.judge.answer import Law
from tinygc.discovery.judge.weigh import FORM
from tinygc.discovery.told.effect_file import written
from tinygc.discovery.told.evidence_text import Where
from tinygc.effects.discovery import loaded_folders

#: folder of a session's ``explain``
FOLDER = "effects"
SEAL = "# Written by calibrate.py explain --discover.  Edit it as you like: an edited file is never replaced.  sha256 of the lines above: "
LAST = re.compile(re.escape(SEAL) + r"([0-9a-f]{64})\n")
#: of a file that is looked at; ours have some kB
MOST_EFFECT = MB


@dataclass(frozen=True)
class Saved:
    """files: of each law, in order; says: a line for each thing that a person should know."""

    files: tuple[Path, ...]
    says: tuple[str, ...]


def save_laws(laws: Sequence[Law], where: Where, folder: Path) -> Saved:
    """Write each law into the folder, and take away what an earlier run wrote there and this one did not find.

    Without a law the folder is not made, and left only with what is a person's.  Raises StorageError, or an OSError with the file's name,
    where it cannot be written.
    """
    own = sorted(path for path in folder.glob("discovered_*.py") if is_own(path)) if folder.is_dir() else []
    # What was named with --effects was a name of the catalogue for this search: it looked for other laws.
    named = folder.resolve() in [each.resolve() for each in loaded_folders()]
    earlier = [] if named else own
    files: list[Path] = []
    says = [f"{printable(str(path))} was named with --effects, and is kept" for path in own if named]
    if laws:
        with result_folder(folder):
            for law in laws:
                first = law.effect.id.removeprefix(FORM)
                name = _free(folder, first, earlier, files)
                files.append(folder / f"discovered_{name}.py")
                write_text_whole(files[-1], sealed(written(law, where, name)))
                if name != first and folder / f"discovered_{first}.py" not in files:
                    kept = printable(f"{folder / f'discovered_{first}.py'}")
                    now = f"the law that was found now is in {files[-1].name}; move one of the two away before --effects"
                    says.append(f"{kept} is not as it was written, and is kept; {now}")
    for path in earlier:
        if path not in files:
            with naming(path):
                path.unlink()
            says.append(f"{printable(str(path))} of an earlier run is taken away: its law was not found again")
    if not laws:
        with contextlib.suppress(OSError):
            folder.rmdir()
    return Saved(tuple(files), tuple(says))


def _free(folder: Path, name: str, earlier: list[Path], taken: list[Path]) -> str:
    """The first of name, name_2, name_3, … that is no person's file and none of this run's."""
    number, tried = 1, name
    while True:
        path = folder / f"discovered_{tried}.py"
        if path not in taken and (path in earlier or not os.path.lexists(path)):
            return tried
        number += 1
        tried = f"{name}_{number}"


def sealed(text: str) -> str:
    """The text with its hash in a last line."""
    return f"{text}\n{SEAL}{_digest(text)}\n"


def is_own(path: Path) -> bool:
    """Whether a file is as this tool wrote it; a link, and what cannot be read, is not."""
    try:
        if path.is_symlink():
            return False
        text = read_bytes(path, MOST_EFFECT).decode().replace("\r\n", "\n")  # as Windows writes it
    except (FormatError, UnicodeDecodeError):
        return False
    above, _, last = text.removesuffix("\n").rpartition("\n")
    found = LAST.fullmatch(f"{last}\n")
    return found is not None and found[1] == _digest(above) and text.endswith("\n")


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()
