"""The coach in a thread of its own: it gets what the session has so far, and a recording never waits for its word."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor

from session.guide.guide import Guide
from session.guide.messages import Advice, Change, Kind, Progress

Coach = Callable[[Progress], Advice]


class CoachThread:
    """coach: None where there is none, or where it has failed."""

    def __init__(self, coach: Coach | None) -> None:
        self._coach = coach
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="coach")
        self._asked: Future[Advice] | None = None
        self._asked_at = 0  # so many stills
        self._about: tuple[int, ...] = ()  # what it was asked about last

    def hear(self, guide: Guide) -> list[Change]:
        """Hand its last word to the guide, and give it what has come since.  Returns what that changes."""
        changes: list[Change] = []
        if self._asked is not None and self._asked.done():
            asked, self._asked = self._asked, None
            if (error := asked.exception()) is not None:  # whatever it is, it must not end a recording
                self._coach, guide.coached = None, False
                failed = f"the coach has failed ({type(error).__name__}: {error}); any turn will do"
                changes = [Change(Kind.WARNING, failed, guide.now_s)]
            else:
                changes = guide.advise(asked.result(), self._asked_at)
        if self._asked is None and self._behind(guide):
            self._about, self._asked_at = _about(guide), len(guide.taken.stills)
            if guide.taken.turns and self._coach is not None:
                self._asked = self._thread.submit(self._coach, guide.taken.progress)
            else:
                guide.advise(None)
        return changes

    def busy(self, guide: Guide) -> bool:
        """Whether it has not yet said its word on all that there is."""
        return self._asked is not None or self._behind(guide)

    def close(self) -> None:
        """What it thinks about is of no use any more."""
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _behind(self, guide: Guide) -> bool:
        return self._coach is not None and _about(guide) != self._about


def _about(guide: Guide) -> tuple[int, ...]:
    """Another turn that counts, or does not any more; another still, in which the board may lie elsewhere."""
    return (len(guide.taken.stills), *map(id, guide.taken.turns)) if guide.taken.stills else ()
