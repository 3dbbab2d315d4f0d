"""What a guided session has so far: the window since the last still, the log that grows, accepted turns and stills."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from session.bench.live import CHECK_S, FEWEST, MotionBlock, Stillness, TurnInProgress, stream_problem
from session.bench.messages import AcceptedTurn, Coverage, Progress
from session.detect.accelerometer import LengthFit, attitudes_of, fit_lengths
from session.detect.segments import Pace, Segment, cut_segments, pace_of
from session.detect.stills import MIN_STILL_FRACTION, Noise, Still, block_size, find_stills
from session.io.config import Accelerometer, Protocol, Sensor
from session.io.samples import Samples, joined
from session.io.units import MG, NS

# The samples since the last reference stills, and what ``session.detect.stills`` and ``session.detect.segments`` make of them.
#
# The very code that will judge the recorded log judges it here: what the guide accepts, the fit accepts.

REFERENCES = 3  #: stills that are kept: their noise is the yardstick
LONGEST_REST_S = 20.0  #: of a still that lasts, the last part is kept
SETTLED_S = 0.5  #: a still that ended longer ago is not the present one


@dataclass(frozen=True, eq=False)
class StillExamination:
    """The present still, or why there is none; segment that it ends, None for a log's first still; samples that both count from."""

    samples: Samples
    still: Still | None
    why: str = ""
    noise: Noise | None = None
    segment: Segment | None = None


class Window:
    """The recent part of one log.  period_s: the usual time between two samples."""

    def __init__(self, sensor: Sensor, protocol: Protocol, period_s: float):
        self._sensor, self._protocol = sensor, protocol
        self._size, self._period_s = block_size(period_s), period_s
        self._parts: list[Samples] = []
        self._starts_ns: list[int] = []  # of the reference stills in it

    @property
    def has_reference(self) -> bool:
        """Whether a still was accepted."""
        return bool(self._starts_ns)

    def feed(self, samples: Samples) -> None:
        """Later samples."""
        self._parts.append(samples)

    def examine(self) -> StillExamination:
        """What stands at the window's end."""
        samples = self._whole()
        stills, noise = find_stills(samples, self._protocol.still_s)
        still = stills[-1] if stills else None
        late_s = SETTLED_S + self._size * self._period_s
        if still is None or samples.t_ns[-1] - samples.t_ns[still.stop - 1] > late_s / NS:
            return StillExamination(samples, None, f"still for less than {MIN_STILL_FRACTION * self._protocol.still_s:.1f} s")
        if still.problem:
            return StillExamination(samples, None, still.problem)
        segments = cut_segments(samples, stills, self._sensor, self._protocol) if self._starts_ns else []
        return StillExamination(samples, still, "", noise, segments[-1] if segments else None)

    def accept(self, examined: StillExamination) -> None:
        """The present still is a reference from now on; what lies before the last few is forgotten."""
        assert examined.still is not None
        self._starts_ns = [*self._starts_ns, int(examined.samples.t_ns[examined.still.start])][-REFERENCES:]
        self._forget_before(self._starts_ns[0])

    def rest(self, still_s: float) -> None:
        """The present still, a reference, has lasted for still_s: of a long one only the last part is kept."""
        if still_s > 2 * LONGEST_REST_S and self._starts_ns and self.duration_s > 2 * LONGEST_REST_S:
            keep_ns = int(self._parts[-1].t_ns[-1]) - round(LONGEST_REST_S / NS)
            self._starts_ns = [keep_ns]
            self._forget_before(keep_ns)

    @property
    def duration_s(self) -> float:
        """Of what is kept, s."""
        return float(self._parts[-1].t_ns[-1] - self._parts[0].t_ns[0]) * NS if self._parts else 0.0

    def _forget_before(self, t_ns: int) -> None:
        samples = self._whole()
        first = int(np.searchsorted(samples.t_ns, t_ns)) // self._size * self._size  # blocks stay where they were
        self._parts = [samples.between(first, len(samples))]

    def _whole(self) -> Samples:
        if len(self._parts) > 1:
            self._parts = [joined(self._parts)]
        return self._parts[0]


# The log that grows at this moment: its first second is looked at, then it is taken block by block.


class PresentLog:
    """turn: what the table does now; why: what its last block showed; peak_ns: when the present turn was fastest; began_ns: the first
    sample; dropped_ns: moments of turns that will not count; refused: whether the last turn does not."""

    def __init__(self) -> None:
        self.turn = TurnInProgress()
        self.why = ""
        self.began_ns = self.peak_ns = self._now_ns = 0
        self.dropped_ns: list[int] = []
        self.refused = False
        self._period_s = 0.0
        self._pace: Pace | None = None
        self._pending: list[Samples] = []
        self._window: Window | None = None
        self._stillness: Stillness | None = None

    @property
    def now_s(self) -> float:
        """Since it began."""
        return (self._now_ns - self.began_ns) * NS

    @property
    def checked_s(self) -> float:
        """Of samples that wait to be looked at."""
        return sum(part.duration_s for part in self._pending)

    @property
    def window(self) -> Window:
        """The recent part of the log; there is one as soon as its stream has been looked at."""
        assert self._window is not None
        return self._window

    @property
    def pace(self) -> Pace:
        """Of its stamps, there as soon."""
        assert self._pace is not None
        return self._pace

    @property
    def _at_rest(self) -> Stillness:
        """The judge of blocks, there as soon."""
        assert self._stillness is not None
        return self._stillness

    def add(self, samples: Samples) -> None:
        """Samples that have come."""
        self._pending.append(samples)

    @property
    def pending(self) -> Samples:
        """What has come, and is not in a block yet."""
        return joined(self._pending)

    def look(self, sensor: Sensor, protocol: Protocol, calibrated: bool) -> str | None:
        """What is wrong with the stream, which then is looked at anew; empty where nothing is; None while too little has come."""
        pending = self.pending
        if pending.duration_s < CHECK_S or len(pending) < FEWEST:
            return None
        if problem := stream_problem(pending, sensor.odr_hz, sensor.accel_fs_g, calibrated):
            self._pending = []
            return problem
        if self._window is None:
            self._period_s, self.began_ns, self._now_ns = pending.period_s, int(pending.t_ns[0]), int(pending.t_ns[0])
            self._pace = pace_of(pending.t_ns)
            self._window = Window(sensor, protocol, self._period_s)
            self._stillness = Stillness(self._period_s)
        return ""

    def blocks(self) -> Iterator[Samples]:
        """Whole blocks of what has come; the rest waits."""
        pending, size = self.pending, block_size(self._period_s)
        whole = len(pending) // size * size
        self._pending = [pending.between(whole, len(pending))]
        for first in range(0, whole, size):
            yield pending.between(first, first + size)

    def take(self, samples: Samples, remember: bool) -> tuple[MotionBlock, float]:
        """A block: what it shows, and how long the still was that it ends, or 0.  remember: it may be part of a segment."""
        self._now_ns = int(samples.t_ns[-1])
        if remember:
            self.window.feed(samples)
        block = self._at_rest.feed(samples)
        self.why = block.why
        ended_s = self.turn.feed(block, self._at_rest.zero_rps)
        if block.peak_rps == self.turn.peak_rps:
            self.peak_ns = int(samples.t_ns[len(samples) // 2])
        return block, ended_s

    def accept(self, examined: StillExamination) -> None:
        """The present still is a reference."""
        assert examined.still is not None
        self.window.accept(examined)
        self._at_rest.zero_rps = examined.still.gyro_mean
        self.turn.accepted_still()


# An accelerometer that nobody has calibrated: the stills do it as they come in.

#: of its nominal sensitivity: an accelerometer that is further off has another full scale, not another sensitivity
SCALE_RIGHT = 0.2


class LiveAccelerometerFit:
    """``add`` stills.  accelerometer: what they give, None while they fix nothing of it; known: whether they fix all of it; attitudes: how
    many of them lie apart."""

    def __init__(self, gravity_mps2: float) -> None:
        self._gravity_mps2 = gravity_mps2
        self.stills: list[Still] = []
        self.attitudes = 0
        self.accelerometer: Accelerometer | None = None
        self._lacks: tuple[str, ...] = ()

    def add(self, still: Still) -> None:
        """A still, its accelerometer as measured."""
        self.stills.append(still)
        self.attitudes = attitudes_of(self.force)
        fit, self.accelerometer = _fitted(self.force, self._gravity_mps2)
        self._lacks = fit.unobserved

    @property
    def known(self) -> bool:
        """Whether all of its numbers are."""
        return self.accelerometer is not None and not self._lacks

    @property
    def force(self) -> np.ndarray:
        """(S, 3) m/s^2 as measured."""
        return np.array([still.accel_mean for still in self.stills]).reshape(-1, 3)

    def correct(self, measured: np.ndarray) -> np.ndarray:
        """Specific force (..., 3) by what is known so far; as measured while nothing is."""
        return measured if self.accelerometer is None else self.accelerometer.correct(measured)

    @property
    def spread_mg(self) -> tuple[float, float | None]:
        """Standard deviation of gravity's length over the stills: as measured, and calibrated (None while nothing is known); 0 of none."""
        if not self.stills:
            return 0.0, None
        before, after = (np.linalg.norm(force, axis=1) / MG for force in (self.force, self.correct(self.force)))
        return float(np.std(before)), None if self.accelerometer is None else float(np.std(after))

    @property
    def words(self) -> str:
        """The live figure."""
        if not self.stills:
            return "no stills yet"
        before, after = self.spread_mg
        lie = f"{len(self.stills)} stills in {self.attitudes} attitudes"
        if after is None:
            return f"{lie}; gravity's spread {before:.1f} mg"
        says = f"{lie}; gravity's spread {before:.1f} mg before, {after:.2f} mg after"
        return says if self.known else f"{says} (not all of it yet)"

    @property
    def problem(self) -> str:
        """What no calibration may be, in words; empty where nothing is wrong."""
        if self.accelerometer is None:
            return ""
        scale = float(np.mean(np.diag(self.accelerometer.matrix)))
        if abs(scale - 1) <= SCALE_RIGHT:
            return ""
        return f"gravity reads {1 / scale:.2f} g in all attitudes: is the accelerometer's full scale right?"


def _fitted(force: np.ndarray, gravity_mps2: float) -> tuple[LengthFit, Accelerometer | None]:
    """The one place that asks for a calibration; None where the stills fix nothing of it."""
    scale = float(np.median(np.linalg.norm(force, axis=1))) / gravity_mps2
    scale = scale if abs(scale - 1) > SCALE_RIGHT else 1.0  # of another full scale: a robust fit does not come from so far
    found = fit_lengths(force / scale, gravity_mps2)
    if found.rung is None:
        return found, None
    given = found.accelerometer
    return found, replace(given, matrix=given.matrix / scale, bias_mps2=given.bias_mps2 * scale)


# What a session has so far: the turns that count, the stills, what they cover, and the accelerometer that they calibrate.

LEAST_TURN_DEG = 30.0  #: what turns less is not counted: it tells next to nothing


class AcceptedData:
    """turns that count, in order; stills; coverage; own: the accelerometer that the stills calibrate, None where one was given;
    gyro_fs_rps: the gyroscope's full scale, once it is known."""

    def __init__(self) -> None:
        self.turns: list[AcceptedTurn] = []
        self.stills: list[Still] = []
        self.coverage = Coverage()
        self.own: LiveAccelerometerFit | None = None
        self.gyro_fs_rps = np.inf

    def begin(self, own: LiveAccelerometerFit | None, gyro_fs_rps: float) -> None:
        """It is known now whether somebody has calibrated the accelerometer, and what the gyroscope can measure."""
        self.own, self.gyro_fs_rps = own, gyro_fs_rps
        if own is not None:
            self.coverage.correct = own.correct

    @property
    def progress(self) -> Progress:
        """For the coach."""
        own = self.own
        accelerometer = own.accelerometer if own is not None else None
        return Progress(tuple(self.turns), tuple(self.stills), own is not None, accelerometer, self.gyro_fs_rps)

    def add_still(self, still: Still) -> bool:
        """A still that is a reference.  Whether the accelerometer is known now, and was not before."""
        self.stills.append(still)
        self.coverage.still(still.accel_mean)
        if self.own is None:
            return False
        known = self.own.known
        self.own.add(still)
        return not known and self.own.known

    def add(self, turn: AcceptedTurn) -> None:
        """A turn that was accepted."""
        self.turns.append(turn)
        self.coverage.add(turn)

    def last_of(self, log: int) -> AcceptedTurn | None:
        """The last turn that counts, if it is of this log."""
        return self.turns[-1] if self.turns and self.turns[-1].log == log else None

    def drop(self, log: int, at_ns: int) -> AcceptedTurn | None:
        """Take back the turn that moved at that moment of a log; None where no accepted one did."""
        for turn in self.turns:
            if turn.log == log and turn.samples.t_ns[0] <= at_ns <= turn.samples.t_ns[-1]:
                self.turns = [kept for kept in self.turns if kept is not turn]
                self.coverage.drop(turn)
                return turn
        return None


def why_not(segment: Segment) -> str | None:
    """Why a segment does not count, or None."""
    if segment.problem or segment.turn_deg >= LEAST_TURN_DEG:
        return segment.problem
    return f"no turn: {segment.turn_deg:.0f}° < {LEAST_TURN_DEG:.0f}°; turn by 90° or more"


def fastest_ns(turn: AcceptedTurn) -> int:
    """The moment of a turn's highest rate: whoever looks for the turn again finds it there."""
    first, last = turn.segment.stills
    rate = np.linalg.norm(turn.samples.gyro - (first.gyro_mean + last.gyro_mean) / 2, axis=1)
    return int(turn.samples.t_ns[int(np.argmax(rate))])


def accepted_turn(segment: Segment, examined: StillExamination, log: int, before_s: float, began_ns: int) -> AcceptedTurn:
    """A segment as the coach gets it.  before_s: of the session, in earlier logs; began_ns: this log's first sample."""
    assert examined.noise is not None  # a still, which ends a segment, shows it
    samples = examined.samples.between(segment.start, segment.stop)
    middle_s = before_s + float((int(samples.t_ns[0]) + int(samples.t_ns[-1])) // 2 - began_ns) * NS
    return AcceptedTurn(segment, samples, examined.noise, log, middle_s)
