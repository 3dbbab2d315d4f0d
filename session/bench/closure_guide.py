"""The closure run after the last segment: onto the index mark, still, turn freely, back onto the same mark, still.

It lives on blocks, as the guide does.  What it wants done with the files it says in ``wants``; whether a run is whole is asked of
``session.detect.segments``, as ``fit`` will ask.
"""

from __future__ import annotations

from enum import Enum

from session.bench.live import TurnInProgress
from session.bench.messages import Instruction, Kind, Stage
from session.bench.rawfile import RecordingDecision
from session.detect.segments import RETURN_RAD, RunEnds, run_ends
from session.detect.stills import MIN_STILL_FRACTION, find_stills
from session.io.config import Protocol, Sensor
from session.io.samples import Samples, joined
from session.io.units import DEG, NS

WAIT_S = 8.0  #: untouched for so long, the table stands on its mark already
#: of the planned time, at least, at either end: the noise is measured on the quietest twentieth of a log
STILL_PART = 0.05
ENOUGH_PART = 0.8  #: of the planned time: a run that is shorter shows less
AGAIN_S = 10.0  #: still for so long away from where the run began, the table is meant to stay there: that is the mark
STIR_RAD = 2.0 * DEG
BEGIN, KEEP = RecordingDecision("begin", "unclosed"), RecordingDecision("keep", "closure")
MARK_WORDS = "set the table onto its index mark, then hands off"


class Step(Enum):
    """Where the run stands."""

    MARK = "onto the mark"
    STAY = "stay"
    RUN = "turn freely"
    WHOLE = "whole"


class ClosureGuide:
    """planned_s of turning.  wants: what is to be done with the files now, until ``decided``; says: what changed, taken by the guide."""

    def __init__(self, sensor: Sensor, protocol: Protocol, hold_s: float, planned_s: float):
        self._sensor, self._protocol, self.planned_s = sensor, protocol, planned_s
        self.hold_s = max(hold_s, STILL_PART * planned_s)
        self.wants: RecordingDecision | None = None
        self.says: list[tuple[Kind, str]] = []
        self.attempts = 0
        self._looked_at = False
        self._parts: list[Samples] = []
        self._to_the_mark()

    def decided(self, decision: RecordingDecision) -> None:
        """It has been done: a new file has begun, or the last one is kept."""
        self.wants = None
        if decision.word == "begin":
            self.step, self.attempts = Step.STAY, self.attempts + 1
            self._parts, self._moved_s, self._rested_s, self._here_s = [], 0.0, 0.0, 0.0
        elif decision.word == "keep":
            self.step = Step.WHOLE

    def interrupted(self) -> None:
        """A new log, a pause, or a person's wish: what there is of a run is no run.  The table is where it is."""
        if self.step in (Step.STAY, Step.RUN):
            self.says.append((Kind.WARNING, "this closure run is not whole, and begins again"))
        self._to_the_mark()

    def on_the_mark(self) -> None:
        """The person says that the table stands on its mark."""
        if self.step is Step.MARK:
            self._here_s = WAIT_S

    def feed(self, samples: Samples, block_s: float, turn: TurnInProgress) -> None:
        """A block of samples, after the turn in progress has had it."""
        if self.step is Step.MARK:
            self._marking(block_s, turn)
        elif self.step in (Step.STAY, Step.RUN):
            self._parts.append(samples)
            (self._staying if self.step is Step.STAY else self._running)(block_s, turn)

    def instruction(self, turn: TurnInProgress) -> Instruction:
        """What to do now, and why it waits."""
        held = min(turn.still_s, self.hold_s)
        countdown = max(self.hold_s - held, 0.0), held / self.hold_s
        if self.step is Step.MARK:
            why = "it moves" if turn.moving else f"still for {turn.still_s:.1f} s"
            return Instruction(
                Stage.CLOSURE, f"closure run: {MARK_WORDS}", f"{why}; if it stands there already, leave it alone", good=not turn.moving
            )
        if self.step is Step.STAY:
            left = max(self.hold_s - self._rested_s, 0.0)
            why = f"the run's first still: {self._rested_s:.1f} of {self.hold_s:.1f} s"
            return Instruction(Stage.CLOSURE, "on the mark: hands off the table", why, left, 1 - left / self.hold_s)
        went = f"{self._moved_s:.0f} of {self.planned_s:.0f} s"
        if not self._enough:
            return Instruction(
                Stage.CLOSURE,
                "turn freely, through many attitudes, about all axes",
                f"{went}; rests do no harm",
                max(self.planned_s - self._moved_s, 0.0),
                min(self._moved_s / self.planned_s, 1.0),
            )
        if turn.moving or not turn.still_s:
            return Instruction(Stage.CLOSURE, "now back onto the same index mark, then hands off", f"{went}: enough")
        why = self._missing or f"still for {turn.still_s:.1f} of {self.hold_s:.1f} s"
        return Instruction(Stage.CLOSURE, "back on the mark: hands off the table", why, *countdown, good=not self._missing)

    @property
    def _enough(self) -> bool:
        return self._moved_s >= ENOUGH_PART * self.planned_s

    def _to_the_mark(self) -> None:
        self.step, self.wants = Step.MARK, None
        self._parts = []
        self._moved_s = self._rested_s = self._here_s = 0.0
        self._went = False
        self._missing = ""

    def _marking(self, block_s: float, turn: TurnInProgress) -> None:
        self._went = self._went or turn.path_rad > STIR_RAD
        self._here_s = 0.0 if turn.moving else self._here_s + block_s
        if turn.still_s >= self.hold_s and (self._went or self._here_s >= WAIT_S):
            self.wants = BEGIN

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
            self._missing, self._looked_at = "", False
            return
        if self._moved_s and not self._looked_at:
            self._looked_at = True
            self._look()
        if self._missing and turn.still_s >= AGAIN_S:
            self.says.append((Kind.WARNING, "it stays there: that is the mark now, and the run begins anew"))
            self._to_the_mark()
            self._here_s = WAIT_S

    def _look(self) -> None:
        """The table rests: is the run whole?"""
        samples = joined(self._parts)
        ends = run_ends(samples, find_stills(samples, self._protocol.still_s)[0], self._sensor)
        if ends is not None and ends.broken:
            self.says.append((Kind.REJECTED, f"this closure run is not whole: {ends.broken}; it begins again from here"))
            self._to_the_mark()
            self._here_s = WAIT_S
        elif ends is None or not self._enough:
            self.says.append((Kind.STAGE, f"{self._moved_s:.0f} of {self.planned_s:.0f} s: turn on"))
        elif not ends.returned:
            self._missing = f"{ends.away_rad / DEG:.1f}° from where the run began, {RETURN_RAD / DEG:g}° at most: set it back onto the mark"
            self.says.append((Kind.WARNING, self._missing))
        else:
            self.wants = KEEP
            self.says.append((Kind.ACCEPTED, f"closure run: {_turned_s(samples, ends):.0f} s, back within {ends.away_rad / DEG:.2f}°"))


def _turned_s(samples: Samples, ends: RunEnds) -> float:
    return float(samples.t_ns[ends.last.start] - samples.t_ns[ends.first.stop - 1]) * NS
