"""Ctrl-C at a good moment: between two steps of a loop, not in the middle of what one of them does."""

from __future__ import annotations

import contextlib
import signal
from types import FrameType
from typing import Any

SIGNALS = (signal.SIGINT, signal.SIGTERM)
PATIENCE = 3  #: who asks so often is obeyed at once


class Interruption:
    """A context.  Call it: whether somebody wants to end."""

    def __init__(self) -> None:
        self._asked = 0
        self._before: dict[signal.Signals, Any] = {}  # what a signal did before: a function, or the system's own number for it

    def __call__(self) -> bool:
        return self._asked > 0

    def __enter__(self) -> Interruption:
        with contextlib.suppress(ValueError):  # not the main thread: nobody interrupts it
            for number in SIGNALS:
                self._before[number] = signal.signal(number, self._ask)
        return self

    def __exit__(self, *error: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self._asked += 1
        if self._asked >= PATIENCE:
            raise KeyboardInterrupt
