"""Output of results to standard output and of progress to standard error, as plain text where there is no terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from session.bench.console import PlainConsole

#: columns of a table in a pipe: wide enough that no cell wraps
PIPED_WIDTH = 160


class _Output(PlainConsole):
    """A console that raises on a broken pipe: rich would exit with code 1, which here means a failed limit."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError

    def print(self, *objects: Any, **settings: Any) -> None:
        try:
            super().print(*objects, **settings)
        except OSError as error:
            error.filename = "standard output"  # errors of a stream have no file name
            raise


def output(quiet: bool = False) -> PlainConsole:
    """Return standard output; silent when quiet."""
    return _Output(quiet=quiet, width=None if sys.stdout.isatty() else PIPED_WIDTH)


@contextmanager
def progress_bar(quiet: bool = False) -> Iterator[Callable[[str, int, int], None]]:
    """Yield a callback ``(what, done, of)`` that draws a bar on standard error; without a terminal it prints one line per step."""
    if quiet:
        yield lambda what, done, of: None
        return
    console = PlainConsole(stderr=True)
    if not console.is_terminal:
        yield _Lines(console)
        return
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("", total=1)
        yield lambda what, done, of: bar.update(task, description=what, completed=done, total=of)


class _Lines:
    """Progress as one line per step, not per update."""

    def __init__(self, console: PlainConsole):
        self._console, self._last = console, ""

    def __call__(self, what: str, done: int, of: int) -> None:
        if what != self._last:
            self._console.print(f"{what} …", soft_wrap=True)
            self._last = what
