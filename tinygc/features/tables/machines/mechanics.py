"""What a real table does when it is told to turn: the motion of an axis in time, and the errors between its word and the truth.

The angle that a machine says of axis k, alpha, and the true one, with the sense s of its last motion (+1, -1, 0 before any):

    alpha_true = alpha + i1 sin alpha + i2 cos alpha + i3 sin 2 alpha + i4 cos 2 alpha      index: an encoder's eccentricity
                 + r sin(n alpha + phase)                                                   rate ripple: a motor's steps, a worm
                 - s backlash / 2 + lost                                                    play; steps that the motor lost
    R_tb = Rot(tilt) prod_k Rot(wobble_k(alpha)) Rot(a_k + skew_k, alpha_true,k) M

tilt: the base against the vertical; skew_k: an axis is not where it should be (its component along a_k says nothing); wobble_k(alpha) =
w1 cos alpha e1 + w2 sin alpha e2 + w3 cos alpha e2 + w4 sin alpha e1, e1 and e2 normal to a_k.  The angle is said ``latency_s`` late.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from tinygc.features.tables.machines.description import Description, rotations


@dataclass(frozen=True, eq=False)
class AxisErrors:
    """Errors of one axis, rad: index (4,), ripple and its cycles a turn and phase, backlash, lost (of the steps so far; one for all
    angles, or one for each), skew (3,), wobble (4,)."""

    index: np.ndarray = field(default_factory=lambda: np.zeros(4))
    ripple: float = 0.0
    ripple_cycles: int = 0
    ripple_phase: float = 0.0
    backlash: float = 0.0
    lost: float | np.ndarray = 0.0
    skew: np.ndarray = field(default_factory=lambda: np.zeros(3))
    wobble: np.ndarray = field(default_factory=lambda: np.zeros(4))

    def true_angle(self, said: np.ndarray, sense: np.ndarray) -> np.ndarray:
        """(N,) rad, of what the machine says (N,) rad and the sense (N,) of its last motion."""
        i1, i2, i3, i4 = self.index
        index = i1 * np.sin(said) + i2 * np.cos(said) + i3 * np.sin(2 * said) + i4 * np.cos(2 * said)
        ripple = self.ripple * np.sin(self.ripple_cycles * said + self.ripple_phase)
        return said + index + ripple - sense * self.backlash / 2 + self.lost


@dataclass(frozen=True, eq=False)
class TableErrors:
    """Errors of a table: of each axis; tilt (3,) rad of its base; latency_s of its word."""

    axes: tuple[AxisErrors, ...]
    tilt: np.ndarray = field(default_factory=lambda: np.zeros(3))
    latency_s: float = 0.0

    @classmethod
    def none(cls, table: Description) -> TableErrors:
        """A perfect table."""
        return cls(tuple(AxisErrors() for _ in table.axes))


def true_attitudes(table: Description, errors: TableErrors, said: np.ndarray, sense: np.ndarray) -> np.ndarray:
    """``R_tb`` (N, 3, 3) with all errors, of angles said (N, K) rad and the senses (N, K) of the axes' last motions."""
    product = np.broadcast_to(_small(errors.tilt), (len(said), 3, 3))
    for k, (axis, of) in enumerate(zip(table.axes, errors.axes, strict=True)):
        alpha, (e1, e2) = said[:, k], normals(axis.direction)
        cos, sin = np.cos(alpha)[:, None], np.sin(alpha)[:, None]
        w1, w2, w3, w4 = of.wobble
        wobble = (w1 * cos + w4 * sin) * e1 + (w2 * sin + w3 * cos) * e2
        skewed = axis.direction + of.skew
        turned = rotations(skewed / np.linalg.norm(skewed), of.true_angle(alpha, sense[:, k]))
        product = product @ _small(wobble) @ turned
    return product @ table.mounting


def normals(direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Two unit vectors (3,) normal to a unit direction (3,) and to each other, right-handed with it."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    e1 = np.cross(other, direction)
    e1 = e1 / np.linalg.norm(e1)
    return e1, np.cross(direction, e1)


def _small(vector: np.ndarray) -> np.ndarray:
    """(…, 3, 3) rotations by vectors (…, 3) rad."""
    from scipy.spatial.transform import Rotation

    flat = np.atleast_2d(vector)
    return Rotation.from_rotvec(flat).as_matrix().reshape(*np.shape(vector)[:-1], 3, 3)


#: a play too small for any encoder: its whole way is one step
NO_PLAY_RAD = 1e-9


class AxisTrack:
    """What a motor does in time: pieces of constant acceleration, appended by the verbs; a piece lasts until the next begins.

    ``backlash`` rad is the play between motor and stage, ``word`` the angle that the machine says, which is the motor's.
    """

    def __init__(self, angle_rad: float = 0.0, backlash: float = 0.0):
        self._backlash = backlash
        #: of each piece: begin s, angle rad, rate rad/s, acceleration rad/s^2, sense at its begin
        self._pieces: list[tuple[float, float, float, float, float]] = [(-np.inf, angle_rad, 0.0, 0.0, 0.0)]

    @property
    def busy_until_s(self) -> float:
        """When the last move ends; infinite while it turns at a rate."""
        begin_s, _, rate, acceleration, _ = self._pieces[-1]
        return float("inf") if rate or acceleration else begin_s

    def turn_to(self, begin_s: float, angle_rad: float, rate_rps: float, acceleration_rps2: float) -> None:
        """From rest to an angle: one acceleration up, one down, at most at that rate between."""
        before, rate = self.state(begin_s)
        assert not rate  # the caller waits for rest, or stops
        self._cut(begin_s)
        change = angle_rad - before
        if not change:
            return
        sense = np.sign(change)
        ramp_s = min(rate_rps / acceleration_rps2, float(np.sqrt(abs(change) / acceleration_rps2)))
        peak = ramp_s * acceleration_rps2
        cruise_s = abs(change) / peak - ramp_s
        self._add(begin_s, before, 0.0, sense * acceleration_rps2)
        self._add(begin_s + ramp_s, before + sense * peak * ramp_s / 2, sense * peak, 0.0)
        self._add(begin_s + ramp_s + cruise_s, angle_rad - sense * peak * ramp_s / 2, sense * peak, -sense * acceleration_rps2)
        self._add(begin_s + 2 * ramp_s + cruise_s, angle_rad, 0.0, 0.0)

    def turn_at(self, begin_s: float, rate_rps: float, acceleration_rps2: float) -> None:
        """From any motion to a rate, through rest if its sign is another; 0 stops."""
        angle, rate = self.state(begin_s)
        self._cut(begin_s)
        t_s = begin_s
        for goal in [0.0, rate_rps] if rate * rate_rps < 0 else [rate_rps]:
            if goal != rate:
                acceleration = np.copysign(acceleration_rps2, goal - rate)
                ramp_s = (goal - rate) / acceleration
                self._add(t_s, angle, rate, acceleration)
                t_s, angle, rate = t_s + ramp_s, angle + (rate + goal) / 2 * ramp_s, goal
        self._add(t_s, angle, rate, 0.0)

    def state(self, t_s: float) -> tuple[float, float]:
        """Angle, rad, and rate, rad/s, at a time."""
        begin_s, angle, rate, acceleration, _ = next(piece for piece in reversed(self._pieces) if piece[0] <= t_s)
        since = t_s - begin_s if np.isfinite(begin_s) else 0.0
        return angle + rate * since + acceleration * since**2 / 2, rate + acceleration * since

    def said_and_sense(self, t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Angle said (N,) rad and sense (N,) at times (N,) s: the sense is where in its play the stage hangs, -1 to 1."""
        begin, angle, rate, acceleration, sense = np.array(self._pieces).T
        at = np.searchsorted(begin, t_s, side="right") - 1
        since = np.where(np.isfinite(begin[at]), t_s - np.where(np.isfinite(begin[at]), begin[at], 0.0), 0.0)
        change = rate[at] * since + acceleration[at] * since**2 / 2
        return angle[at] + change, np.clip(sense[at] + 2 * change / max(self._backlash, NO_PLAY_RAD), -1.0, 1.0)

    def _add(self, begin_s: float, angle: float, rate: float, acceleration: float) -> None:
        sense = float(self.said_and_sense(np.array([begin_s]))[1][0])
        self._pieces.append((begin_s, angle, rate, acceleration, sense))

    def _cut(self, t_s: float) -> None:
        """Forget what was planned after a time."""
        while self._pieces[-1][0] > t_s:
            self._pieces.pop()
