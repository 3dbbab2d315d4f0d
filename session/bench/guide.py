"""The guided session as a state machine: find port, check stream, still, turn, still, accepted or why not, closure run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import groupby
from typing import Protocol as Interface

from session.base.units import DEG, NS
from session.bench.events import AnyEvent, Event, SampleChunk, joined_chunk
from session.bench.live import CHECK_S, MotionBlock, StreamHealth, TurnInProgress, Wait
from session.bench.messages import AcceptedTurn, Advice, GuideMessage, Instruction, Kind, Stage
from session.bench.progress import AcceptedData, LiveAccelerometerFit, PresentLog, StillExamination, accepted_turn, fastest_ns, why_not
from session.detect.segments import RETURN_RAD, moved_at, run_ends
from session.detect.stills import MIN_STILL_FRACTION, Still, find_stills
from session.log.config import Config, Protocol, Sensor
from session.log.samples import Samples, joined


def joined_chunks(events: Iterable[AnyEvent]) -> Iterator[AnyEvent]:
    """Merge neighbouring chunks: a busy computer reads many small ones at once."""
    for are_chunks, group in groupby(events, lambda event: isinstance(event, SampleChunk)):
        if are_chunks:
            yield joined_chunk([event for event in group if isinstance(event, SampleChunk)])
        else:
            yield from group


def samples_of(chunk: SampleChunk, config: Config) -> Samples:
    """Registers or physical units as SI, with the accelerometer's calibration."""
    gyro, accel, temp_c = chunk.in_si(lambda: config.sensor.register_units)
    return Samples(chunk.t_us * 1000, gyro, config.accelerometer.correct(accel), temp_c)


# The closure run after the last segment: onto the index mark, still, turn freely, back onto the same mark, still.
#
# It is driven by blocks, like the guide.  ``wants`` is the request to begin or keep a file; ``run_ends`` decides whether a run is complete,
# as it will in ``fit``.

STIR_DEG = 2.0  #: a smaller movement is no turn
WAIT_S = 8.0  #: a table that is untouched for so long is on its mark
#: shortest still at either end, as a part of the planned time: the noise is measured on the quietest twentieth of a log
STILL_PART = 0.05
ENOUGH_PART = 0.8  #: of the planned time: a shorter run determines less
AGAIN_S = 10.0  #: a still of this length away from the mark makes its place the new mark
BEGIN, KEEP = Event("begin", text="unclosed"), Event("keep", text="closure")
MARK_WORDS = "set the table onto its index mark, then hands off"


#: steps of a closure run
MARK, STAY, RUN, WHOLE = "onto the mark", "stay", "turn freely", "whole"


class ClosureGuide:
    """Guides a run with planned_s of turning.  wants: the request for the files, until ``decided``; announce: takes messages."""

    def __init__(self, sensor: Sensor, protocol: Protocol, hold_s: float, planned_s: float, announce: Callable[[Kind, str], None]):
        self._sensor, self._protocol, self.planned_s, self._announce = sensor, protocol, planned_s, announce
        self.hold_s = max(hold_s, STILL_PART * planned_s)
        self.wants: Event | None = None
        self._examined = self._went = False
        self._parts: list[Samples] = []
        self._to_the_mark()

    def decided(self, decision: Event) -> None:
        """The request was carried out: a new file has begun, or the last one is kept."""
        self.wants = None
        if decision.kind == "begin":
            self.step = STAY
            self._parts, self._moved_s, self._rested_s, self._here_s = [], 0.0, 0.0, 0.0
        elif decision.kind == "keep":
            self.step = WHOLE

    def interrupted(self) -> None:
        """A new log, a pause, or the operator ends the run before it is complete."""
        if self.step in (STAY, RUN):
            self._announce(Kind.WARNING, "this closure run is not complete, and restarts")
        self._to_the_mark()

    def on_the_mark(self) -> None:
        """The operator confirms that the table is on its mark."""
        if self.step == MARK:
            self._here_s = WAIT_S

    def feed(self, samples: Samples, block_s: float, turn: TurnInProgress) -> None:
        """Take a block of samples, after the turn in progress has."""
        if self.step == MARK:
            self._went = self._went or turn.path_rad > STIR_DEG * DEG
            self._here_s = 0.0 if turn.moving else self._here_s + block_s
            if turn.still_s >= self.hold_s and (self._went or self._here_s >= WAIT_S):
                self.wants = BEGIN
        elif self.step in (STAY, RUN):
            self._parts.append(samples)
            if self.step == STAY:
                self._staying(block_s, turn)
            else:
                self._running(block_s, turn)

    def instruction(self, turn: TurnInProgress) -> Instruction:
        """What to do now, and why the guide waits."""
        if self.step == MARK:
            why = f"{'it moves' if turn.moving else f'still for {turn.still_s:.1f} s'}; if it stands there already, leave it alone"
            return Instruction(Stage.CLOSURE, f"closure run: {MARK_WORDS}", why, good=not turn.moving)
        if self.step == STAY:
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
        self.step, self.wants = MARK, None
        self._parts = []
        self._moved_s = self._rested_s = self._here_s = 0.0
        self._went = False
        self._missing = ""

    def _staying(self, block_s: float, turn: TurnInProgress) -> None:
        if not turn.moving:
            self._rested_s += block_s
            if self._rested_s >= self.hold_s:
                self.step = RUN
                self._announce(Kind.READY, f"turn freely for {self.planned_s:.0f} s through many attitudes, then back onto the mark")
        elif turn.still_s == 0.0:
            if self._rested_s >= MIN_STILL_FRACTION * self.hold_s:
                self.step = RUN
                return
            self._announce(Kind.WARNING, f"too short a still, {self._rested_s:.1f} of {self.hold_s:.1f} s: {MARK_WORDS}")
            self._to_the_mark()

    def _running(self, block_s: float, turn: TurnInProgress) -> None:
        if turn.path_rad > STIR_DEG * DEG or self._moved_s:
            self._moved_s += block_s
        if turn.moving or turn.still_s < self.hold_s:
            self._missing, self._examined = "", False
            return
        if self._moved_s and not self._examined:
            self._examined = True
            self._examine()
        if self._missing and turn.still_s >= AGAIN_S:
            self._announce(Kind.WARNING, "it stays there: that is the mark now, and the run restarts")
            self._to_the_mark()
            self._here_s = WAIT_S

    def _examine(self) -> None:
        """The table rests: decide whether the run is complete."""
        samples = joined(self._parts)
        ends = run_ends(samples, find_stills(samples, self._protocol.still_s)[0], self._sensor)
        if ends is not None and ends.broken:
            self._announce(Kind.REJECTED, f"this closure run is not complete: {ends.broken}; it restarts from here")
            self._to_the_mark()
            self._here_s = WAIT_S
        elif ends is None or not self.enough:
            self._announce(Kind.STAGE, f"{self._moved_s:.0f} of {self.planned_s:.0f} s: turn on")
        elif not ends.returned:
            self._missing = f"{ends.away_rad / DEG:.1f}° from where the run began, {RETURN_RAD / DEG:g}° at most: set it back onto the mark"
            self._announce(Kind.WARNING, self._missing)
        else:
            self.wants = KEEP
            turned_s = float(samples.t_ns[ends.last.start] - samples.t_ns[ends.first.stop - 1]) * NS
            self._announce(Kind.ACCEPTED, f"closure run: {turned_s:.0f} s, back within {ends.away_rad / DEG:.2f}°")


PEAK_FULL_SCALE = 0.85
_ANY_TURN = "turn the board onto another side: by 90°, 180° or 270° about an axis of it that is level, in about 3 s"
HOLD_STILLS = 1.5  #: times the protocol's still_s: a still serves two turns
EXAMINE_EVERY_S = 0.2
NEARLY = 0.85  #: of a rotation: behind it the next one counts, on the page as well (path.js)
FINISH_WORDS = "f finishes"
#: turns that all targets usually need, and a verdict on a sensor that warms up: fewer leave its drift in E (``benchmarks/cold_start.py``)
USUAL_TURNS = 24
REST = "rest"  #: stem of the logs of a rest, in which no turn is looked for
COACH_S = 2.0  #: how long to wait for the coach before any turn is accepted
SETTLING_S = 0.3  #: rest after which a turn has ended
BETWEEN = 0.6  #: times still_s: the same between two rotations of one movement; 0.7 of still_s is a still
MOST_OF_IT = 0.75  #: of the requested angles: a rest before that is a rest between two rotations


class Guide:
    """Leads through turns, ``segments`` at most, then through a closure run with closure_s of turning (0: none).

    stop_at_target ends the turns as soon as every target is met, and a verdict has turns enough.  The guide is driven by samples, in blocks
    of 0.1 s, and by messages about the port; how the samples are divided into portions changes nothing.  It never waits without stating for
    what.
    """

    stem = "log"  #: of the logs that it asks for
    takes_a_log = False  #: whether it examines the samples of logs of its own alone, which it begins before their first sample
    of_a_pause = "not examined"  #: what its samples are

    def __init__(self, protocol: Protocol, segments: int = 40, stop_at_target: bool = False, closure_s: float = 0.0):
        self.protocol, self.segments, self.stop_at_target, self.closure_s = protocol, segments, stop_at_target, closure_s
        self.sensor: Sensor | None = None
        self.closure: ClosureGuide | None = None  #: once the segments are done
        self.stage, self.health, self.taken = Stage.FIND_PORT, StreamHealth(), AcceptedData()
        self.advice: Advice | None = None  #: the last
        self.requested: Advice | None = None  #: of it what is requested now; it holds for one still, until the board is turned
        self._advice_due_since_s: float | None = None
        self.coached = False  #: whether advice is expected after each accepted segment
        self.any_turn = _ANY_TURN  #: what to do where the coach requests nothing
        self.rejected = self.dropped = self.log = 0  #: rejected segments; segments that the operator took back; number of the log
        self._before_s = 0.0  # duration of earlier logs
        self.begun = "" if self.takes_a_log else self.stem  #: stem of the log that the samples go to
        self.board_faults: Mapping[str, int] = {}  #: what the board has reported of itself, by name
        self.keys = ""  # the screen's last line
        self.waits_for = ""  # why no samples come
        self._wait_announced = False
        self._messages: list[GuideMessage] = []
        self._begin_log()

    def begin(self, sensor: Sensor, own: LiveAccelerometerFit | None = None, given_sigma_mg: float | None = None) -> None:
        """The sensor's ranges are known: samples can come.  own: where its accelerometer is not calibrated; given_sigma_mg: where it is."""
        self.sensor = sensor
        self.taken.begin(own, sensor.gyro_fs_dps * DEG, given_sigma_mg)

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
        if len(samples) == 0 or self.stage in (Stage.DONE, Stage.PAUSED) or not self.is_mine:
            return []
        if self.stage is Stage.FIND_PORT:
            self.stage, self.waits_for = Stage.CHECK_STREAM, ""
        self.here.add(samples)
        checking = self.stage is Stage.CHECK_STREAM
        if checking and not self._stream_is_good():
            return self._take_messages()
        self.health.feed(self.here.pending if checking else samples, self.here.pace)
        for block in self.here.blocks():
            if self.stage is not Stage.DONE:
                self._block(block)
        if not self._wait_announced and self.health.temp_slope is not None and (wait := self.wait) is not None:
            self._wait_announced = True
            self._announce(Kind.STAGE, f"begun at once; temperature {self.health.temp_slope:+.1f} °C/min: {wait.words}")
        return self._take_messages()

    def advise(self, advice: Advice | None, stills: int | None = None) -> list[GuideMessage]:
        """Take the coach's advice, given at so many stills; its movement counts only while the board keeps that attitude."""
        self.advice = advice
        if stills in (None, len(self.taken.stills)) and self.turn.path_rad < STIR_DEG * DEG:
            self.requested, self._advice_due_since_s = advice if advice and advice.words else None, None
        if self.stop_at_target and self.enough:
            self._turns_done()
        return self._take_messages()

    def decided(self, decision: Event) -> list[GuideMessage]:
        """Take a decision of the operator, or of the guide itself (``wants``), that the files already hold."""
        if decision.kind == "begin":
            self.begun = decision.text
        if decision.kind == "pause":
            self.stage = Stage.PAUSED
            self._announce(Kind.STAGE, f"paused: samples are stored, {self.of_a_pause}")
        elif not self.is_mine:  # of another kind of recording into this session: nothing is examined
            if decision.kind in ("begin", "finish") and not self.takes_a_log and self.stage is not Stage.DONE:
                self.stage = Stage.PAUSED
        elif self.stage is Stage.PAUSED and decision.kind == "begin":
            self.stage = Stage.CHECK_STREAM
            self.new_log()
            if self.stem != REST:
                self._announce(Kind.STAGE, "it goes on")
        else:
            self._do(decision)
        return self._take_messages()

    def _do(self, decision: Event) -> None:
        """A decision about turns."""
        if decision.kind == "drop":
            self._drop(int(decision.text) * 1000)
        elif decision.kind == "finish" and self.closure is None:
            self._turns_done()
        elif self.closure is not None:
            self.closure.decided(decision)
            self.turn.accepted_still()
            if decision.kind == "keep":
                self._finish()

    @property
    def is_mine(self) -> bool:
        """Whether the samples go to a log that this guide examines."""
        return self.begun == self.stem if self.takes_a_log else self.begun != REST

    @property
    def wants(self) -> Event | None:
        """What is to be done with the files."""
        if self.takes_a_log:
            return None if self.is_mine or self.stage is Stage.PAUSED else Event("begin", text=self.stem)
        return self.closure.wants if self.closure is not None and self.stage is Stage.CLOSURE else None

    @property
    def awaits_advice(self) -> bool:
        """Whether to wait for the coach's advice."""
        return self._advice_due_since_s is not None and self.here.now_s - self._advice_due_since_s < COACH_S

    @property
    def enough(self) -> bool:
        """Whether every target is met, with as many turns as a verdict needs, while turns are still requested: the operator may finish."""
        reached = self.advice is not None and self.advice.reached and self.accepted >= min(USUAL_TURNS, self.segments)
        return reached and self.closure is None and self.stage is not Stage.DONE

    @property
    def met(self) -> tuple[int, int]:
        """How many targets are met, of how many; of none without a coach."""
        sigmas = self.advice.sigmas if self.advice is not None else ()
        return sum(sigma <= 1 for _, sigma in sigmas), len(sigmas)

    @property
    def accepted(self) -> int:
        """Number of turns that count."""
        return len(self.taken.turns)

    @property
    def so_far(self) -> str:
        """What is recorded, in words: ``12 of 12 numbers are good enough after 26 turns``."""
        met, targets = self.met
        turns = f"{self.accepted} turn{'' if self.accepted == 1 else 's'}"
        run = " and a closure run" if self.closure is not None and self.closure.step == WHOLE else ""
        return f"{met} of {targets} numbers are good enough after {turns}{run}" if targets else f"{turns}{run}"

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
        last = self.taken.turns[-1:]
        return (fastest_ns(last[0]) // 1000, "") if last and last[0].log == self.log else (None, "this log holds no accepted turn yet")

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
        """What letting the board warm up before going on would gain."""
        if self.stage not in (Stage.HOLD_STILL, Stage.TURN):
            return None
        planned = min(USUAL_TURNS, self.segments) if self.stop_at_target else self.segments
        return self.health.wait(self.taken.turns, self.taken.stills, planned - self.accepted)

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
            short = self.met[0] < self.met[1]
            do = "the turns are made, but some numbers need more of them" if short else "done: the table may be left"
            return Instruction(stage, do, self.so_far, good=not short)
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
        turn, advice = self.turn, self.requested
        if self.taken.turns and self.awaits_advice and not turn.moving:
            return Instruction(self.stage, "one moment: the coach evaluates the last turn", "for some 2 s at most")
        if self.enough and not turn.moving:
            return Instruction(self.stage, "enough: finish now", f"{self.so_far}; {FINISH_WORDS}, or turn on")
        do = advice.words if advice else self.any_turn
        if not turn.moving:
            made = f"{self.accepted}{'' if self.stop_at_target else f' of {self.segments}'} turns made"
            return Instruction(self.stage, do, advice.reason if advice and advice.reason else made)
        full_scale_dps, peak_dps = self._sensor.gyro_fs_dps, turn.peak_rps / DEG
        turned = f"turned {turn.path_rad / DEG:.0f}° so far"
        if peak_dps > PEAK_FULL_SCALE * full_scale_dps:
            too_fast = f"but {peak_dps:.0f} > {PEAK_FULL_SCALE * full_scale_dps:.0f} dps: slower, or it clips"
            return Instruction(self.stage, do, too_fast, good=False, far=turned)
        before_last = sum(abs(part.angle_rad) for part in advice.movements[:-1]) if advice else 0.0
        then = "then let go" if turn.path_rad >= NEARLY * before_last else "then at once the next turn"
        return Instruction(self.stage, do, f"peak {peak_dps:.0f} of {full_scale_dps:.0f} dps; {then}", far=turned)

    def _expect_advice(self, now_s: float | None = None) -> None:
        """The board has another attitude now, or other turns count.  now_s: when the coach is consulted again, None if it is not."""
        self.requested, self._advice_due_since_s = None, now_s

    def _begin_log(self) -> None:
        self.here = PresentLog()
        self._expect_advice()
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
                self._announce(Kind.WARNING, problem)
            self.waits_for = problem
            return False
        self.waits_for, self.stage = "", Stage.HOLD_STILL if self.closure is None else Stage.CLOSURE
        self._announce(Kind.STAGE, f"the stream is good: {1 / self.here.pending.period_s:.1f} Hz")
        return True

    def _block(self, samples: Samples) -> None:
        block, ended_s = self.here.take(samples, remember=self.closure is None)
        if self.closure is not None:
            self.closure.feed(samples, block.duration_s, self.turn)
        elif self.stage is Stage.TURN:
            self._turning()
        elif block.quiet:
            self._holding(block)
        elif ended_s:
            self._still_ended(ended_s)

    def _turning(self) -> None:
        if self.turn.path_rad < STIR_DEG * DEG:
            self.here.window.rest(self.turn.still_s)
        elif max(self.turn.still_s, self.turn.restless_s) >= self._settling_s():
            self.stage, self.objection = Stage.HOLD_STILL, ""
            self._announce(Kind.STAGE, f"turned {self.turn.path_rad / DEG:.0f}°: now hold still")

    def _settling_s(self) -> float:
        """The rest after which the turn has ended; longer while a second rotation is to come."""
        movements = self.requested.movements if self.requested else ()
        goes_on = len(movements) > 1 and self.turn.path_rad < MOST_OF_IT * sum(abs(movement.angle_rad) for movement in movements)
        return max(SETTLING_S, BETWEEN * self.protocol.still_s) if goes_on else SETTLING_S

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
            self._announce(Kind.WARNING, f"{why}{turns}")

    def _accept_still(self, examined: StillExamination, still: Still) -> None:
        """The present still is a reference; decide whether the turn before it is a segment."""
        segment = examined.segment
        self.here.accept(examined.samples, still)
        self.stage, self.objection = Stage.TURN, ""
        self._expect_advice(self.here.now_s if self.coached else None)
        if self.taken.add_still(still) and (own := self.taken.own) is not None:
            self._announce(Kind.WARNING if own.problem else Kind.STAGE, f"the accelerometer is known: {own.problem or own.words}")
        if segment is None:
            self._announce(Kind.READY, f"the first still holds ({still.duration_s:.1f} s): turn")
            return
        problem, number = why_not(segment), self.accepted + self.rejected + self.dropped  # as `check`, `fit` and `view` count it
        self.here.refused = True
        if any(moved_at(segment, examined.samples, at_ns * NS) for at_ns in self.here.dropped_ns):
            self.dropped += 1
            self._announce(Kind.STAGE, f"turn {number} dropped, as requested")
        elif problem:
            self.rejected += 1
            self._announce(Kind.REJECTED, f"turn {number} rejected: {problem}")
        else:
            self.here.refused = False
            turn = accepted_turn(segment, examined, self.log, self._before_s, self.here.began_ns)
            self.taken.turns.append(turn)
            note = f"; {segment.note}" if segment.note else ""
            self._announce(Kind.ACCEPTED, f"turn {number} accepted: {segment.turn_deg:.0f}° in {segment.turn_s:.1f} s{note}", turn)
            if self.accepted >= self.segments:
                self._turns_done()

    def _drop(self, at_ns: int) -> None:
        """Drop an accepted turn of this log, or the one in progress."""
        turn = self.taken.drop(self.log, at_ns)
        if turn is None:
            self.here.dropped_ns.append(at_ns)
            self._announce(Kind.STAGE, "this turn will not count; its data stay")
            return
        self.dropped, self.here.refused = self.dropped + 1, True
        self._expect_advice(self.here.now_s if self.coached else None)
        which = f"{turn.segment.turn_deg:.0f}° in {turn.segment.turn_s:.1f} s"
        self._announce(Kind.STAGE, f"the last turn is dropped ({which}): left out, its data stay")

    def _turns_done(self) -> None:
        if not self.closure_s:
            self._finish()
            return
        self.stage, self.closure = Stage.CLOSURE, ClosureGuide(self._sensor, self.protocol, self.hold_s, self.closure_s, self._announce)
        self._announce(Kind.READY, f"{self.so_far}: now the closure run; {MARK_WORDS}")

    @property
    def outcome(self) -> str:
        """The recording's result in a sentence."""
        met, targets = self.met
        return f"{'done' if self.stage is Stage.DONE and met == targets else 'ended'}: {self.so_far}"

    def _finish(self) -> None:
        self.stage = Stage.DONE
        self._announce(Kind.DONE, self.outcome)

    def _take_messages(self) -> list[GuideMessage]:
        """The messages since the last call."""
        messages, self._messages = self._messages, []
        return messages

    def _announce(self, kind: Kind, text: str, accepted: AcceptedTurn | None = None) -> None:
        self._messages.append(GuideMessage(kind, text, self.now_s, accepted))


class View(Interface):
    """Shows a guided recording: a screen, lines, or a page."""

    def change(self, change: GuideMessage) -> None:
        """Show a message."""

    def show(self, guide: Guide) -> None:
        """Draw the present state."""


# The place of a machine in a guided recording: it turns the table where an operator would.
#
# ``GuidedRecording`` calls ``step`` in each round, behind the guide and the coach.  A mover makes the turn that the guide waits for; the
# guide finds stills and turns in the sensor's samples as ever.  ``wants`` asks for a decision of the recording, as the guide's does.


@dataclass(frozen=True)
class Moment:
    """Where the recording stands.  log: name of the log that is being written, empty while there is none; t_us: device time of the last
    samples; host_ns: when they arrived, monotonic clock."""

    log: str
    t_us: int
    host_ns: int


class Mover(Interface):
    """Turns the table.  wants: a decision for the recording, until the next ``step``."""

    wants: Event | None

    def step(self, guide: Guide, moment: Moment | None, coaching: bool) -> list[GuideMessage]:
        """Begin what the guide waits for, never wait; moment: None before the first samples; coaching: whether advice is still to come."""
        ...

    def stop(self) -> None:
        """Bring the machine to rest at once, and begin nothing before the recording goes on."""

    def close(self) -> None:
        """The recording ends: bring the machine to rest and let go of it."""
