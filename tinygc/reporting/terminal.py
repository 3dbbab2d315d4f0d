"""The terminal: console, tables, progress; plain text, and HTML for a notebook.  Other rooms take rich from here."""

from __future__ import annotations

import io
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Group as Group
from rich.console import RenderableType as RenderableType
from rich.text import Text as Text

from session.base.console import PlainConsole as PlainConsole
from session.base.console import one_line as one_line

#: columns of a screen, where its width is not known: in a pipe, in Python
COLUMNS = 80


class _Output(PlainConsole):
    """A console that names the stream where a write failed."""

    def print(self, *objects: Any, **settings: Any) -> None:
        try:
            super().print(*objects, **settings)
        except OSError as error:
            error.filename = "standard output"  # errors of a stream have no file name
            raise


def output(quiet: bool = False) -> PlainConsole:
    """Return standard output; silent when quiet."""
    return _Output(quiet=quiet, width=None if sys.stdout.isatty() else COLUMNS)


@contextmanager
def progress_bar(quiet: bool = False) -> Iterator[Callable[[str, int, int], None]]:
    """Yield a callback ``(what, done, of)`` that draws a bar on standard error; without a terminal it prints one line per step."""
    if quiet:
        yield lambda what, done, of: None
        return
    console = PlainConsole(stderr=True)
    if not console.is_terminal:
        last = ""

        def print_step(what: str, done: int, of: int) -> None:
            nonlocal last
            if what != last:
                console.print(f"{what} …")
            last = what

        yield print_step
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn  # late: a pipe shows no bar

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=1)
        yield lambda what, done, of: bar.update(task, description=what, completed=done, total=of)


# Render a page as plain text, and as HTML for a notebook.

#: columns of a notebook
WIDE = 160
_HTML = '<pre style="font-family:ui-monospace,Menlo,Consolas,monospace;line-height:1.35;white-space:pre">{code}</pre>'


def as_text(page: RenderableType) -> str:
    """Render as plain lines, without colours and trailing blanks."""
    file = io.StringIO()
    PlainConsole(file=file, width=COLUMNS, no_color=True).print(page, soft_wrap=True)
    return "\n".join(line.rstrip() for line in file.getvalue().splitlines())


def as_html(page: RenderableType) -> str:
    """Render as HTML with colours, for a notebook."""
    console = PlainConsole(file=io.StringIO(), record=True, width=WIDE)
    console.print(page)
    return console.export_html(inline_styles=True, code_format=_HTML)
