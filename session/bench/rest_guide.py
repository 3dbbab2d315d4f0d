"""A rest that is recorded (``noise record``): nothing is turned, and the operator sees how long is enough.

The guide of a rest is driven as the guide of turns is: by samples, in blocks of 0.1 s, by messages about the port and by decisions.  Its
samples go to ``rest*.csv``.  What they show of the noise so far is estimated elsewhere, by the ``RestFigures`` that are given.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol as Interface

from session.bench.events import Event
from session.bench.guide import REST, Guide
from session.bench.live import CEILING_S, MotionBlock, Stillness
from session.bench.messages import Instruction, Kind, Stage
from session.log.config import Protocol
from session.log.samples import Samples

#: between two warnings that the board moves: a table that trembles all night makes a page of them, not a hundred
WARN_EVERY_S = 600.0
#: blocks, 2 min, that show the sensor's noise: of a rest nearly all are calm, and a night of it is to be replayed within minutes
MEMORY_BLOCKS = 1200


@dataclass(frozen=True)
class RestAnswer:
    """What a rest has shown so far.  lines: for the operator, the first of them states how long is enough; known: whether it is enough."""

    lines: tuple[str, ...]
    known: bool = False


class RestFigures(Interface):
    """Estimates the noise while the rest goes on.  It must not block: ``add`` is called between two reads of the port."""

    def add(self, samples: Samples) -> None:
        """Take the next samples of the present log, SI."""

    def new_log(self) -> None:
        """The samples that follow do not continue those before."""

    def answer(self) -> RestAnswer | None:
        """Return a new answer; None where nothing has changed."""


class RestGuide(Guide):
    """Records a rest of rest_s (None: until the operator ends it); ``stop_at_target`` ends it as soon as the figures are known."""

    stem, takes_a_log, of_a_pause = REST, True, "and belong to no rest"

    def __init__(
        self, protocol: Protocol, rest_s: float | None = None, figures: RestFigures | None = None, stop_at_target: bool = False
    ) -> None:
        self.rest_s, self._figures = rest_s, figures
        self.rested_s = self.moved_s = 0.0  #: rest that is recorded, and how much of it was no rest
        self.answer = RestAnswer(())
        self._warned_s = -WARN_EVERY_S
        super().__init__(protocol, 0, stop_at_target)

    @property
    def so_far(self) -> str:
        """The recorded rest in words."""
        return f"{in_words(self.rested_s)} of rest"

    @property
    def enough(self) -> bool:
        """Whether the operator may finish: at any time of a rest."""
        return self.stage is Stage.HOLD_STILL

    def resumes(self) -> bool:
        """Whether a resumed rest goes on."""
        self._more()
        return super().resumes()

    def new_log(self) -> None:
        """The device's clock has restarted, and with it a log."""
        self._more()
        super().new_log()
        if self._figures is not None:
            self._figures.new_log()

    def _do(self, decision: Event) -> None:
        if decision.kind == "finish":
            self._finish()

    @property
    def instruction(self) -> Instruction:
        """What to do now: to leave the board alone."""
        if self.stage is Stage.DONE:
            return Instruction(self.stage, "done: the board may be taken away", self.so_far)
        if self.stage is not Stage.HOLD_STILL:
            return super().instruction
        do = "enough: finish now, or let it rest on" if self.answer.known else "a rest: leave the board alone, and the table too"
        why = self.answer.lines[0] if self.answer.lines else self.so_far
        if self.rest_s is None:
            return Instruction(self.stage, do, why)
        return Instruction(self.stage, do, why, max(self.rest_s - self.rested_s, 0.0), min(self.rested_s / self.rest_s, 1.0))

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Name and text of the screen's rows that a guide of turns does not have."""
        planned = "" if self.rest_s is None else f" of {in_words(self.rest_s)}"
        moved = f"; it moved for {in_words(self.moved_s)}" if self.moved_s else ""
        return [("rest", f"{in_words(self.rested_s)}{planned}{moved}"), *(("noise", line) for line in self.answer.lines)]

    def _stream_is_good(self) -> bool:
        good = super()._stream_is_good()
        if good:
            self.here.stillness = Stillness(self.here.pending.period_s, MEMORY_BLOCKS)
        return good

    def _more(self) -> None:
        """Samples come after the operator had finished: the rest was resumed."""
        if self.stage is Stage.DONE and (self.rest_s is None or self.rested_s < self.rest_s):
            self.stage = Stage.CHECK_STREAM

    def _block(self, samples: Samples) -> None:
        block, _ = self.here.take(samples, remember=False)
        self.rested_s += block.duration_s
        if not block.quiet and self.here.now_s > CEILING_S:  # before, the sensor's own noise is not known
            self._moves(block)
        if self._figures is not None:
            self._figures.add(samples)
            if (answer := self._figures.answer()) is not None:
                before, self.answer = self.answer, answer
                for line in answer.lines:
                    self._announce(Kind.STAGE, line)
                if answer.known and not before.known:
                    self._announce(Kind.READY, f"enough: {self.so_far} shows the noise as precisely as requested")
                    if self.stop_at_target:
                        self._finish()
        if self.rest_s is not None and self.rested_s >= self.rest_s:
            self._finish()

    def _moves(self, block: MotionBlock) -> None:
        self.moved_s += block.duration_s
        if self.rested_s - self._warned_s >= WARN_EVERY_S:
            self._warned_s = self.rested_s
            self._announce(Kind.WARNING, f"it moves: {block.why}; a floor without steps, machines and draught is a better place")


def in_words(seconds: float) -> str:
    """Format a duration: ``42 s``, ``12 min``, ``3.1 h``."""
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
