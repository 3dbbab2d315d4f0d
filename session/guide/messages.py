"""What the guide says: the stage, the instruction of the moment, and what has just changed.  Plain records."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from math import inf

from session.detect.segments import Segment
from session.detect.stills import Noise, Still
from session.log.config import Accelerometer
from session.log.samples import Samples


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
class Change:
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
class Movement:
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
    movements: tuple[Movement, ...] = ()
    sigmas: tuple[tuple[str, float], ...] = ()
    up: tuple[float, float, float] | None = None
    says: str = ""
