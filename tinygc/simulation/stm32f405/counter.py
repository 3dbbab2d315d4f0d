"""Unicorn counts the instructions that it runs, but has no function that tells: where in its engine the count is.

``emu_start(count=…)`` keeps two numbers side by side in its ``uc_struct``: the instructions begun, and how many it was given.  Two short
runs of no-operations with different counts show where.  The first is the clock of everything here; writing the second ends a run early,
after any instruction, at no cost.  Where the place cannot be found there is no emulator, rather than a wrong clock.
"""

from __future__ import annotations

import ctypes
from typing import Any

WORDS = 500  #: of the engine's struct that are looked at; it is longer by far
RUNS = (1237, 389)


class Counter:
    """begun, given: instructions of the present or the last run of an engine; both stand at ``place`` of its ``words``."""

    def __init__(self, engine: Any, place: int):
        self.words = (ctypes.c_size_t * (place + 2)).from_address(engine._uch.value)
        self.place = place

    @property
    def begun(self) -> int:
        """Instructions, the one at hand among them."""
        return self.words[self.place]

    @property
    def given(self) -> int:
        """Instructions after which it stops."""
        return self.words[self.place + 1]

    @given.setter
    def given(self, instructions: int) -> None:
        self.words[self.place + 1] = instructions


def find(engine: Any, address: int) -> int:
    """The place of the count in an engine that can run ``max(RUNS)`` no-operations from an address on.

    Raises RuntimeError where there is none, or more than one.
    """
    candidates = set(range(WORDS - 1))
    for count in RUNS:
        engine.emu_start(address | 1, 0, count=count)
        words = (ctypes.c_size_t * WORDS).from_address(engine._uch.value)
        candidates = {place for place in candidates if words[place] == count + 1 and words[place + 1] == count}
    if len(candidates) != 1:
        raise RuntimeError("this version of Unicorn keeps its count elsewhere: expected that of constraints.txt")
    return candidates.pop()
