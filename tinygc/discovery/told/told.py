"""An explanation and the discovery beside it, told: one table, the page of the terminal, the picture, the files."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Group
from rich.text import Text

from session.common.units import DEG
from session.common.version import VERSION
from session.files.writing import naming
from session.log.hashes import file_key, hash_of_log
from tinygc.discovery.judge.answer import Discovery
from tinygc.discovery.told.as_json import to_json
from tinygc.discovery.told.effect_folder import FOLDER, save_laws
from tinygc.discovery.told.evidence_text import Where
from tinygc.discovery.told.fits import Pair, pairs_of
from tinygc.discovery.told.next_step import is_open, next_of
from tinygc.discovery.told.page import discovery_page
from tinygc.discovery.told.pictures import figure_of
from tinygc.explanation.pictures.canvas import save as save_figure
from tinygc.explanation.save import save_explanation
from tinygc.explanation.verdict import result
from tinygc.explanation.verdict.explain import Explanation
from tinygc.explanation.verdict.pages import explanation_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Told:
    """What is made of both, each once."""

    def __init__(self, explanation: Explanation, discovery: Discovery):
        self.explanation, self.discovery = explanation, discovery
        #: of each law, relative to the folder of the explanation; None until they are saved
        self._files: list[str | None] = [None for _ in discovery.laws]
        #: lines for whoever looks for the files
        self.says: tuple[str, ...] = ()

    @cached_property
    def pairs(self) -> list[Pair]:
        """Each law refitted, beside its runner-up."""
        return pairs_of(self.explanation, self.discovery)

    @cached_property
    def _following(self) -> str | None:
        pairs = self.pairs if any(map(is_open, self.discovery.laws)) else []
        return next_of(self.explanation, self.discovery, pairs)

    @property
    def table(self) -> dict:
        """``tinygc-explain/1``.  What to do next is what the search asks for."""
        return result.to_json(self.explanation) | {"next": self._following, "discovery": to_json(self.discovery, self._files)}

    @property
    def page(self) -> Group:
        """What the terminal shows: the explanation, then the search, which has the last word on what to do next."""
        return Group(explanation_page(self.explanation, with_next=False), Text(""), discovery_page(self.table))

    def figure(self) -> Figure:
        """``discover.png``, of an answer with laws.  CalibrationError without matplotlib."""
        return figure_of(self.explanation, self.discovery, self.pairs)

    def save(self, folder: Path | None = None, pictures: bool = True) -> Path:
        """``save_explanation`` with the whole table, an effect file for each law, and the picture of them; returns the folder.

        A file that somebody has edited stays; ``says`` tells what was done instead.  Raises what ``save_explanation`` raises.
        """
        folder = folder or self.explanation.session.own_folder("explain")
        saved = save_laws(self.discovery.laws, self._where(), folder / FOLDER)
        self._files, self.says = [f"{FOLDER}/{path.name}" for path in saved.files], saved.says
        save_explanation(self.explanation, folder, pictures, self.table)
        if pictures and self.discovery.laws:
            save_figure(self.figure(), folder / "discover.png")
        else:  # that of an earlier run shows another answer
            with naming(folder / "discover.png"):
                (folder / "discover.png").unlink(missing_ok=True)
        return folder

    def _where(self) -> Where:
        session = self.explanation.session
        logs = {file_key(log.path): hash_of_log(log) for log in session.logs}
        movement = self.explanation.twin.movements[0]
        return Where(session.name, logs, VERSION, movement.fs_rps / DEG, movement.first_temp_c)
