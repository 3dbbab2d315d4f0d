"""The console for everything that people read: quoted names of files, folders and boards are plain text.

rich would interpret markup and emoji names in a string, and pass escape sequences through to the terminal.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.text import Text

from session.base.texts import printable


def one_line(text: str, style: str = "", end: str = "") -> Text:
    """A line that quotes names; end: for example a line break between paragraphs."""
    return Text(printable(text) + end, style)


class PlainConsole(Console):
    """No markup; a string is one line, a ``Text`` keeps its lines; unprintable characters are shown as escapes (``printable``).  Lines wrap
    on a terminal alone, between words; one with a longer word, such as a path, is left to the terminal, so that it can be copied."""

    def __init__(self, **settings: Any):
        super().__init__(highlight=False, markup=False, emoji=False, **settings)

    def print(self, *objects: Any, **settings: Any) -> None:
        """Print."""
        super().print(*objects, **{"crop": False, "soft_wrap": not self.is_terminal} | settings)

    def render_str(self, text: str, **settings: Any) -> Text:
        """Render a string as one line."""
        return super().render_str(printable(text), **settings)

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        """Escape everything but rich's own control sequences, which are segments of their own."""
        options = options or self.options
        if isinstance(renderable, Text) and max(map(len, renderable.plain.split()), default=0) > options.max_width:
            options = options.update(no_wrap=True, overflow="ignore")
        for segment in super().render(renderable, options):
            if segment.control or segment.text == "\n" or segment.text.isprintable():
                yield segment
            else:
                lines = segment.text.split("\n")
                yield Segment("\n".join(map(printable, lines)), segment.style)
