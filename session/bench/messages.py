"""Messages of a guided session: stage, instruction, accepted turns, the coach's advice, and the attitudes covered so far."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from math import inf

import numpy as np

from session.base.units import DEG
from session.detect.segments import Segment
from session.detect.stills import Noise, Still
from session.log.config import Accelerometer
from session.log.samples import Samples


class Stage(Enum):
    """Stage of a guided session."""

    FIND_PORT = "find port"
    CHECK_STREAM = "check stream"
    HOLD_STILL = "hold still"
    TURN = "turn"
    CLOSURE = "closure run"
    PAUSED = "paused"
    DONE = "done"


class Kind(Enum):
    """Kind of a guide message; each has its own sound and colour."""

    STAGE = "stage"
    READY = "ready"  #: the still is long enough: turn now
    ACCEPTED = "accepted"
    REJECTED = "rejected"
    WARNING = "warning"
    DONE = "done"


@dataclass(frozen=True)
class Instruction:
    """The present instruction to the operator."""

    stage: Stage
    do: str  #: what to do now
    why: str = ""  #: what the guide waits for, as a number and its limit
    remaining_s: float | None = None  #: of a countdown
    part: float | None = None  #: 0 to 1, the completed part of the countdown
    good: bool = True  #: whether only time is missing
    far: str = ""  #: how far a turn has gone, where ``why`` speaks of it; a picture of the turn shows it itself

    @property
    def says(self) -> str:
        """``far`` and ``why`` in a line."""
        return f"{self.far}, {self.why}" if self.far else self.why


@dataclass(frozen=True, eq=False)
class AcceptedTurn:
    """An accepted segment for the coach."""

    segment: Segment  #: its sample numbers count from the first of ``samples``
    samples: Samples  #: from the middle of one still to what there is of the next
    noise: Noise
    log: int
    middle_s: float  #: since the session's first sample


@dataclass(frozen=True, eq=False)
class GuideMessage:
    """A change of state, in words for the operator."""

    kind: Kind
    text: str
    at_s: float = 0.0
    accepted: AcceptedTurn | None = None  #: the turn that was accepted


@dataclass(frozen=True, eq=False)
class Progress:
    """A snapshot of the session for the coach, whose thread reads it while the session goes on."""

    turns: tuple[AcceptedTurn, ...]  #: those that count
    stills: tuple[Still, ...] = ()  #: all, in order; their accelerometer is corrected as session.toml says
    own: bool = False  #: whether the accelerometer has no calibration but the session's own stills
    accelerometer: Accelerometer | None = None  #: that calibration, once there is one
    gyro_fs_rps: float = inf  #: full scale


@dataclass(frozen=True)
class RequestedTurn:
    """One rotation of a requested movement, about a unit axis in the board's frame."""

    axis: tuple[float, float, float]  #: vertical or level before the movement
    angle_rad: float
    words: str = ""  #: what to do, of this rotation alone


@dataclass(frozen=True)
class AxisMove:
    """One axis of a machine to an angle, rad, at most at a rate, rad/s."""

    axis: int
    angle_rad: float
    rate_rps: float


@dataclass(frozen=True)
class Advice:
    """The coach's advice after a segment."""

    words: str  #: the next movement
    reason: str  #: the parameter that it improves, with its sigma and its target
    reached: bool = False  #: whether every parameter has reached its target
    missing: tuple[str, ...] = ()  #: parameters above their target, worst first
    movements: tuple[RequestedTurn, ...] = ()  #: the rotations of ``words``, in order
    sigmas: tuple[tuple[str, float], ...] = ()  #: name of each parameter, and its sigma divided by its target
    up: tuple[float, float, float] | None = None  #: unit vector in the board's frame that is vertical where the movements begin
    moves: tuple[AxisMove, ...] = ()  #: the rotations of ``words`` for a machine that turns the table, one after the other


COACH_S = 2.0  #: how long to wait for the coach before any turn is accepted
SETTLING_S = 0.3  #: rest after which a turn has ended
BETWEEN = 0.6  #: times still_s: the same between two rotations of one movement; 0.7 of still_s is a still
MOST_OF_IT = 0.75  #: of the requested angles: a rest before that is a rest between two rotations


class CoachRequest:
    """The movement that the coach requests; it holds for one still, until the board is turned.

    advice is None while the coach computes, and where it requests nothing.
    """

    def __init__(self) -> None:
        self.advice: Advice | None = None
        self._since_s: float | None = None

    def ends(self, now_s: float | None = None) -> None:
        """The board has another attitude now, or other turns count.  now_s: when the coach is asked again, None if it is not."""
        self.advice, self._since_s = None, now_s

    def answered(self, advice: Advice | None) -> None:
        """The coach's advice for the present attitude."""
        self.advice, self._since_s = advice if advice and advice.words else None, None

    def awaited(self, now_s: float) -> bool:
        """Whether to wait for the coach's advice."""
        return self._since_s is not None and now_s - self._since_s < COACH_S

    def settling_s(self, path_rad: float, still_s: float) -> float:
        """The rest after which a turn of path_rad so far has ended; longer while a second rotation is to come."""
        movements = self.advice.movements if self.advice else ()
        goes_on = len(movements) > 1 and path_rad < MOST_OF_IT * sum(abs(movement.angle_rad) for movement in movements)
        return max(SETTLING_S, BETWEEN * still_s) if goes_on else SETTLING_S


FACES = ("+x", "-x", "+y", "-y", "+z", "-z")
SLANTED = 0.90  #: cosine: an axis further than 26° from the vertical is not up


def face_up(accel: np.ndarray) -> str | None:
    """The sensor axis that points up, such as ``+z``, from specific force (3,); None where the sensor is slanted."""
    axis = int(np.argmax(np.abs(accel)))
    if abs(accel[axis]) < SLANTED * np.linalg.norm(accel):
        return None
    return f"{'+' if accel[axis] > 0 else '-'}{'xyz'[axis]}"


class Coverage:
    """Attitudes of the stills and rotation axes of the accepted turns.

    correct maps measured specific force (3,) to calibrated force.  The faces are computed when read, since an accelerometer that the
    stills calibrate is known better later.
    """

    def __init__(self) -> None:
        self.correct: Callable[[np.ndarray], np.ndarray] | None = None
        self._forces: list[np.ndarray] = []
        self._turned: list[tuple[AcceptedTurn, dict[str, float]]] = []

    def corrected(self, force: np.ndarray) -> np.ndarray:
        """Calibrated specific force (3,)."""
        return force if self.correct is None else self.correct(force)

    @property
    def stills(self) -> dict[str, int]:
        """Number of stills with each face up, and ``slanted``."""
        up = [face_up(self.corrected(force)) or "slanted" for force in self._forces]
        return {face: up.count(face) for face in (*FACES, "slanted")}

    @property
    def turned_deg(self) -> dict[str, float]:
        """Total rotation about each axis in each direction."""
        return {face: sum(turned[face] for _, turned in self._turned) for face in FACES}

    def still(self, accel: np.ndarray) -> None:
        """Add a still by its measured specific force (3,)."""
        self._forces.append(accel)

    def add(self, turn: AcceptedTurn) -> None:
        """Add an accepted turn."""
        first, last = turn.segment.stills
        rate = turn.samples.gyro - (first.gyro_mean + last.gyro_mean) / 2
        step = np.diff(turn.samples.t_s)[:, None]
        noise = 3 * np.maximum(first.gyro_std, last.gyro_std)  # rates within the noise are no rotation
        moved = np.where(np.abs(rate[:-1]) > noise, rate[:-1], 0.0) * step / DEG
        about = {f"+{name}": float(np.sum(moved[:, i], where=moved[:, i] > 0)) for i, name in enumerate("xyz")}
        back = {f"-{name}": -float(np.sum(moved[:, i], where=moved[:, i] < 0)) for i, name in enumerate("xyz")}
        self._turned.append((turn, about | back))

    def drop(self, turn: AcceptedTurn) -> None:
        """Remove a turn that no longer counts; its stills remain."""
        self._turned = [(kept, turned) for kept, turned in self._turned if kept is not turn]
