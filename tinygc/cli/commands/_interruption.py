"""What ends a command: Ctrl-C, the end of the system's patience (SIGTERM), a terminal that goes (SIGHUP); in a recording at a good
moment, between two steps of its loop and not in the middle of what one of them does.

A hang-up that was ignored from the start stays so: ``nohup`` asks for that.  An interrupt that was ignored, as by a shell that started us
in the background, still ends what runs at a port until it is told to end.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

HANG_UP: signal.Signals | None = getattr(signal, "SIGHUP", None)  # Windows has none
PATIENCE = 3  #: who asks so often is obeyed at once


class Interruption:
    """A context.  Call it: whether somebody wants to end."""

    def __init__(self) -> None:
        self._asked = 0
        self._handled = contextlib.ExitStack()

    def __call__(self) -> bool:
        return self._asked > 0

    def __enter__(self) -> Interruption:
        self._handled.enter_context(_handled(self._ask, signal.SIGINT))
        return self

    def __exit__(self, *error: object) -> None:
        self._handled.close()

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self._asked += 1
        if number == HANG_UP:
            _let_go()
        if self._asked >= PATIENCE:
            raise KeyboardInterrupt


def ended_by_signals(ignored_interrupt: bool = False) -> contextlib.AbstractContextManager[None]:
    """A context in which SIGTERM and SIGHUP do what Ctrl-C does; and SIGINT too, where it was ignored and that does not count."""
    return _handled(_end, *([signal.SIGINT] if ignored_interrupt else []))


def _end(number: int, frame: FrameType | None) -> None:
    if number == HANG_UP:
        _let_go()
    raise KeyboardInterrupt


@contextlib.contextmanager
def _handled(handler: Callable[[int, FrameType | None], Any], *more: signal.Signals) -> Iterator[None]:
    before: dict[signal.Signals, Any] = {}  # what a signal did before: a function, or the system's own number for it
    with contextlib.suppress(ValueError):  # not the main thread: nobody interrupts it
        for number in (*more, signal.SIGTERM, *([HANG_UP] if HANG_UP is not None else [])):
            if number != HANG_UP or signal.getsignal(number) != signal.SIG_IGN:
                before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, earlier in before.items():
            signal.signal(number, signal.SIG_DFL if earlier is None else earlier)


def _let_go() -> None:
    """Write nowhere what was for a terminal that has gone: the last words must not fail."""
    for file in (1, 2):
        with contextlib.suppress(OSError, AttributeError):
            poll = select.poll()
            poll.register(file, 0)
            if any(events & (select.POLLHUP | select.POLLERR) for _, events in poll.poll(0)):
                nowhere = os.open(os.devnull, os.O_WRONLY)
                os.dup2(nowhere, file)
                os.close(nowhere)
