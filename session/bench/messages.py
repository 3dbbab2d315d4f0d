"""What the guide says: stages, instructions, coverage, the movement that the coach asks for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from math import inf

import numpy as np

from session.detect.segments import Segment
from session.detect.stills import Noise, Still
from session.io.config import Accelerometer
from session.io.samples import Samples
from session.io.units import DEG

# What the guide says: the stage, the instruction of the moment, and what has just changed.  Plain records.


class Stage(Enum):
    """Where the session stands."""

    FIND_PORT = "find port"
    CHECK_STREAM = "check stream"
    HOLD_STILL = "hold still"
    TURN = "turn"
    CLOSURE = "closure run"
    PAUSED = "paused"
    DONE = "done"


class Kind(Enum):
    """What a change is about; each has its own sound and colour."""

    STAGE = "stage"
    READY = "ready"  #: the still is long enough: turn now
    ACCEPTED = "accepted"
    REJECTED = "rejected"
    WARNING = "warning"
    DONE = "done"


@dataclass(frozen=True)
class Instruction:
    """What to do now.  why: what it waits for, with the number and its bar; remaining_s of a countdown; part (0 to 1) of it that is done;
    good: whether the condition is met at this moment, so that nothing but time is missing."""

    stage: Stage
    do: str
    why: str = ""
    remaining_s: float | None = None
    part: float | None = None
    good: bool = True


@dataclass(frozen=True, eq=False)
class AcceptedTurn:
    """An accepted segment as the coach gets it: its samples, from the middle of a still to what there is of the next, and the noise.

    segment's sample numbers count from samples' first one; middle_s since the session's first sample.
    """

    segment: Segment
    samples: Samples
    noise: Noise
    log: int
    middle_s: float


@dataclass(frozen=True, eq=False)
class GuideMessage:
    """Something has changed, in words for the operator; accepted: the turn, where one was; dropped: one that does not count any more."""

    kind: Kind
    text: str
    at_s: float = 0.0
    accepted: AcceptedTurn | None = None
    dropped: AcceptedTurn | None = None


@dataclass(frozen=True, eq=False)
class Progress:
    """What a session has so far, for the coach: the turns that count, and all stills, in order, their accelerometer as session.toml has it.

    own: whether nobody has calibrated the accelerometer, so that the stills have to; accelerometer: what they give, None while they do not;
    gyro_fs_rps: the gyroscope's full scale.
    """

    turns: tuple[AcceptedTurn, ...]
    stills: tuple[Still, ...] = ()
    own: bool = False
    accelerometer: Accelerometer | None = None
    gyro_fs_rps: float = inf


@dataclass(frozen=True)
class RequestedTurn:
    """A part of the next movement: axis, a unit vector in the board, upright or level before the movement, and the angle about it."""

    axis: tuple[float, float, float]
    angle_rad: float


@dataclass(frozen=True)
class Advice:
    """What the coach says after a segment.

    words: the next movement; reason: the parameter that it helps, with its sigma beside the target; reached: whether every
    parameter has reached its target; missing: what has not, in words, worst first; movements: the words' turns, one behind the
    other; sigmas: of each parameter its name and its sigma beside its target; up: what of the board points up where the movements
    begin, a unit vector: the board as it lies, set straight; says: of the whole session, such as how many turns are enough.
    """

    words: str
    reason: str
    reached: bool = False
    missing: tuple[str, ...] = ()
    movements: tuple[RequestedTurn, ...] = ()
    sigmas: tuple[tuple[str, float], ...] = ()
    up: tuple[float, float, float] | None = None
    says: str = ""


# The movement that the coach asks for: in the still that it was meant for, until the board is turned; never a moment longer.

COACH_S = 2.0  #: how long the coach is waited for before any turn will do
SETTLING_S = 0.3  #: quiet for so long, a turn is over
BETWEEN = 0.6  #: of still_s: the same between two movements; what lasts 0.7 of it counts as a still
MOST_OF_IT = 0.75  #: of the angles asked for: whoever rests before, rests between two movements


class CoachRequest:
    """advice: what is asked for now; None while the coach thinks, and where it asks for nothing."""

    def __init__(self) -> None:
        self.advice: Advice | None = None
        self._since_s: float | None = None

    def ends(self, now_s: float | None = None) -> None:
        """What was asked for is over: the board lies elsewhere, or other turns count.  now_s: where the coach is asked again."""
        self.advice, self._since_s = None, now_s

    def answered(self, advice: Advice | None) -> None:
        """The coach's word on the board as it lies now."""
        self.advice, self._since_s = advice if advice and advice.words else None, None

    def awaited(self, now_s: float) -> bool:
        """Whether the coach's word is worth waiting for still."""
        return self._since_s is not None and now_s - self._since_s < COACH_S

    def settling_s(self, path_rad: float, still_s: float) -> float:
        """How long the table is quiet where its turn is over, which has come so far; longer where a second movement is still to come."""
        movements = self.advice.movements if self.advice else ()
        goes_on = len(movements) > 1 and path_rad < MOST_OF_IT * sum(abs(movement.angle_rad) for movement in movements)
        return max(SETTLING_S, BETWEEN * still_s) if goes_on else SETTLING_S


# Which attitudes and turn axes the accepted segments cover.

FACES = ("+x", "-x", "+y", "-y", "+z", "-z")
SLANTED = 0.90  #: cosine: an axis further than 26° from the vertical is not up


def face_up(accel: np.ndarray) -> str | None:
    """Which of the sensor's axes points up, from specific force (3,): ``+z``; None where it is slanted."""
    axis = int(np.argmax(np.abs(accel)))
    if abs(accel[axis]) < SLANTED * np.linalg.norm(accel):
        return None
    return f"{'+' if accel[axis] > 0 else '-'}{'xyz'[axis]}"


class Coverage:
    """stills: how many with each face up, and slanted; turned_deg: how far about each axis, each way.

    correct: what is made of the accelerometer's readings; an accelerometer that the stills themselves calibrate is known better later.
    """

    def __init__(self, correct: Callable[[np.ndarray], np.ndarray] = lambda measured: measured) -> None:
        self.correct = correct
        self._forces: list[np.ndarray] = []
        self._turned: list[tuple[AcceptedTurn, dict[str, float]]] = []

    @property
    def stills(self) -> dict[str, int]:
        """Of each face, and ``slanted``."""
        up = [face_up(self.correct(force)) or "slanted" for force in self._forces]
        return {face: up.count(face) for face in (*FACES, "slanted")}

    @property
    def turned_deg(self) -> dict[str, float]:
        """About each axis, each way."""
        return {face: sum(turned[face] for _, turned in self._turned) for face in FACES}

    def still(self, accel: np.ndarray) -> None:
        """A still, with its specific force (3,) as measured."""
        self._forces.append(accel)

    def add(self, turn: AcceptedTurn) -> None:
        """A turn that was accepted."""
        first, last = turn.segment.stills
        rate = turn.samples.gyro - (first.gyro_mean + last.gyro_mean) / 2
        step = np.diff(turn.samples.t_s)[:, None]
        noise = 3 * np.maximum(first.gyro_std, last.gyro_std)  # what the noise alone turns to and fro is no turn
        moved = np.where(np.abs(rate[:-1]) > noise, rate[:-1], 0.0) * step / DEG
        about = {f"+{name}": float(np.sum(moved[:, i], where=moved[:, i] > 0)) for i, name in enumerate("xyz")}
        back = {f"-{name}": -float(np.sum(moved[:, i], where=moved[:, i] < 0)) for i, name in enumerate("xyz")}
        self._turned.append((turn, about | back))

    def drop(self, turn: AcceptedTurn) -> None:
        """A turn that does not count any more; its stills were still all the same."""
        self._turned = [(kept, turned) for kept, turned in self._turned if kept is not turn]
