"""An explanation and the discovery beside it, told: one table, the page of the terminal, the picture, the files."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

from rich.console import Group
from rich.text import Text

from session.files.results import write_text_whole
from session.files.writing import result_folder
from tinygc.discovery.judge.answer import Discovery
from tinygc.discovery.told.as_json import to_json
from tinygc.discovery.told.effect_file import effect_file
from tinygc.discovery.told.fits import Pair, pairs_of
from tinygc.discovery.told.next_step import next_of
from tinygc.discovery.told.page import discovery_page
from tinygc.discovery.told.pictures import figure_of
from tinygc.explanation.pictures.canvas import save as save_figure
from tinygc.explanation.save import save_explanation
from tinygc.explanation.verdict import result
from tinygc.explanation.verdict.explain import Explanation
from tinygc.explanation.verdict.pages import explanation_page

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: of the folder of an explanation: what ``--effects`` is given
EFFECTS = "effects"


class Told:
    """What is made of both, each once."""

    def __init__(self, explanation: Explanation, discovery: Discovery):
        self.explanation, self.discovery = explanation, discovery

    @cached_property
    def pairs(self) -> list[Pair]:
        """Each law refitted, beside its runner-up."""
        return pairs_of(self.explanation, self.discovery)

    @cached_property
    def table(self) -> dict:
        """``tinygc-explain/1``.  What to do next is what the search asks for."""
        open_ = any(law.runners_up for law in self.discovery.laws)
        following = next_of(self.explanation, self.discovery, self.pairs if open_ else [])
        return result.to_json(self.explanation) | {"next": following, "discovery": to_json(self.discovery, self._names)}

    @property
    def page(self) -> Group:
        """What the terminal shows: the explanation, then the search, which has the last word on what to do next."""
        return Group(explanation_page(self.explanation, with_next=False), Text(""), discovery_page(self.table))

    def figure(self) -> Figure:
        """``discover.png``, of an answer with laws.  CalibrationError without matplotlib."""
        return figure_of(self.explanation, self.discovery, self.pairs)

    def save(self, folder: Path | None = None, pictures: bool = True) -> Path:
        """``save_explanation`` with the whole table, an effect file for each law, and the picture of them; returns the folder.

        What earlier searches wrote stays where it is: somebody may use it.  Raises what ``save_explanation`` raises.
        """
        folder = save_explanation(self.explanation, folder, pictures, self.table)
        if not self.discovery.laws:
            return folder
        with result_folder(folder / EFFECTS):
            for law, name in zip(self.discovery.laws, self._names, strict=True):
                write_text_whole(folder / name, effect_file(self.explanation, self.discovery, law))
        if pictures:
            save_figure(self.figure(), folder / "discover.png")
        return folder

    @property
    def _names(self) -> list[str]:
        """Of each law's file, relative to the folder of the explanation."""
        return [f"{EFFECTS}/{law.effect.id.replace('.', '_')}.py" for law in self.discovery.laws]
