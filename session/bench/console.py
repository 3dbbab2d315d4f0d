"""The console that everything for people is printed on: what it quotes of files, folders and boards is text, and nothing else.

rich reads markup and emoji names in a string, and lets escape sequences through to the terminal, which obeys them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from session.io.texts import printable


def one_line(text: str, style: str = "", end: str = "") -> Text:
    """A line of a page that quotes names; end: what a page puts between its paragraphs, an empty line."""
    return Text(printable(text) + end, style)


class PlainConsole(Console):
    """No markup; a string is one line, a ``Text`` as many as it has; what is not printable is shown as escapes (``printable``)."""

    def __init__(self, **settings: Any):
        super().__init__(highlight=False, markup=False, emoji=False, **settings)

    def render_str(self, text: str, **settings: Any) -> Text:
        """What a string is shown as: one line."""
        return super().render_str(printable(text), **settings)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """What goes to the terminal; rich's own control sequences are segments of their own."""
        for segment in super().render(renderable, options):
            if segment.control or segment.text == "\n" or segment.text.isprintable():
                yield segment
            else:
                lines = segment.text.split("\n")
                yield Segment("\n".join(map(printable, lines)), segment.style)
