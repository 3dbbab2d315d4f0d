"""The state machine: find port - check stream - hold still - turn - hold still - accepted, or why not - … - done.

It lives on samples, in blocks of 0.1 s, and on what others tell it of the port; the same samples in other portions give the same
changes.  It never waits without saying for what.
"""

from __future__ import annotations

from session.common.units import DEG, NS
from session.detect.blocks import block_size
from session.detect.pace import Pace, pace_of
from session.detect.segments import Segment
from session.detect.stills import MIN_STILL_FRACTION
from session.guide.coverage import Coverage
from session.guide.health import Health
from session.guide.messages import AcceptedTurn, Advice, Change, Instruction, Kind, Stage
from session.guide.stillness import Block, Stillness
from session.guide.stream_check import CHECK_S, FEWEST, stream_problem
from session.guide.turn_in_progress import TurnInProgress
from session.guide.window import Examined, Window
from session.log.config import Protocol, Sensor
from session.log.samples import Samples, joined

HOLD_STILLS = 1.5  #: times the protocol's still_s are asked for: a still serves two turns
SETTLING_S = 0.3  #: quiet for so long, a turn is over
EXAMINE_EVERY_S = 0.2
LEAST_TURN_DEG = 30.0  #: what turns less is not counted: it tells next to nothing
STIR_DEG = 2.0  #: what moves less was no turn
PEAK_FULL_SCALE = 0.85
COACH_S = 2.0  #: how long the coach is waited for before any turn will do
ANY_TURN = "turn by 90° to 300° to another attitude, about any axis but the vertical alone, in about 3 s"


class Guide:
    """Leads through ``segments`` accepted segments.  stop_at_target: or until the coach has nothing to ask for.

    instruction is what to do now; accepted counts segments, rejected those that were not; health, coverage, advice are for the screen.
    """

    def __init__(self, protocol: Protocol, segments: int = 40, stop_at_target: bool = False):
        self.protocol, self.segments, self.stop_at_target = protocol, segments, stop_at_target
        self.sensor: Sensor | None = None
        self.stage, self.health, self.coverage = Stage.FIND_PORT, Health(), Coverage()
        self.advice: Advice | None = None
        self.coached = False  #: whether advice is to be expected after each accepted segment
        self.accepted, self.rejected, self.log = 0, 0, 0
        self._before_s = 0.0  # in earlier logs
        self._waits = ""  # what the port or the stream lacks
        self._changes: list[Change] = []
        self._pending: list[Samples] = []
        self._asked_s: float | None = None
        self._new_log()

    def begin(self, sensor: Sensor) -> None:
        """The sensor's ranges are known: samples can come."""
        self.sensor = sensor

    def waits(self, stage: Stage, why: str) -> None:
        """The port is not there, or says nothing: samples will not come before that has changed.  What was reached is kept."""
        if self.stage is not Stage.DONE:
            self.stage, self._waits = stage, why
            self._turn.interrupted()

    def new_log(self) -> None:
        """The device's clock has begun anew, and with it a log: its first still has yet to come."""
        self.log += 1
        self._before_s += self._now_s
        self.health.new_log()
        self._waits = ""  # it was of the log before
        self._new_log()
        if self.stage is not Stage.DONE:
            self.stage = Stage.CHECK_STREAM

    def feed(self, samples: Samples) -> list[Change]:
        """Later samples of the present log, SI.  Returns what they change."""
        if len(samples) == 0 or self.stage is Stage.DONE:
            return []
        self._changes = []
        if self.stage is Stage.FIND_PORT:
            self.stage, self._waits = Stage.CHECK_STREAM, ""
        self._pending.append(samples)
        checking = self.stage is Stage.CHECK_STREAM
        if checking and not self._check_stream():
            return self._changes
        pending = joined(self._pending)
        assert self._pace is not None  # the stream has been looked at
        self.health.feed(pending if checking else samples, self._pace)
        size = block_size(self._period_s)
        whole = len(pending) // size * size
        for first in range(0, whole, size):
            if self.stage is not Stage.DONE:
                self._block(pending.between(first, first + size))
        self._pending = [pending.between(whole, len(pending))]
        return self._changes

    def advise(self, advice: Advice | None) -> list[Change]:
        """The coach's word on the segments so far; it may come later than the segment it speaks of."""
        self._changes, self.advice, self._asked_s = [], advice, None
        if advice and advice.reached and self.stop_at_target and self.stage is not Stage.DONE:
            self._finish("every parameter has reached its target")
        return self._changes

    @property
    def now_s(self) -> float:
        """Since the session's first sample, without the time between two logs."""
        return self._before_s + self._now_s

    @property
    def turning(self) -> bool:
        """Whether the table moves in its turn now."""
        return self.stage is Stage.TURN and self._turn.moving

    @property
    def hold_s(self) -> float:
        """How long a still is asked for."""
        return HOLD_STILLS * self.protocol.still_s

    @property
    def instruction(self) -> Instruction:
        """What to do now, and why it waits."""
        if self.stage is Stage.FIND_PORT:
            return Instruction(self.stage, "connect the board", self._waits or "no port is open yet", good=False)
        if self.stage is Stage.CHECK_STREAM:
            seen_s = sum(part.duration_s for part in self._pending)
            waits = self._waits or f"{min(seen_s, CHECK_S):.1f} of {CHECK_S:.1f} s of samples seen"
            return Instruction(self.stage, "wait: the stream is being looked at", waits, good=False)
        if self.stage is Stage.DONE:
            return Instruction(self.stage, "done: the table may be left", f"{self.accepted} segments accepted")
        if self.stage is Stage.TURN:
            return self._turn_instruction()
        held = self._turn.still_s
        why, good = self._objection, False
        if self._turn.moving:
            why = f"{self._why} for {self._turn.restless_s or self._turn.moving_s:.1f} s: hands off?"
        elif not why:
            why, good = f"still for {held:.1f} of {self.hold_s:.1f} s", True
        return Instruction(
            self.stage, "hold still: hands off the table", why, max(self.hold_s - held, 0.0), min(held / self.hold_s, 1.0), good
        )

    def _turn_instruction(self) -> Instruction:
        if self._asked_s is not None and self._now_s - self._asked_s < COACH_S and not self._turn.moving:
            return Instruction(self.stage, "one moment: the coach looks at the last turn", f"for up to {COACH_S:g} s")
        do = self.advice.words if self.advice and self.advice.words else ANY_TURN
        if not self._turn.moving:
            why = self.advice.reason if self.advice and self.advice.reason else f"segment {self.accepted + 1} of {self.segments}"
            return Instruction(self.stage, do, f"waiting for the turn; {why}")
        peak_dps, bar_dps = self._turn.peak_rps / DEG, PEAK_FULL_SCALE * self._sensor.gyro_fs_dps
        turned = f"turned {self._turn.path_rad / DEG:.0f}° so far"
        if peak_dps > bar_dps:
            return Instruction(self.stage, do, f"{turned}, but {peak_dps:.0f} > {bar_dps:.0f} dps: slower, or it clips", good=False)
        return Instruction(self.stage, do, f"{turned}, peak {peak_dps:.0f} of {self._sensor.gyro_fs_dps:.0f} dps; then let go")

    def _new_log(self) -> None:
        self._pending = []
        self._asked_s = None
        self._began_ns = self._now_ns = 0
        self._period_s = 0.0
        self._pace: Pace | None = None
        self._window: Window | None = None
        self._stillness: Stillness | None = None
        self._turn = TurnInProgress()
        self._why = self._objection = ""
        self._examined_s = 0.0

    @property
    def _seen(self) -> Window:
        """The recent part of the log; there is one as soon as its stream has been looked at."""
        assert self._window is not None
        return self._window

    @property
    def _at_rest(self) -> Stillness:
        """The judge of blocks, there as soon."""
        assert self._stillness is not None
        return self._stillness

    @property
    def _sensor(self) -> Sensor:
        """As it was set before the first sample."""
        assert self.sensor is not None
        return self.sensor

    def _check_stream(self) -> bool:
        pending = joined(self._pending)
        if pending.duration_s < CHECK_S or len(pending) < FEWEST:
            return False
        problem = stream_problem(pending, self._sensor.odr_hz, self._sensor.accel_fs_g)
        if problem:
            if problem != self._waits:
                self._say(Kind.WARNING, problem)
            self._waits, self._pending = problem, []
            return False
        if self._window is None:
            self._period_s, self._began_ns, self._now_ns = pending.period_s, int(pending.t_ns[0]), int(pending.t_ns[0])
            self._pace = pace_of(pending.t_ns)
            self._window = Window(self._sensor, self.protocol, self._period_s)
            self._stillness = Stillness(self._period_s)
        self._waits, self.stage = "", Stage.HOLD_STILL
        self._say(Kind.STAGE, f"the stream is good: {1 / pending.period_s:.1f} Hz")
        return True

    def _block(self, samples: Samples) -> None:
        self._now_ns = int(samples.t_ns[-1])
        self._seen.feed(samples)
        block = self._at_rest.feed(samples)
        self._why = block.why
        ended_s = self._turn.feed(block, self._at_rest.zero_rps)
        if self.stage is Stage.TURN:
            self._turning()
        elif block.quiet:
            self._holding(block)
        elif ended_s:
            self._let_go(ended_s)

    def _turning(self) -> None:
        if self._turn.path_rad < STIR_DEG * DEG:
            self._seen.rest(self._turn.still_s)
        elif max(self._turn.still_s, self._turn.restless_s) >= SETTLING_S:
            self.stage, self._objection = Stage.HOLD_STILL, ""
            self._say(Kind.STAGE, f"turned {self._turn.path_rad / DEG:.0f}°: now hold still")

    def _holding(self, block: Block) -> None:
        self._examined_s += block.duration_s
        if self._turn.still_s < self.hold_s or self._examined_s < EXAMINE_EVERY_S:
            return
        self._examined_s = 0.0
        examined = self._seen.examine()
        self._objection = examined.why
        if examined.still is not None:
            self._judge(examined)

    def _let_go(self, held_s: float) -> None:
        """The still ended before the countdown: it may have been long enough all the same."""
        shortest = MIN_STILL_FRACTION * self.protocol.still_s
        examined = self._seen.examine() if held_s >= shortest else None
        if examined is not None and examined.still is not None:
            self._judge(examined)
            return
        self._objection = ""
        if held_s >= SETTLING_S:
            why = examined.why if examined is not None else f"too short a still, {held_s:.1f} < {shortest:.1f} s"
            turns = ": this turn goes on to the next still" if self._seen.has_reference else ""
            self._say(Kind.WARNING, f"{why}{turns}")

    def _judge(self, examined: Examined) -> None:
        """The present still is a reference; is the turn before it a segment?"""
        segment, still = examined.segment, examined.still
        assert still is not None
        self._seen.accept(examined)
        self._at_rest.zero_rps = still.gyro_mean
        self._turn.accepted_still()
        self.stage, self._objection = Stage.TURN, ""
        if segment is None:
            self.coverage.first(still.accel_mean)
            self._say(Kind.READY, f"the first still holds ({still.duration_s:.1f} s): turn")
            return
        number = self.accepted + self.rejected + 1
        problem = segment.problem
        if not problem and segment.turn_deg < LEAST_TURN_DEG:
            problem = f"no turn: {segment.turn_deg:.0f}° < {LEAST_TURN_DEG:.0f}°; turn by 90° or more"
        if problem:
            self.rejected += 1
            self._say(Kind.REJECTED, f"turn {number} rejected: {problem}")
            return
        self.accepted += 1
        turn = self._accepted_turn(segment, examined)
        self.coverage.add(turn)
        note = f"; {segment.note}" if segment.note else ""
        said = f"turn {number} accepted: {segment.turn_deg:.0f}° in {segment.turn_s:.1f} s{note}"
        self._asked_s = self._now_s if self.coached else None
        self._say(Kind.ACCEPTED, said, turn)
        if self.accepted >= self.segments:
            self._finish(f"{self.accepted} segments")

    def _accepted_turn(self, segment: Segment, examined: Examined) -> AcceptedTurn:
        assert examined.noise is not None  # a still, which ends a segment, shows it
        samples = examined.samples.between(segment.start, segment.stop)
        middle_s = self._before_s + float((int(samples.t_ns[0]) + int(samples.t_ns[-1])) // 2 - self._began_ns) * NS
        return AcceptedTurn(segment, samples, examined.noise, self.log, middle_s)

    def _finish(self, why: str) -> None:
        self.stage = Stage.DONE
        self._say(Kind.DONE, f"done: {why}")

    def _say(self, kind: Kind, text: str, accepted: AcceptedTurn | None = None) -> None:
        self._changes.append(Change(kind, text, self.now_s, accepted))

    @property
    def _now_s(self) -> float:
        """Since the present log began."""
        return (self._now_ns - self._began_ns) * NS
