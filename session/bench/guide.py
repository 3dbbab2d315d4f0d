"""The guided session as a state machine: find port, check stream, still, turn, still, accepted or why not, closure run."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby
from typing import Protocol as Interface

from session.base.units import DEG, NS, WORDS
from session.bench.closure_guide import MARK_WORDS, ClosureGuide
from session.bench.events import AnyEvent, Event, SampleChunk, joined_chunk
from session.bench.live import CHECK_S, MotionBlock, StreamHealth, TurnInProgress, Wait
from session.bench.messages import SETTLING_S, AcceptedTurn, Advice, CoachRequest, GuideMessage, Instruction, Kind, Stage
from session.bench.progress import AcceptedData, LiveAccelerometerFit, PresentLog, StillExamination, accepted_turn, fastest_ns, why_not
from session.detect.segments import moved_at
from session.detect.stills import MIN_STILL_FRACTION, Still
from session.log.config import Config, Protocol, Sensor
from session.log.samples import Samples


def joined_chunks(events: Iterable[AnyEvent]) -> Iterator[AnyEvent]:
    """Merge neighbouring chunks: a busy computer reads many small ones at once."""
    for are_chunks, group in groupby(events, lambda event: isinstance(event, SampleChunk)):
        if are_chunks:
            yield joined_chunk([event for event in group if isinstance(event, SampleChunk)])
        else:
            yield from group


def samples_of(chunk: SampleChunk, config: Config) -> Samples:
    """Registers or physical units as SI, with the accelerometer's calibration."""
    values = chunk.registers.astype(float)
    if chunk.form.physical:
        gyro, accel = (WORDS[kind][word] for kind, word in zip(("gyro", "accel"), chunk.form.units, strict=True))
        temp_c = values[:, 6] if chunk.form.has_temperature else None
    else:
        units = config.sensor.register_units
        gyro, accel, temp_c = units.gyro_rps, units.accel_mps2, units.temperature_c(values[:, 6])
    return Samples(chunk.t_us * 1000, values[:, 0:3] * gyro, config.accelerometer.correct(values[:, 3:6] * accel), temp_c)


PEAK_FULL_SCALE = 0.85
_ANY_TURN = "turn the board onto another side: by 90°, 180° or 270° about an axis of it that is level, in about 3 s"
HOLD_STILLS = 1.5  #: times the protocol's still_s: a still serves two turns
EXAMINE_EVERY_S = 0.2
NEARLY = 0.85  #: of a rotation: behind it the next one counts, on the page as well (path.js)
FINISH_WORDS = "f finishes"
STIR_DEG = 2.0  #: a smaller movement is no turn
REST = "rest"  #: stem of the logs of a rest (``session.bench.rest_guide``), in which no turn is looked for


class Guide:
    """Leads through ``segments`` accepted segments, then through a closure run with closure_s of turning (0: none).

    stop_at_target ends the segments as soon as the coach requests nothing more.  The guide is driven by samples, in blocks of 0.1 s, and
    by messages about the port; how the samples are divided into portions changes nothing.  It never waits without stating for what.
    """

    stem = "log"  #: of the logs that it asks for

    def __init__(self, protocol: Protocol, segments: int = 40, stop_at_target: bool = False, closure_s: float = 0.0):
        self.protocol, self.segments, self.stop_at_target, self.closure_s = protocol, segments, stop_at_target, closure_s
        self.sensor: Sensor | None = None
        self.closure: ClosureGuide | None = None  #: once the segments are done
        self.stage, self.health, self.taken = Stage.FIND_PORT, StreamHealth(), AcceptedData()
        self.advice: Advice | None = None  #: the last
        self.asked_for = CoachRequest()
        self.coached = False  #: whether advice is expected after each accepted segment
        self.any_turn = _ANY_TURN  #: what to do where the coach requests nothing
        self.rejected = self.dropped = self.log = 0  #: rejected segments; segments that the operator took back; number of the log
        self._before_s = 0.0  # duration of earlier logs
        self.at_rest = False  #: whether the samples go to a rest log
        self.board_faults: Mapping[str, int] = {}  #: what the board has reported of itself, by name
        self.keys = ""  # the screen's last line
        self.waits_for = ""  # what the port or the stream lacks
        self._messages: list[GuideMessage] = []
        self._begin_log()

    def begin(self, sensor: Sensor, own: LiveAccelerometerFit | None = None) -> None:
        """The sensor's ranges are known: samples can come.  own: where its accelerometer is not calibrated."""
        self.sensor = sensor
        self.taken.begin(own, sensor.gyro_fs_dps * DEG)

    def waits(self, stage: Stage, why: str) -> None:
        """The port is closed or silent: no samples will come before that has changed.  The session's progress is kept."""
        if self.stage not in (Stage.DONE, Stage.PAUSED):
            self.stage, self.waits_for = stage, why
            self.turn.interrupted()

    def new_log(self) -> None:
        """The device's clock has restarted, and with it a log: its first still has yet to come."""
        self.log += 1
        self._before_s += self.here.now_s
        self.health.new_log()
        self.waits_for = ""  # it was of the log before
        self._begin_log()
        if self.closure is not None:
            self.closure.interrupted()
        if self.stage not in (Stage.DONE, Stage.PAUSED):
            self.stage = Stage.CHECK_STREAM

    def feed(self, samples: Samples) -> list[GuideMessage]:
        """Take later samples of the present log, SI; returns the messages that they cause."""
        if len(samples) == 0 or self.stage in (Stage.DONE, Stage.PAUSED):
            return []
        self._messages = []
        if self.stage is Stage.FIND_PORT:
            self.stage, self.waits_for = Stage.CHECK_STREAM, ""
        self.here.add(samples)
        checking = self.stage is Stage.CHECK_STREAM
        if checking and not self._stream_is_good():
            return self._messages
        self.health.feed(self.here.pending if checking else samples, self.here.pace)
        for block in self.here.blocks():
            if self.stage is not Stage.DONE:
                self._block(block)
        return self._messages

    def advise(self, advice: Advice | None, stills: int | None = None) -> list[GuideMessage]:
        """Take the coach's advice, given at so many stills; its movement counts only while the board keeps that attitude."""
        self._messages, self.advice = [], advice
        if stills in (None, len(self.taken.stills)) and self.turn.path_rad < STIR_DEG * DEG:
            self.asked_for.answered(advice)
        if advice and advice.reached and self.stop_at_target and self.stage is not Stage.DONE and self.closure is None:
            self._segments_done(advice.reason if advice.missing else "every parameter has reached its target")
        return self._messages

    def decided(self, decision: Event) -> list[GuideMessage]:
        """Take a decision of the operator, or of the guide itself (``wants``), that the files already hold."""
        self._messages = []
        if decision.kind == "begin":
            self.at_rest = decision.text == REST
        if self.at_rest and decision.kind in ("begin", "finish"):  # of a rest that was recorded into this session: nothing is examined
            self.stage = self.stage if self.stage is Stage.DONE else Stage.PAUSED
        elif decision.kind == "pause":
            self.stage = Stage.PAUSED
            self._say(Kind.STAGE, "paused: samples are stored, not examined")
        elif self.stage is Stage.PAUSED and decision.kind == "begin":
            self.stage = Stage.CHECK_STREAM
            self.new_log()
            self._say(Kind.STAGE, "it goes on")
        elif decision.kind == "drop":
            self._drop(int(decision.text) * 1000)
        elif decision.kind == "finish" and self.closure is None:
            self._segments_done(f"{self.accepted} segments, finished by the operator")
        elif self.closure is not None:
            self.closure.decided(decision)
            self.turn.accepted_still()
            if decision.kind == "keep":
                self._finish(f"{self.accepted} segments and a closure run")
        return self._messages

    @property
    def wants(self) -> Event | None:
        """What is to be done with the files."""
        return self.closure.wants if self.closure is not None and self.stage is Stage.CLOSURE else None

    @property
    def enough(self) -> bool:
        """Whether every target is met while turns are still asked for: the operator may finish."""
        return self.advice is not None and self.advice.reached and self.closure is None and self.stage is not Stage.DONE

    @property
    def short_of(self) -> str:
        """How many targets are met, ``0 of 21``, where some are not; empty where all are, and without a coach."""
        if self.advice is None or not self.advice.missing or not self.advice.sigmas:
            return ""
        return f"{sum(sigma <= 1 for _, sigma in self.advice.sigmas)} of {len(self.advice.sigmas)} targets are met"

    @property
    def accepted(self) -> int:
        """Number of segments that count."""
        return len(self.taken.turns)

    @property
    def so_far(self) -> str:
        """What is recorded, in words."""
        return f"{self.accepted} segments"

    def resumes(self) -> bool:
        """Whether a resumed recording goes on."""
        return self.stage is not Stage.DONE

    @property
    def to_drop(self) -> tuple[int | None, str]:
        """Device time, µs, at which the present turn, else the last accepted one, moved; or None and why there is none to drop."""
        if self.closure is None and self.stage in (Stage.TURN, Stage.HOLD_STILL) and self.turn.path_rad > STIR_DEG * DEG:
            return self.here.peak_ns // 1000, ""
        if self.closure is not None or self.stage is not Stage.TURN:
            return None, "there is no turn to drop now"
        if self.here.refused:
            return None, "the last turn does not count"
        last = self.taken.last_of(self.log)
        return (None, "this log holds no accepted turn yet") if last is None else (fastest_ns(last) // 1000, "")

    @property
    def now_s(self) -> float:
        """Time since the session's first sample, without the time between two logs."""
        return self._before_s + self.here.now_s

    @property
    def turn(self) -> TurnInProgress:
        """The table's present motion."""
        return self.here.turn

    @property
    def turning(self) -> bool:
        """Whether the table moves in its turn now."""
        return self.stage is Stage.TURN and self.turn.moving

    @property
    def hold_s(self) -> float:
        """How long the guide requests a still."""
        return HOLD_STILLS * self.protocol.still_s

    @property
    def wait(self) -> Wait | None:
        """Whether it pays to let the board warm up before going on."""
        if self.stage not in (Stage.HOLD_STILL, Stage.TURN):
            return None
        return self.health.warmth.wait(self.taken.turns, self.taken.stills, self.segments - self.accepted)

    @property
    def instruction(self) -> Instruction:
        """What to do now, and why the guide waits."""
        stage = self.stage
        if stage is Stage.FIND_PORT:
            pulled = self.here.now_s > 0 or self.log > 0
            do = "plug it in, it goes on by itself" if pulled else "connect the board"
            return Instruction(stage, do, self.waits_for or "no port is open yet", good=False)
        if stage is Stage.CHECK_STREAM:
            waits = self.waits_for or f"{min(self.here.unchecked_s, CHECK_S):.1f} of {CHECK_S:.1f} s of samples seen"
            return Instruction(stage, "wait: the stream is being checked", waits, good=False)
        if stage is Stage.PAUSED:
            return Instruction(stage, "paused: nothing is examined", "p goes on", good=False)
        if stage is Stage.DONE:
            short = self.short_of
            do = f"the turns are made, the targets are not: {short}" if short else "done: the table may be left"
            return Instruction(stage, do, f"{self.accepted} segments accepted{'; go on with more turns' if short else ''}", good=not short)
        if stage is Stage.CLOSURE and self.closure is not None:
            return self.closure.instruction(self.turn)
        return self._turn_instruction() if stage is Stage.TURN else self._hold_instruction()

    def _hold_instruction(self) -> Instruction:
        turn, held = self.turn, self.turn.still_s
        why, good = self.objection, False
        if turn.moving:
            why = f"{self.here.why} for {turn.restless_s or turn.moving_s:.1f} s: hands off?"
        elif not why:
            why, good = f"still for {held:.1f} of {self.hold_s:.1f} s", True
        left = max(self.hold_s - held, 0.0)
        return Instruction(self.stage, "hold still: hands off the table", why, left, min(held / self.hold_s, 1.0), good)

    def _turn_instruction(self) -> Instruction:
        turn, advice = self.turn, self.asked_for.advice
        if self.taken.turns and self.asked_for.awaited(self.here.now_s) and not turn.moving:
            return Instruction(self.stage, "one moment: the coach evaluates the last turn", "for some 2 s at most")
        if self.enough and not turn.moving:
            return Instruction(self.stage, "enough: finish now", f"every target is met; {FINISH_WORDS}, or turn on")
        do = advice.words if advice else self.any_turn
        if not turn.moving:
            waits = f"waiting for the turn; segment {self.accepted + 1} of {self.segments}"
            return Instruction(self.stage, do, advice.reason if advice and advice.reason else waits)
        full_scale_dps, peak_dps = self._sensor.gyro_fs_dps, turn.peak_rps / DEG
        turned = f"turned {turn.path_rad / DEG:.0f}° so far"
        if peak_dps > PEAK_FULL_SCALE * full_scale_dps:
            too_fast = f"but {peak_dps:.0f} > {PEAK_FULL_SCALE * full_scale_dps:.0f} dps: slower, or it clips"
            return Instruction(self.stage, do, too_fast, good=False, far=turned)
        before_last = sum(abs(part.angle_rad) for part in advice.movements[:-1]) if advice else 0.0
        then = "then let go" if turn.path_rad >= NEARLY * before_last else "then at once the next turn"
        return Instruction(self.stage, do, f"peak {peak_dps:.0f} of {full_scale_dps:.0f} dps; {then}", far=turned)

    def _begin_log(self) -> None:
        self.here = PresentLog()
        self.asked_for.ends()
        self.objection = ""  # why the present still does not count
        self._examined_s = 0.0

    @property
    def _sensor(self) -> Sensor:
        assert self.sensor is not None  # ``begin`` comes before the first sample
        return self.sensor

    def _stream_is_good(self) -> bool:
        problem = self.here.check(self._sensor, self.protocol, self.taken.own is None)
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
            self._still_ended(ended_s)

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
            self._accept_still(examined, examined.still)

    def _still_ended(self, held_s: float) -> None:
        """The still ended before the countdown: it may have been long enough nevertheless."""
        shortest = MIN_STILL_FRACTION * self.protocol.still_s
        examined = self.here.window.examine() if held_s >= shortest else None
        if examined is not None and examined.still is not None:
            self._accept_still(examined, examined.still)
            return
        self.objection = ""
        if held_s >= SETTLING_S:
            why = examined.why if examined is not None else f"too short a still, {held_s:.1f} < {shortest:.1f} s"
            turns = ": this turn goes on to the next still" if self.here.window.has_reference else ""
            self._say(Kind.WARNING, f"{why}{turns}")

    def _accept_still(self, examined: StillExamination, still: Still) -> None:
        """The present still is a reference; decide whether the turn before it is a segment."""
        segment = examined.segment
        self.here.accept(examined.samples, still)
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
            self._say(Kind.STAGE, f"turn {number} dropped, as requested")
        elif problem:
            self.rejected += 1
            self._say(Kind.REJECTED, f"turn {number} rejected: {problem}")
        else:
            self.here.refused = False
            turn = accepted_turn(segment, examined, self.log, self._before_s, self.here.began_ns)
            self.taken.add(turn)
            note = f"; {segment.note}" if segment.note else ""
            self._say(Kind.ACCEPTED, f"turn {number} accepted: {segment.turn_deg:.0f}° in {segment.turn_s:.1f} s{note}", turn)
            if self.accepted >= self.segments:
                self._segments_done(f"{self.accepted} segments")

    def _drop(self, at_ns: int) -> None:
        """Drop an accepted turn of this log, or the one in progress."""
        turn = self.taken.drop(self.log, at_ns)
        if turn is None:
            self.here.dropped_ns.append(at_ns)
            self._say(Kind.STAGE, "this turn will not count; its data stay")
            return
        self.dropped, self.here.refused = self.dropped + 1, True
        self.asked_for.ends(self.here.now_s if self.coached else None)
        which = f"{turn.segment.turn_deg:.0f}° in {turn.segment.turn_s:.1f} s"
        self._say(Kind.STAGE, f"the last turn is dropped ({which}): left out, its data stay")

    def _segments_done(self, why: str) -> None:
        if not self.closure_s:
            self._finish(why)
            return
        self.stage, self.closure = Stage.CLOSURE, ClosureGuide(self._sensor, self.protocol, self.hold_s, self.closure_s)
        self._say(Kind.READY, f"{why}: now the closure run; {MARK_WORDS}")

    def _finish(self, why: str) -> None:
        self.stage = Stage.DONE
        self._say(Kind.DONE, f"ended, {self.short_of}: {why}" if self.short_of else f"done: {why}")

    def _say(self, kind: Kind, text: str, accepted: AcceptedTurn | None = None) -> None:
        self._messages.append(GuideMessage(kind, text, self.now_s, accepted))


class View(Interface):
    """Shows a guided recording: a screen, lines, or a page."""

    def change(self, change: GuideMessage) -> None:
        """Show a message."""

    def show(self, guide: Guide) -> None:
        """Draw the present state."""
