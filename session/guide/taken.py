"""What a session has so far: the turns that count, the stills, what they cover, and the accelerometer that they calibrate."""

from __future__ import annotations

import numpy as np

from session.common.units import NS
from session.detect.segments import Segment
from session.detect.stills import Still
from session.guide.coverage import Coverage
from session.guide.messages import AcceptedTurn, Progress
from session.guide.own_accelerometer import OwnAccelerometer
from session.guide.window import Examined

LEAST_TURN_DEG = 30.0  #: what turns less is not counted: it tells next to nothing


class Taken:
    """turns that count, in order; stills; coverage; own: the accelerometer that the stills calibrate, None where one was given;
    gyro_fs_rps: the gyroscope's full scale, once it is known."""

    def __init__(self) -> None:
        self.turns: list[AcceptedTurn] = []
        self.stills: list[Still] = []
        self.coverage = Coverage()
        self.own: OwnAccelerometer | None = None
        self.gyro_fs_rps = np.inf

    def begin(self, own: OwnAccelerometer | None, gyro_fs_rps: float) -> None:
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


def accepted_turn(segment: Segment, examined: Examined, log: int, before_s: float, began_ns: int) -> AcceptedTurn:
    """A segment as the coach gets it.  before_s: of the session, in earlier logs; began_ns: this log's first sample."""
    assert examined.noise is not None  # a still, which ends a segment, shows it
    samples = examined.samples.between(segment.start, segment.stop)
    middle_s = before_s + float((int(samples.t_ns[0]) + int(samples.t_ns[-1])) // 2 - began_ns) * NS
    return AcceptedTurn(segment, samples, examined.noise, log, middle_s)
