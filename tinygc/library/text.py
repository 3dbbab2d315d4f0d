"""What a terminal would show, as text and for a notebook."""

from __future__ import annotations

import io

from rich.console import RenderableType

from session.common.console import PlainConsole

#: columns: wide enough that no cell of a table wraps
WIDTH = 160
_HTML = '<pre style="font-family:ui-monospace,Menlo,Consolas,monospace;line-height:1.35;white-space:pre">{code}</pre>'


def as_text(page: RenderableType) -> str:
    """Plain lines, without colours and without blanks at their ends."""
    file = io.StringIO()
    PlainConsole(file=file, width=WIDTH, no_color=True).print(page)
    return "\n".join(line.rstrip() for line in file.getvalue().splitlines())


def as_html(page: RenderableType) -> str:
    """The same with its colours, for a notebook."""
    console = PlainConsole(file=io.StringIO(), record=True, width=WIDTH)
    console.print(page)
    return console.export_html(inline_styles=True, code_format=_HTML)
