"""Write a discovery: effect files, table, page, picture."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

from session import VERSION
from session.base.errors import FormatError
from session.base.files import MB, naming, read_bytes, result_folder
from session.base.results import write_text_whole
from session.base.texts import command_line, given_effects, printable
from session.base.units import DEG
from session.log.folder import file_key, hash_of_log
from tinygc.effects.catalogue import loaded_folders
from tinygc.explanation.engine import Explanation
from tinygc.features.discovery.effect_file import Where, written
from tinygc.features.discovery.law_fits import Pair, is_open, next_of, pairs_of
from tinygc.features.discovery.pictures import picture_of
from tinygc.features.discovery.result import discovery_facts, to_json
from tinygc.features.discovery.search_state import Discovery, Law
from tinygc.features.discovery.selection import FORM
from tinygc.library.explanations import Why
from tinygc.reporting.drawing import Picture
from tinygc.reporting.explanation_text import headline, next_line
from tinygc.reporting.facts import Part

# Save laws as effect files in a folder whose earlier files may have been edited; no edit is ever lost.
#
# A file's last line has the hash of the text above it.  A file with the right hash is this tool's own: the next run replaces it, or deletes
# it where its law was not found again.  Any other file is a user's and stays; a law that needs its name gets another.

#: folder of a session's ``explain``
FOLDER = "effects"
SEAL = "# Written by calibrate.py explain --discover.  Edit it as you like: an edited file is never replaced.  sha256 of the lines above: "
LAST = re.compile(re.escape(SEAL) + r"([0-9a-f]{64})\n")
#: bytes of a file that is read; ours have some kB
MOST_EFFECT = MB


def save_laws(laws: Sequence[Law], where: Where, folder: Path) -> tuple[list[Path], list[str]]:
    """Write each law into the folder, and delete those that an earlier run wrote and this one did not find: files in order, and notes.

    Without a law no folder is made; an existing one remains only if it holds a user's files.  Raises StorageError, or an OSError with the
    file's name, where it cannot be written.
    """
    own = sorted(path for path in folder.glob("discovered_*.py") if is_own(path)) if folder.is_dir() else []
    # Effects loaded with --effects were part of the catalogue for this search, which looked for other laws.
    named = folder.resolve() in [each.resolve() for each in loaded_folders()]
    earlier = [] if named else own
    files: list[Path] = []
    notes = [f"{printable(str(path))} was named with --effects, and is kept" for path in own if named]
    if laws:
        with result_folder(folder):
            for law in laws:
                first = law.effect.id.removeprefix(FORM)
                name = _free(folder, first, earlier, files)
                files.append(folder / f"discovered_{name}.py")
                text = written(law, where, name)
                write_text_whole(files[-1], f"{text}\n{SEAL}{_digest(text)}\n")
                if name != first and folder / f"discovered_{first}.py" not in files:
                    kept = printable(f"{folder / f'discovered_{first}.py'}")
                    now = f"the law that was found now is in {files[-1].name}; move one of the two away before --effects"
                    notes.append(f"{kept} is not as it was written, and is kept; {now}")
    for path in earlier:
        if path not in files:
            with naming(path):
                path.unlink()
            notes.append(f"{printable(str(path))} of an earlier run is taken away: its law was not found again")
    if not laws:
        with contextlib.suppress(OSError):
            folder.rmdir()
    return files, notes


def _free(folder: Path, name: str, earlier: list[Path], taken: list[Path]) -> str:
    """The first of name, name_2, name_3, … that is neither a user's file nor written in this run."""
    number, tried = 1, name
    while True:
        path = folder / f"discovered_{tried}.py"
        if path not in taken and (path in earlier or not os.path.lexists(path)):
            return tried
        number += 1
        tried = f"{name}_{number}"


def is_own(path: Path) -> bool:
    """Whether a file is unchanged since this tool wrote it; False for a link or an unreadable file."""
    try:
        if path.is_symlink():
            return False
        text = read_bytes(path, MOST_EFFECT).decode().replace("\r\n", "\n")  # Windows line ends
    except (FormatError, UnicodeDecodeError):
        return False
    above, _, last = text.removesuffix("\n").rpartition("\n")
    found = LAST.fullmatch(f"{last}\n")
    return found is not None and found[1] == _digest(above) and text.endswith("\n")


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


# An explanation together with its discovery: table, terminal page, picture, files.


class DiscoveryReport(Why):
    """The outputs of an explanation and its discovery, each computed once."""

    def __init__(self, explanation: Explanation, discovery: Discovery):
        super().__init__(explanation)
        self.beyond: Discovery = discovery
        #: of each law, relative to the folder of the explanation; None until they are saved
        self._files: list[str | None] = [None for _ in discovery.laws]

    @cached_property
    def pairs(self) -> list[Pair]:
        """Each law and its runner-up, refitted."""
        return pairs_of(self.explanation, self.beyond)

    @cached_property
    def _following(self) -> str | None:
        pairs = self.pairs if any(map(is_open, self.beyond.laws)) else []
        return next_of(self.explanation, self.beyond, pairs)

    @cached_property
    def table(self) -> dict:
        """``tinygc-explain/2``, with the search's advice on what to do next."""
        return super().table | {"next": self._following, "discovery": to_json(self.beyond, self._files)}

    def offers(self, folder: Path, effects: Sequence[Path] = ()) -> list[tuple[str, list[str]]]:
        """What to do next, with the laws in another session."""
        use = command_line("explain", "OTHER", *given_effects([*effects, folder / "effects"]))
        return [(next_line(self.explanation, self.next), [use])] if self.beyond.laws else super().offers(folder, effects)

    def parts(self, brief: bool = False) -> list[Part]:
        """Its facts, without what to do next; brief: those of the command's first screen."""
        if brief:
            return [*discovery_facts(self.table["discovery"], brief=True), "", "From the catalogue:", *headline(self.explanation)]
        return [*super().parts(), "", *discovery_facts(self.table["discovery"])]

    def discovered(self) -> Picture:
        """``discover.svg``, for an answer with laws."""
        return picture_of(self.explanation, self.beyond, self.pairs)

    def save(self, folder: Path | str | None = None, pictures: bool = True) -> Path:
        """Save the explanation's files, an effect file for each law, and the picture of them; return the folder.

        An edited file stays; ``notes`` has the alternative taken.  Raises what ``Why.save`` raises.
        """
        session = self.explanation.session
        folder = session.own_folder("explain") if folder is None else Path(folder)
        logs = {file_key(log.path): hash_of_log(log) for log in session.logs}
        movement = self.explanation.twin.movements[0]
        where = Where(session.name, logs, VERSION, movement.fs_rps / DEG, movement.first_temp_c)
        files, notes = save_laws(self.beyond.laws, where, folder / FOLDER)
        self._files, self.notes = [f"{FOLDER}/{path.name}" for path in files], tuple(notes)
        self.__dict__.pop("table", None)  # it names the effect files
        super().save(folder, pictures)
        if pictures and self.beyond.laws:
            self.discovered().save(folder / "discover.svg")
        else:  # a picture of an earlier run shows another answer
            with naming(folder / "discover.svg"):
                (folder / "discover.svg").unlink(missing_ok=True)
        return folder
