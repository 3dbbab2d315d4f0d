"""The guided session as a state machine: find port, check stream, still, turn, still, accepted or why not, closure run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import Protocol as Interface

import numpy as np

from session.bench.closure_guide import MARK_WORDS, ClosureGuide
from session.bench.events import Event, SampleChunk
from session.bench.live import CHECK_S, MotionBlock, StreamHealth, TurnInProgress, Wait
from session.bench.messages import SETTLING_S, AcceptedTurn, Advice, CoachRequest, GuideMessage, Instruction, Kind, Stage
from session.bench.progress import AcceptedData, LiveAccelerometerFit, PresentLog, StillExamination, accepted_turn, fastest_ns, why_not
from session.bench.rawfile import RecordingDecision
from session.detect.segments import moved_at
from session.detect.stills import MIN_STILL_FRACTION
from session.io.config import Config, Protocol, Sensor
from session.io.samples import Samples
from session.io.units import DEG, NS, WORDS

# What comes from the recorder, as the guide takes it.


def joined_chunks(events: Iterable[Event | RecordingDecision]) -> Iterator[Event | RecordingDecision]:
    """Neighbouring chunks as one: a busy machine reads many small portions at once."""
    for are_chunks, group in groupby(events, lambda event: isinstance(event, SampleChunk)):
        if are_chunks:
            chunks = [event for event in group if isinstance(event, SampleChunk)]
            t_us, registers = (np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in ("t_us", "registers"))
            yield SampleChunk(t_us, registers, chunks[0].form)
        else:
            yield from group


def samples_of(chunk: SampleChunk, config: Config) -> Samples:
    """Registers or physical units as SI, with the accelerometer's pre-calibration."""
    registers, units = chunk.registers.astype(float), config.sensor.register_units
    if chunk.form.physical:
        gyro, accel = (WORDS[kind][word] for kind, word in zip(("gyro", "accel"), chunk.form.units, strict=True))
        temp_c = registers[:, 6] if chunk.form.has_temperature else None
        return Samples(chunk.t_us * 1000, registers[:, 0:3] * gyro, config.accelerometer.correct(registers[:, 3:6] * accel), temp_c)
    return Samples(
        chunk.t_us * 1000,
        registers[:, 0:3] * units.gyro_rps,
        config.accelerometer.correct(registers[:, 3:6] * units.accel_mps2),
        units.temperature_c(registers[:, 6]),
    )


# What the guide says to do at this moment, and why it waits.

PEAK_FULL_SCALE = 0.85
ANY_TURN = "turn the board onto another side: by 90°, 180° or 270° about an axis of it that is level, in about 3 s"


class Leader(Interface):
    """What a guide shows of itself."""

    stage: Stage
    segments: int
    waits_for: str
    objection: str
    here: PresentLog
    closure: ClosureGuide | None
    asked_for: CoachRequest
    sensor: Sensor | None
    health: StreamHealth
    taken: AcceptedData

    @property
    def accepted(self) -> int:
        """Segments that count."""

    @property
    def turn(self) -> TurnInProgress:
        """What the table does now."""

    @property
    def hold_s(self) -> float:
        """How long a still is asked for."""

    @property
    def coach_is_asked(self) -> bool:
        """Whether its word is still awaited."""


def instruction_of(guide: Leader) -> Instruction:
    """For each stage."""
    stage = guide.stage
    if stage is Stage.FIND_PORT:
        return Instruction(stage, "connect the board", guide.waits_for or "no port is open yet", good=False)
    if stage is Stage.CHECK_STREAM:
        waits = guide.waits_for or f"{min(guide.here.checked_s, CHECK_S):.1f} of {CHECK_S:.1f} s of samples seen"
        return Instruction(stage, "wait: the stream is being looked at", waits, good=False)
    if stage is Stage.PAUSED:
        return Instruction(stage, "paused: nothing is judged", "p goes on", good=False)
    if stage is Stage.DONE:
        return Instruction(stage, "done: the table may be left", f"{guide.accepted} segments accepted")
    if stage is Stage.CLOSURE and guide.closure is not None:
        return guide.closure.instruction(guide.turn)
    return _turn(guide) if stage is Stage.TURN else _hold(guide)


def wait_of(guide: Leader) -> Wait | None:
    """Whether it pays to let the board become warm before going on."""
    if guide.stage not in (Stage.HOLD_STILL, Stage.TURN):
        return None
    return guide.health.warmth.wait(guide.taken.turns, guide.taken.stills, guide.segments - guide.accepted)


def _hold(guide: Leader) -> Instruction:
    turn, held = guide.turn, guide.turn.still_s
    why, good = guide.objection, False
    if turn.moving:
        why = f"{guide.here.why} for {turn.restless_s or turn.moving_s:.1f} s: hands off?"
    elif not why:
        why, good = f"still for {held:.1f} of {guide.hold_s:.1f} s", True
    left = max(guide.hold_s - held, 0.0)
    return Instruction(guide.stage, "hold still: hands off the table", why, left, min(held / guide.hold_s, 1.0), good)


def _turn(guide: Leader) -> Instruction:
    turn, advice = guide.turn, guide.asked_for.advice
    if guide.coach_is_asked:
        return Instruction(guide.stage, "one moment: the coach looks at the last turn", "for some 2 s at most")
    do = advice.words if advice else ANY_TURN
    if not turn.moving:
        waits = f"waiting for the turn; segment {guide.accepted + 1} of {guide.segments}"
        return Instruction(guide.stage, do, advice.reason if advice and advice.reason else waits)
    assert guide.sensor is not None  # as it was set before the first sample
    peak_dps, bar_dps = turn.peak_rps / DEG, PEAK_FULL_SCALE * guide.sensor.gyro_fs_dps
    turned = f"turned {turn.path_rad / DEG:.0f}° so far"
    if peak_dps > bar_dps:
        return Instruction(guide.stage, do, f"{turned}, but {peak_dps:.0f} > {bar_dps:.0f} dps: slower, or it clips", good=False)
    return Instruction(guide.stage, do, f"{turned}, peak {peak_dps:.0f} of {guide.sensor.gyro_fs_dps:.0f} dps; then let go")


# The state machine: find port - check stream - hold still - turn - hold still - accepted, or why not - … - closure run - done.
#
# It lives on samples, in blocks of 0.1 s, and on what others tell it of the port; the same samples in other portions give the same
# changes.  It never waits without saying for what.

HOLD_STILLS = 1.5  #: times the protocol's still_s are asked for: a still serves two turns
EXAMINE_EVERY_S = 0.2
STIR_DEG = 2.0  #: what moves less was no turn


class Guide:
    """Leads through ``segments`` accepted segments.  stop_at_target: or until the coach has nothing to ask for.  closure_s: and through a
    closure run with so much turning; 0: none.

    instruction is what to do now; accepted counts segments, rejected those that were not, dropped those that the person took back;
    health, taken, advice, asked_for are for the screen and the coach; closure is the run, once it is its turn.
    """

    def __init__(self, protocol: Protocol, segments: int = 40, stop_at_target: bool = False, closure_s: float = 0.0):
        self.protocol, self.segments, self.stop_at_target, self.closure_s = protocol, segments, stop_at_target, closure_s
        self.sensor: Sensor | None = None
        self.closure: ClosureGuide | None = None
        self.stage, self.health, self.taken = Stage.FIND_PORT, StreamHealth(), AcceptedData()
        self.advice: Advice | None = None  #: the last
        self.asked_for = CoachRequest()
        self.coached = False  #: whether advice is to be expected after each accepted segment
        self.rejected = self.dropped = self.log = 0
        self._before_s = 0.0  # in earlier logs
        self.keys, self._whole = "", ""  # the screen's last line; what the coach said of the whole session
        self.waits_for = ""  # what the port or the stream lacks
        self._changes: list[GuideMessage] = []
        self._new_log()

    def begin(self, sensor: Sensor, own: LiveAccelerometerFit | None = None) -> None:
        """The sensor's ranges are known: samples can come.  own: where nobody has calibrated its accelerometer."""
        self.sensor = sensor
        self.taken.begin(own, sensor.gyro_fs_dps * DEG)

    def waits(self, stage: Stage, why: str) -> None:
        """The port is not there, or says nothing: samples will not come before that has changed.  What was reached is kept."""
        if self.stage not in (Stage.DONE, Stage.PAUSED):
            self.stage, self.waits_for = stage, why
            self.turn.interrupted()

    def new_log(self) -> None:
        """The device's clock has begun anew, and with it a log: its first still has yet to come."""
        self.log += 1
        self._before_s += self.here.now_s
        self.health.new_log()
        self.waits_for = ""  # it was of the log before
        self._new_log()
        if self.closure is not None:
            self.closure.interrupted()
        if self.stage not in (Stage.DONE, Stage.PAUSED):
            self.stage = Stage.CHECK_STREAM

    def feed(self, samples: Samples) -> list[GuideMessage]:
        """Later samples of the present log, SI.  Returns what they change."""
        if len(samples) == 0 or self.stage in (Stage.DONE, Stage.PAUSED):
            return []
        self._changes = []
        if self.stage is Stage.FIND_PORT:
            self.stage, self.waits_for = Stage.CHECK_STREAM, ""
        self.here.add(samples)
        checking = self.stage is Stage.CHECK_STREAM
        if checking and not self._stream_is_good():
            return self._changes
        self.health.feed(self.here.pending if checking else samples, self.here.pace)
        for block in self.here.blocks():
            if self.stage is not Stage.DONE:
                self._block(block)
        return self._changes

    def advise(self, advice: Advice | None, stills: int | None = None) -> list[GuideMessage]:
        """The coach's word, given at so many stills: what it asks for counts only where the board still lies so."""
        self._changes, self.advice = [], advice
        if advice and advice.says and advice.says != self._whole:
            self._whole = advice.says
            self._say(Kind.STAGE, self._whole)
        if stills in (None, len(self.taken.stills)) and self.turn.path_rad < STIR_DEG * DEG:
            self.asked_for.answered(advice)
        if advice and advice.reached and self.stop_at_target and self.stage is not Stage.DONE and self.closure is None:
            self._segments_done("every parameter has reached its target")
        return self._changes

    def decided(self, decision: RecordingDecision) -> list[GuideMessage]:
        """What a person, or the guide itself (``wants``), has decided, and the files show: now, or in a recording that is resumed."""
        self._changes = []
        if decision.word == "pause":
            self.stage = Stage.PAUSED
            self._say(Kind.STAGE, "paused: what comes is kept, and not judged")
        elif self.stage is Stage.PAUSED and decision.word == "begin":
            self.stage = Stage.CHECK_STREAM
            self.new_log()
            self._say(Kind.STAGE, "it goes on")
        elif decision.word == "drop":
            self._drop(int(decision.rest) * 1000)
        elif self.closure is not None:
            self.closure.decided(decision)
            self.turn.accepted_still()
            if decision.word == "keep":
                self._finish(f"{self.accepted} segments and a closure run")
        return self._changes

    @property
    def wants(self) -> RecordingDecision | None:
        """What is to be done with the files."""
        return self.closure.wants if self.closure is not None and self.stage is Stage.CLOSURE else None

    @property
    def accepted(self) -> int:
        """Segments that count."""
        return len(self.taken.turns)

    @property
    def to_drop(self) -> tuple[int | None, str]:
        """Device time, µs, at which the last turn moved (the one at this moment, or else the last accepted); None and why, without one."""
        if self.closure is None and self.stage in (Stage.TURN, Stage.HOLD_STILL) and self.turn.path_rad > STIR_DEG * DEG:
            return self.here.peak_ns // 1000, ""
        if self.closure is not None or self.stage is not Stage.TURN:
            return None, "there is no turn to drop now"
        if self.here.refused:
            return None, "the last turn does not count anyhow"
        last = self.taken.last_of(self.log)
        return (None, "this log holds no accepted turn yet") if last is None else (fastest_ns(last) // 1000, "")

    @property
    def now_s(self) -> float:
        """Since the session's first sample, without the time between two logs."""
        return self._before_s + self.here.now_s

    @property
    def turning(self) -> bool:
        """Whether the table moves in its turn now."""
        return self.stage is Stage.TURN and self.turn.moving

    @property
    def hold_s(self) -> float:
        """How long a still is asked for."""
        return HOLD_STILLS * self.protocol.still_s

    @property
    def instruction(self) -> Instruction:
        """What to do now, and why it waits."""
        return instruction_of(self)

    @property
    def coach_is_asked(self) -> bool:
        """Whether its word on the last turn is still awaited, for a while."""
        return bool(self.taken.turns) and self.asked_for.awaited(self.here.now_s) and not self.turn.moving

    @property
    def turn(self) -> TurnInProgress:
        """What the table does now."""
        return self.here.turn

    def _new_log(self) -> None:
        self.here = PresentLog()
        self.asked_for.ends()
        self.objection = ""
        self._examined_s = 0.0

    @property
    def _sensor(self) -> Sensor:
        """As it was set before the first sample."""
        assert self.sensor is not None
        return self.sensor

    def _stream_is_good(self) -> bool:
        problem = self.here.look(self._sensor, self.protocol, self.taken.own is None)
        if problem is None:
            return False
        if problem:
            if problem != self.waits_for:
                self._say(Kind.WARNING, problem)
            self.waits_for = problem
            return False
        self.waits_for, self.stage = "", Stage.HOLD_STILL if self.closure is None else Stage.CLOSURE
        self._say(Kind.STAGE, f"the stream is good: {1 / self.here.pending.period_s:.1f} Hz")
        return True

    def _block(self, samples: Samples) -> None:
        block, ended_s = self.here.take(samples, remember=self.closure is None)
        if self.closure is not None:
            self.closure.feed(samples, block.duration_s, self.turn)
            said, self.closure.says = self.closure.says, []
            for kind, text in said:
                self._say(kind, text)
        elif self.stage is Stage.TURN:
            self._turning()
        elif block.quiet:
            self._holding(block)
        elif ended_s:
            self._let_go(ended_s)

    def _turning(self) -> None:
        if self.turn.path_rad < STIR_DEG * DEG:
            self.here.window.rest(self.turn.still_s)
        elif max(self.turn.still_s, self.turn.restless_s) >= self.asked_for.settling_s(self.turn.path_rad, self.protocol.still_s):
            self.stage, self.objection = Stage.HOLD_STILL, ""
            self._say(Kind.STAGE, f"turned {self.turn.path_rad / DEG:.0f}°: now hold still")

    def _holding(self, block: MotionBlock) -> None:
        self._examined_s += block.duration_s
        if self.turn.still_s < self.hold_s or self._examined_s < EXAMINE_EVERY_S:
            return
        self._examined_s = 0.0
        examined = self.here.window.examine()
        self.objection = examined.why
        if examined.still is not None:
            self._judge(examined)

    def _let_go(self, held_s: float) -> None:
        """The still ended before the countdown: it may have been long enough all the same."""
        shortest = MIN_STILL_FRACTION * self.protocol.still_s
        examined = self.here.window.examine() if held_s >= shortest else None
        if examined is not None and examined.still is not None:
            self._judge(examined)
            return
        self.objection = ""
        if held_s >= SETTLING_S:
            why = examined.why if examined is not None else f"too short a still, {held_s:.1f} < {shortest:.1f} s"
            turns = ": this turn goes on to the next still" if self.here.window.has_reference else ""
            self._say(Kind.WARNING, f"{why}{turns}")

    def _judge(self, examined: StillExamination) -> None:
        """The present still is a reference; is the turn before it a segment?"""
        segment, still = examined.segment, examined.still
        assert still is not None
        self.here.accept(examined)
        self.stage, self.objection = Stage.TURN, ""
        self.asked_for.ends(self.here.now_s if self.coached else None)
        if self.taken.add_still(still) and (own := self.taken.own) is not None:
            self._say(Kind.WARNING if own.problem else Kind.STAGE, f"the accelerometer is known: {own.problem or own.words}")
        if segment is None:
            self._say(Kind.READY, f"the first still holds ({still.duration_s:.1f} s): turn")
            return
        number, problem = self.accepted + self.rejected + self.dropped + 1, why_not(segment)
        self.here.refused = True
        if any(moved_at(segment, examined.samples, at_ns * NS) for at_ns in self.here.dropped_ns):
            self.dropped += 1
            self._say(Kind.STAGE, f"turn {number} dropped, as you said")
            return
        if problem:
            self.rejected += 1
            self._say(Kind.REJECTED, f"turn {number} rejected: {problem}")
            return
        self.here.refused = False
        turn = accepted_turn(segment, examined, self.log, self._before_s, self.here.began_ns)
        self.taken.add(turn)
        note = f"; {segment.note}" if segment.note else ""
        said = f"turn {number} accepted: {segment.turn_deg:.0f}° in {segment.turn_s:.1f} s{note}"
        self._say(Kind.ACCEPTED, said, turn)
        if self.accepted >= self.segments:
            self._segments_done(f"{self.accepted} segments")

    def _drop(self, at_ns: int) -> None:
        """Of an accepted turn of this log, or of the one in progress."""
        turn = self.taken.drop(self.log, at_ns)
        if turn is None:
            self.here.dropped_ns.append(at_ns)
            self._say(Kind.STAGE, "this turn will not count; its data stay")
            return
        self.dropped, self.here.refused = self.dropped + 1, True
        self.asked_for.ends(self.here.now_s if self.coached else None)
        said = f"the last turn is dropped ({turn.segment.turn_deg:.0f}° in {turn.segment.turn_s:.1f} s): left out, its data stay"
        self._say(Kind.STAGE, said, dropped=turn)

    def _segments_done(self, why: str) -> None:
        if not self.closure_s:
            self._finish(why)
            return
        self.stage, self.closure = Stage.CLOSURE, ClosureGuide(self._sensor, self.protocol, self.hold_s, self.closure_s)
        self._say(Kind.READY, f"{why}: now the closure run; {MARK_WORDS}")

    def _finish(self, why: str) -> None:
        self.stage = Stage.DONE
        self._say(Kind.DONE, f"done: {why}")

    def _say(self, kind: Kind, text: str, accepted: AcceptedTurn | None = None, dropped: AcceptedTurn | None = None) -> None:
        self._changes.append(GuideMessage(kind, text, self.now_s, accepted, dropped))


# What a guided recording tells of itself: to a screen, to lines, to a page.


class View(Interface):
    """A screen, or lines."""

    def change(self, change: GuideMessage) -> None:
        """Something has changed."""

    def show(self, guide: Guide) -> None:
        """Draw the present state."""
