"""Messages of a guided session: stage, instruction, accepted turns, and the coach's advice."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
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
    def reason(self) -> str:
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

    @property
    def rate(self) -> np.ndarray:
        """(N, 3) rad/s, the bias of the stills around it taken off."""
        first, last = self.segment.stills
        return self.samples.gyro - (first.gyro_mean + last.gyro_mean) / 2

    @cached_property
    def turned_deg(self) -> np.ndarray:
        """(6,) the rotation about +x, -x, +y, -y, +z, -z; computed once."""
        first, last = self.segment.stills
        noise = 3 * np.maximum(first.gyro_std, last.gyro_std)  # rates within the noise are no rotation
        rate = self.rate[:-1]
        moved = np.where(np.abs(rate) > noise, rate, 0.0) * np.diff(self.samples.t_s)[:, None] / DEG
        return np.stack([moved, -moved], axis=2).clip(0.0).sum(axis=0).ravel()


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
    stills: tuple[Still, ...] = ()  #: all, in order; their accelerometer is corrected by session.toml
    own: bool = False  #: whether the accelerometer has no calibration but the session's own stills
    accelerometer: Accelerometer | None = None  #: that calibration, once there is one
    gyro_fs_rps: float = inf  #: full scale
    given_sigma_mg: float | None = None  #: of each number of a given accelerometer calibration, where session.toml states it


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
