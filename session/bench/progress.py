"""What a guided session has so far: the window since the last still, the present log, accepted turns and stills."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from session.base.numeric import median_length
from session.base.units import NS
from session.bench.live import CHECK_S, FEWEST, MotionBlock, Stillness, TurnInProgress, stream_problem
from session.bench.messages import AcceptedTurn, Progress
from session.detect.accelerometer import attitudes_of, fit_lengths, force_of
from session.detect.check_references import UNITS_RIGHT, spread_mg
from session.detect.segments import Segment, cut_segments
from session.detect.stills import MIN_STILL_FRACTION, Noise, Still, block_size, find_stills
from session.log.config import Accelerometer, Protocol, Sensor
from session.log.samples import Samples, joined
from session.log.stamps import Pace

# The samples since the last reference stills.  ``find_stills`` and ``cut_segments`` examine them here as they will examine the recorded
# log, so a turn that the guide accepts is a segment in ``fit``.

REFERENCES = 3  #: stills that are kept; the noise is estimated from them
LONGEST_REST_S = 20.0  #: of a long still the last part is kept
SETTLED_S = 0.5  #: a still that ended longer ago is not the present one


@dataclass(frozen=True, eq=False)
class StillExamination:
    """The present still, or None and why; the segment that it ends (None for a log's first still); the samples that both index."""

    samples: Samples
    still: Still | None
    why: str = ""
    noise: Noise | None = None
    segment: Segment | None = None


class Window:
    """The recent part of one log.  period_s: the usual sample interval."""

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
        """Append later samples."""
        self._parts.append(samples)

    def examine(self) -> StillExamination:
        """Find the still at the window's end, and the segment that it ends."""
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

    def accept(self, samples: Samples, still: Still) -> None:
        """Make the examined still a reference; samples before the last few references are dropped."""
        self._starts_ns = [*self._starts_ns, int(samples.t_ns[still.start])][-REFERENCES:]
        self._drop_before(self._starts_ns[0])

    def rest(self, still_s: float) -> None:
        """Shorten a reference still that has lasted for still_s to its last part."""
        if still_s > 2 * LONGEST_REST_S and self._starts_ns and self.duration_s > 2 * LONGEST_REST_S:
            self._starts_ns = [int(self._parts[-1].t_ns[-1]) - round(LONGEST_REST_S / NS)]
            self._drop_before(self._starts_ns[0])

    @property
    def duration_s(self) -> float:
        """Duration of the kept samples."""
        return float(self._parts[-1].t_ns[-1] - self._parts[0].t_ns[0]) * NS if self._parts else 0.0

    def _drop_before(self, t_ns: int) -> None:
        samples = self._whole()
        first = int(np.searchsorted(samples.t_ns, t_ns)) // self._size * self._size  # block boundaries stay where they were
        self._parts = [samples.between(first, len(samples))]

    def _whole(self) -> Samples:
        if len(self._parts) > 1:
            self._parts = [joined(self._parts)]
        return self._parts[0]


class PresentLog:
    """The log that grows now: its first second is checked, then it is taken block by block.

    window, pace and stillness exist once the stream has passed the check.
    """

    window: Window
    pace: Pace
    stillness: Stillness

    def __init__(self) -> None:
        self.turn = TurnInProgress()
        self.why = ""  #: why the last block was not quiet
        self.began_ns = self.peak_ns = self._now_ns = 0  #: the first sample; the highest rate of the present turn; the last sample
        self.dropped_ns: list[int] = []  #: moments of turns that will not count
        self.refused = False  #: whether the last turn does not count
        self._checked = False
        self._pending: list[Samples] = []

    @property
    def now_s(self) -> float:
        """Time since it began."""
        return (self._now_ns - self.began_ns) * NS

    @property
    def unchecked_s(self) -> float:
        """Duration of the samples that wait for the check."""
        return sum(part.duration_s for part in self._pending)

    @property
    def pending(self) -> Samples:
        """Samples that are in no block yet."""
        return joined(self._pending)

    def add(self, samples: Samples) -> None:
        """Append samples that have arrived."""
        self._pending.append(samples)

    def check(self, sensor: Sensor, protocol: Protocol, calibrated: bool) -> str | None:
        """What is wrong with the stream, whose next samples are checked again; empty if nothing is; None for too few samples."""
        pending = self.pending
        if pending.duration_s < CHECK_S or len(pending) < FEWEST:
            return None
        if problem := stream_problem(pending, sensor.odr_hz, sensor.accel_fs_g, calibrated):
            self._pending = []
            return problem
        if not self._checked:
            self._checked, self.began_ns, self._now_ns = True, int(pending.t_ns[0]), int(pending.t_ns[0])
            self.pace, self.stillness = pending.pace, Stillness(pending.period_s)
            self.window = Window(sensor, protocol, pending.period_s)
        return ""

    def blocks(self) -> Iterator[Samples]:
        """Whole blocks of what has arrived; the rest waits."""
        pending, size = self.pending, self.stillness.size
        whole = len(pending) // size * size
        self._pending = [pending.between(whole, len(pending))]
        for first in range(0, whole, size):
            yield pending.between(first, first + size)

    def take(self, samples: Samples, remember: bool) -> tuple[MotionBlock, float]:
        """Take a block; returns its motion, and the length of the still that it ends, or 0.  remember: it may be part of a segment."""
        self._now_ns = int(samples.t_ns[-1])
        if remember:
            self.window.feed(samples)
        block = self.stillness.feed(samples)
        self.why = block.why
        ended_s = self.turn.feed(block, self.stillness.zero_rps)
        if block.peak_rps == self.turn.peak_rps:
            self.peak_ns = int(samples.t_ns[len(samples) // 2])
        return block, ended_s

    def accept(self, samples: Samples, still: Still) -> None:
        """Make the examined still a reference."""
        self.window.accept(samples, still)
        self.stillness.zero_rps = still.gyro_mean
        self.turn.accepted_still()


class LiveAccelerometerFit:
    """Calibrates an uncalibrated accelerometer from the stills as they arrive.

    accelerometer: the calibration, None while the stills determine nothing; known: whether they determine all of it.
    """

    def __init__(self, gravity_mps2: float) -> None:
        self._gravity_mps2 = gravity_mps2
        self.stills: list[Still] = []
        self.attitudes = 0  #: number of different attitudes
        self.accelerometer: Accelerometer | None = None
        self.known = False

    def add(self, still: Still) -> None:
        """Add a still, its specific force as measured."""
        self.stills.append(still)
        force = force_of(self.stills)
        self.attitudes = attitudes_of(force)
        scale = median_length(force) / self._gravity_mps2
        scale = scale if abs(scale - 1) > UNITS_RIGHT else 1.0  # another full scale: the robust fit does not converge from so far
        fit = fit_lengths(force / scale, self._gravity_mps2)
        if fit.rung is None:
            self.accelerometer, self.known = None, False
        else:
            given = fit.accelerometer
            self.accelerometer = replace(given, matrix=given.matrix / scale, bias_mps2=given.bias_mps2 * scale)
            self.known = fit.fixes_all

    def correct(self, measured: np.ndarray) -> np.ndarray:
        """Specific force (..., 3) m/s^2 by the calibration so far; as measured without one."""
        return measured if self.accelerometer is None else self.accelerometer.correct(measured)

    @property
    def spread_mg(self) -> tuple[float, float | None]:
        """Standard deviation of gravity's length over the stills: as measured, and calibrated (None without a calibration)."""
        if not self.stills:
            return 0.0, None
        measured = force_of(self.stills)
        before, after = (spread_mg(np.linalg.norm(force, axis=1)) for force in (measured, self.correct(measured)))
        return before, None if self.accelerometer is None else after

    @property
    def words(self) -> str:
        """The spread of gravity, for the screen."""
        if not self.stills:
            return "no stills yet"
        before, after = self.spread_mg
        spread = f"{_counted(len(self.stills), 'still')}, {_counted(self.attitudes, 'attitude')}: gravity spreads by {before:.1f} mg"
        if after is None:
            return spread
        return f"{spread}, calibrated {after:.2f} mg{'' if self.known else ' so far'}"

    @property
    def problem(self) -> str:
        """Why this cannot be a calibration; empty if it can."""
        if self.accelerometer is None:
            return ""
        scale = float(np.mean(np.diag(self.accelerometer.matrix)))
        if abs(scale - 1) <= UNITS_RIGHT:
            return ""
        return f"gravity reads {1 / scale:.2f} g in all attitudes: is the accelerometer's full scale right?"


def _counted(count: int, what: str) -> str:
    return f"{count} {what}{'s' * (count != 1)}"


LEAST_TURN_DEG = 30.0  #: a smaller turn is not counted: it determines next to nothing


FACES = ("+x", "-x", "+y", "-y", "+z", "-z")
SLANTED = 0.90  #: cosine: an axis further than 26° from the vertical is not up


def face_up(accel: np.ndarray) -> str:
    """The sensor axis that points up, such as ``+z``, from specific force (3,); ``slanted`` where none does."""
    axis = int(np.argmax(np.abs(accel)))
    if abs(accel[axis]) < SLANTED * np.linalg.norm(accel):
        return "slanted"
    return f"{'+' if accel[axis] > 0 else '-'}{'xyz'[axis]}"


class AcceptedData:
    """The turns that count, in order, and all stills; the accelerometer that they calibrate (None where one was given)."""

    def __init__(self) -> None:
        self.turns: list[AcceptedTurn] = []
        self.stills: list[Still] = []
        self.own: LiveAccelerometerFit | None = None
        self.gyro_fs_rps = np.inf  #: full scale, once it is known
        self.given_sigma_mg: float | None = None

    def begin(self, own: LiveAccelerometerFit | None, gyro_fs_rps: float, given_sigma_mg: float | None) -> None:
        """The sensor's calibration and full scale are known."""
        self.own, self.gyro_fs_rps, self.given_sigma_mg = own, gyro_fs_rps, given_sigma_mg

    def corrected(self, force: np.ndarray) -> np.ndarray:
        """Calibrated specific force (3,), by what is known now."""
        return force if self.own is None else self.own.correct(force)

    @property
    def stills_up(self) -> dict[str, int]:
        """Number of stills with each face up, and ``slanted``."""
        up = Counter(face_up(self.corrected(still.accel_mean)) for still in self.stills)
        return {face: up[face] for face in (*FACES, "slanted")}

    @property
    def turned_deg(self) -> dict[str, float]:
        """Total rotation about each axis in each direction."""
        return dict(zip(FACES, sum((turn.turned_deg for turn in self.turns), np.zeros(6)).tolist(), strict=True))

    @property
    def progress(self) -> Progress:
        """A snapshot for the coach."""
        own = self.own
        accelerometer = own.accelerometer if own is not None else None
        return Progress(tuple(self.turns), tuple(self.stills), own is not None, accelerometer, self.gyro_fs_rps, self.given_sigma_mg)

    def add_still(self, still: Still) -> bool:
        """Add a reference still; returns whether it has completed the accelerometer's calibration."""
        self.stills.append(still)
        if self.own is None:
            return False
        known = self.own.known
        self.own.add(still)
        return not known and self.own.known

    def drop(self, log: int, at_ns: int) -> AcceptedTurn | None:
        """Remove and return the turn that moved at that moment of a log; None where no accepted one did."""
        for turn in self.turns:
            if turn.log == log and turn.samples.t_ns[0] <= at_ns <= turn.samples.t_ns[-1]:
                self.turns = [kept for kept in self.turns if kept is not turn]
                return turn
        return None


def why_not(segment: Segment) -> str | None:
    """Why a segment does not count, or None."""
    if segment.problem or segment.turn_deg >= LEAST_TURN_DEG:
        return segment.problem
    return f"no turn: {segment.turn_deg:.0f}° < {LEAST_TURN_DEG:.0f}°; turn by 90° or more"


def fastest_ns(turn: AcceptedTurn) -> int:
    """The moment of a turn's highest rate, by which the turn is found again."""
    return int(turn.samples.t_ns[int(np.argmax(np.linalg.norm(turn.rate, axis=1)))])


def accepted_turn(segment: Segment, examined: StillExamination, log: int, before_s: float, began_ns: int) -> AcceptedTurn:
    """A segment for the coach.  before_s: duration of earlier logs; began_ns: this log's first sample."""
    assert examined.noise is not None  # a still that ends a segment comes with it
    samples = examined.samples.between(segment.start, segment.stop)
    middle_s = before_s + float((int(samples.t_ns[0]) + int(samples.t_ns[-1])) // 2 - began_ns) * NS
    return AcceptedTurn(segment, samples, examined.noise, log, middle_s)
