"""What was decided at the table while bytes came: an event in ``raw.times`` each, so that a replay decides the same at the same byte.

``begin STEM``: samples from here on go to a new ``STEM*.csv``.  ``pause``: they go to no log.  ``keep STEM``: the file that was begun last
is whole, and bears this name; behind it they go to no log.  ``drop T_US``: the turn that moved at this device time does not count.
``note TEXT``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from session.recording.rawfile import Mark


@dataclass(frozen=True)
class Decision:
    """word: begin, pause, keep, drop or note; rest: STEM, T_US, TEXT, or nothing; log: the one that was growing, in a replay."""

    word: str
    rest: str = ""
    log: str = ""

    @property
    def text(self) -> str:
        """As raw.times holds it."""
        return f"{self.word} {self.rest}".rstrip()


def decision_of(mark: Mark) -> Decision | None:
    """The decision that a mark tells of; None for any other, and for one that makes no sense."""
    word, _, rest = mark.event.partition(" ")
    right = {
        "begin": rest.isidentifier(),
        "keep": rest.isidentifier(),
        "drop": rest.isascii() and rest.isdigit(),
        "pause": True,
        "note": True,
    }
    return Decision(word, rest) if right.get(word, False) else None


def name_kept(marks: Sequence[Mark], begun: int) -> str | None:
    """The stem under which the file that marks[begun] begins was kept in the end; None where it was not."""
    for mark in marks[begun + 1 :]:
        decision = decision_of(mark)
        if decision is not None and decision.word == "keep":
            return decision.rest
        if mark.event.startswith("open") or (decision is not None and decision.word in ("begin", "pause")):
            return None
    return None
