"""The closure run after the last segment: onto the index mark, still, turn freely, back onto the same mark, still.

It is driven by blocks, like the guide.  ``wants`` is the request to begin or keep a file; ``run_ends`` decides whether a run is complete,
as it will in ``fit``.
"""

from __future__ import annotations

from enum import Enum

from session.base.units import DEG, NS
from session.bench.events import Event
from session.bench.live import TurnInProgress
from session.bench.messages import Instruction, Kind, Stage
from session.detect.segments import RETURN_RAD, run_ends
from session.detect.stills import MIN_STILL_FRACTION, find_stills
from session.log.config import Protocol, Sensor
from session.log.samples import Samples, joined

WAIT_S = 8.0  #: a table that is untouched for so long is on its mark
#: shortest still at either end, as a part of the planned time: the noise is measured on the quietest twentieth of a log
STILL_PART = 0.05
ENOUGH_PART = 0.8  #: of the planned time: a shorter run determines less
AGAIN_S = 10.0  #: a still of this length away from the mark makes its place the new mark
STIR_RAD = 2.0 * DEG
BEGIN, KEEP = Event("begin", text="unclosed"), Event("keep", text="closure")
MARK_WORDS = "set the table onto its index mark, then hands off"


class Step(Enum):
    """Stage of a closure run."""

    MARK = "onto the mark"
    STAY = "stay"
    RUN = "turn freely"
    WHOLE = "whole"


class ClosureGuide:
    """Guides a run with planned_s of turning.  wants: the request for the files, until ``decided``; says: messages for the guide."""

    def __init__(self, sensor: Sensor, protocol: Protocol, hold_s: float, planned_s: float):
        self._sensor, self._protocol, self.planned_s = sensor, protocol, planned_s
        self.hold_s = max(hold_s, STILL_PART * planned_s)
        self.wants: Event | None = None
        self.says: list[tuple[Kind, str]] = []
        self._examined = self._went = False
        self._parts: list[Samples] = []
        self._to_the_mark()

    def decided(self, decision: Event) -> None:
        """The request was carried out: a new file has begun, or the last one is kept."""
        self.wants = None
        if decision.kind == "begin":
            self.step = Step.STAY
            self._parts, self._moved_s, self._rested_s, self._here_s = [], 0.0, 0.0, 0.0
        elif decision.kind == "keep":
            self.step = Step.WHOLE

    def interrupted(self) -> None:
        """A new log, a pause, or the operator ends the run before it is complete."""
        if self.step in (Step.STAY, Step.RUN):
            self.says.append((Kind.WARNING, "this closure run is not complete, and restarts"))
        self._to_the_mark()

    def on_the_mark(self) -> None:
        """The operator confirms that the table is on its mark."""
        if self.step is Step.MARK:
            self._here_s = WAIT_S

    def feed(self, samples: Samples, block_s: float, turn: TurnInProgress) -> None:
        """Take a block of samples, after the turn in progress has."""
        if self.step is Step.MARK:
            self._went = self._went or turn.path_rad > STIR_RAD
            self._here_s = 0.0 if turn.moving else self._here_s + block_s
            if turn.still_s >= self.hold_s and (self._went or self._here_s >= WAIT_S):
                self.wants = BEGIN
        elif self.step in (Step.STAY, Step.RUN):
            self._parts.append(samples)
            if self.step is Step.STAY:
                self._staying(block_s, turn)
            else:
                self._running(block_s, turn)

    def instruction(self, turn: TurnInProgress) -> Instruction:
        """What to do now, and why the guide waits."""
        if self.step is Step.MARK:
            why = f"{'it moves' if turn.moving else f'still for {turn.still_s:.1f} s'}; if it stands there already, leave it alone"
            return Instruction(Stage.CLOSURE, f"closure run: {MARK_WORDS}", why, good=not turn.moving)
        if self.step is Step.STAY:
            left = max(self.hold_s - self._rested_s, 0.0)
            why = f"the run's first still: {self._rested_s:.1f} of {self.hold_s:.1f} s"
            return Instruction(Stage.CLOSURE, "on the mark: hands off the table", why, left, 1 - left / self.hold_s)
        went = f"{self._moved_s:.0f} of {self.planned_s:.0f} s"
        if not self.enough:
            left, part = max(self.planned_s - self._moved_s, 0.0), min(self._moved_s / self.planned_s, 1.0)
            return Instruction(
                Stage.CLOSURE, "turn freely, through many attitudes, about all axes", f"{went}; rests do no harm", left, part
            )
        if turn.moving or not turn.still_s:
            return Instruction(Stage.CLOSURE, "now back onto the same index mark, then hands off", f"{went}: enough")
        why = self._missing or f"still for {turn.still_s:.1f} of {self.hold_s:.1f} s"
        held = min(turn.still_s, self.hold_s)
        left = max(self.hold_s - held, 0.0)
        return Instruction(Stage.CLOSURE, "back on the mark: hands off the table", why, left, held / self.hold_s, not self._missing)

    @property
    def enough(self) -> bool:
        """Whether there was so much turning that the table may go back onto its mark."""
        return self._moved_s >= ENOUGH_PART * self.planned_s

    def _to_the_mark(self) -> None:
        self.step, self.wants = Step.MARK, None
        self._parts = []
        self._moved_s = self._rested_s = self._here_s = 0.0
        self._went = False
        self._missing = ""

    def _staying(self, block_s: float, turn: TurnInProgress) -> None:
        if not turn.moving:
            self._rested_s += block_s
            if self._rested_s >= self.hold_s:
                self.step = Step.RUN
                self.says.append((Kind.READY, f"turn freely for {self.planned_s:.0f} s through many attitudes, then back onto the mark"))
        elif turn.still_s == 0.0:
            if self._rested_s >= MIN_STILL_FRACTION * self.hold_s:
                self.step = Step.RUN
                return
            self.says.append((Kind.WARNING, f"too short a still, {self._rested_s:.1f} of {self.hold_s:.1f} s: {MARK_WORDS}"))
            self._to_the_mark()

    def _running(self, block_s: float, turn: TurnInProgress) -> None:
        if turn.path_rad > STIR_RAD or self._moved_s:
            self._moved_s += block_s
        if turn.moving or turn.still_s < self.hold_s:
            self._missing, self._examined = "", False
            return
        if self._moved_s and not self._examined:
            self._examined = True
            self._examine()
        if self._missing and turn.still_s >= AGAIN_S:
            self.says.append((Kind.WARNING, "it stays there: that is the mark now, and the run restarts"))
            self._to_the_mark()
            self._here_s = WAIT_S

    def _examine(self) -> None:
        """The table rests: decide whether the run is complete."""
        samples = joined(self._parts)
        ends = run_ends(samples, find_stills(samples, self._protocol.still_s)[0], self._sensor)
        if ends is not None and ends.broken:
            self.says.append((Kind.REJECTED, f"this closure run is not complete: {ends.broken}; it restarts from here"))
            self._to_the_mark()
            self._here_s = WAIT_S
        elif ends is None or not self.enough:
            self.says.append((Kind.STAGE, f"{self._moved_s:.0f} of {self.planned_s:.0f} s: turn on"))
        elif not ends.returned:
            self._missing = f"{ends.away_rad / DEG:.1f}° from where the run began, {RETURN_RAD / DEG:g}° at most: set it back onto the mark"
            self.says.append((Kind.WARNING, self._missing))
        else:
            self.wants = KEEP
            turned_s = float(samples.t_ns[ends.last.start] - samples.t_ns[ends.first.stop - 1]) * NS
            self.says.append((Kind.ACCEPTED, f"closure run: {turned_s:.0f} s, back within {ends.away_rad / DEG:.2f}°"))
