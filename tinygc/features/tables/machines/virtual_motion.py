"""The moving part of a virtual table: its axes, its state, and what can go wrong with it.

``tracks`` are the true motion of each motor; the controller states their angle plus what it does not know of (steps lost, a restart).
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from session.base.errors import CalibrationError
from session.base.units import DEG
from session.bench.clocks import Clock
from tinygc.features.tables.machines.description import Description

#: faults, and what each does; where it is given a move, it comes in the middle of it (``AT_ONCE``: when the move is requested)
FAULTS = (
    "estop",  # somebody presses the emergency stop: at rest at once, nothing moves until it is released and cleared
    "limit",  # a limit switch is hit: at rest at once, an alarm that stays
    "cable",  # the cable drops: nothing is heard in either direction; the motion goes on
    "silence",  # the controller hears, and does not answer any more
    "garbled",  # bytes of answers are changed for two seconds
    "late",  # answers come 0.6 s late for five seconds
    "doubled",  # each answer comes twice for five seconds
    "lost_steps",  # the motor loses 5 deg during a move, and the controller does not know it
    "stall",  # a move is acknowledged, and nothing moves
    "wrong_angle",  # the angle that is stated jumps by 30 deg, and stays so
    "home_fails",  # homing ends without the reference mark
    "disabled",  # the amplifier is off: moves are refused
    "endless",  # a move does not end: it goes on beyond its angle
    "restart",  # the controller restarts: at rest, its angles are 0 where it stands
    "unknown_error",  # a request is refused with a code that no manual lists
)
AT_ONCE = ("lost_steps", "stall", "endless", "home_fails")
#: those of the request itself, which does not become a move
REFUSED = ("disabled", "unknown_error")
#: s that a fault of the line takes
DURATION_S = {"garbled": 2.0, "late": 5.0, "doubled": 5.0}
LOST_RAD, JUMP_RAD = 5 * DEG, 30 * DEG
#: an emergency stop brakes so many times harder than a move
BRAKE = 10.0
HOMING_RPS = 20 * DEG


class AxisTrack:
    """What a motor does in time: pieces of constant acceleration, appended by the verbs; a piece takes until the next begins."""

    def __init__(self, angle_rad: float = 0.0):
        #: of each piece: begin s, angle rad, rate rad/s, acceleration rad/s^2
        self._pieces: list[tuple[float, float, float, float]] = [(-np.inf, angle_rad, 0.0, 0.0)]

    @property
    def busy_until_s(self) -> float:
        """When the last move ends; infinite while it turns at a rate."""
        begin_s, _, rate, acceleration = self._pieces[-1]
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
        self._pieces.append((begin_s, before, 0.0, sense * acceleration_rps2))
        self._pieces.append((begin_s + ramp_s, before + sense * peak * ramp_s / 2, sense * peak, 0.0))
        self._pieces.append((begin_s + ramp_s + cruise_s, angle_rad - sense * peak * ramp_s / 2, sense * peak, -sense * acceleration_rps2))
        self._pieces.append((begin_s + 2 * ramp_s + cruise_s, angle_rad, 0.0, 0.0))

    def turn_at(self, begin_s: float, rate_rps: float, acceleration_rps2: float) -> None:
        """From any motion to a rate, through rest if its sign is another; 0 stops."""
        angle, rate = self.state(begin_s)
        self._cut(begin_s)
        t_s = begin_s
        for goal in [0.0, rate_rps] if rate * rate_rps < 0 else [rate_rps]:
            if goal != rate:
                acceleration = np.copysign(acceleration_rps2, goal - rate)
                ramp_s = (goal - rate) / acceleration
                self._pieces.append((t_s, angle, rate, acceleration))
                t_s, angle, rate = t_s + ramp_s, angle + (rate + goal) / 2 * ramp_s, goal
        self._pieces.append((t_s, angle, rate, 0.0))

    def state(self, t_s: float) -> tuple[float, float]:
        """Angle, rad, and rate, rad/s, at a time."""
        begin_s, angle, rate, acceleration = next(piece for piece in reversed(self._pieces) if piece[0] <= t_s)
        since = t_s - begin_s if np.isfinite(begin_s) else 0.0
        return angle + rate * since + acceleration * since**2 / 2, rate + acceleration * since

    def reported(self, t_s: np.ndarray) -> np.ndarray:
        """Angle stated (N,) rad at times (N,) s."""
        begin, angle, rate, acceleration = np.array(self._pieces).T
        at = np.searchsorted(begin, t_s, side="right") - 1
        since = np.where(np.isfinite(begin[at]), t_s - np.where(np.isfinite(begin[at]), begin[at], 0.0), 0.0)
        found: np.ndarray = angle[at] + (rate[at] * since + acceleration[at] * since**2 / 2)
        return found

    def _cut(self, t_s: float) -> None:
        """Forget what was planned after a time."""
        while self._pieces[-1][0] > t_s:
            self._pieces.pop()


@dataclass(frozen=True)
class Fault:
    """A fault of ``FAULTS``: at a time of the table, s, or with its n-th move (from 1; homing counts)."""

    kind: str
    at_s: float = 0.0
    move: int | None = None

    @classmethod
    def parse(cls, text: str) -> tuple[Fault, ...]:
        """``estop@20,stall@move2``.  CalibrationError names the wrong word."""
        found = []
        for word in filter(None, (part.strip() for part in text.split(","))):
            match = re.fullmatch(r"(\w{1,40})(?:@(?:(move)(\d{1,6})|(\d{1,6}(?:\.\d{1,6})?)))?", word)
            if match is None or match[1] not in FAULTS:
                raise CalibrationError(f"--faults {word[:40]!r}: expected NAME@SECONDS or NAME@moveN, NAME one of {', '.join(FAULTS)}")
            found.append(cls(match[1], float(match[4] or 0), int(match[3]) if match[2] else None))
        return tuple(found)


class Mechanics:
    """Axes, and the state of their controller.  Times are seconds of the table, from its start (``begin_s`` of the clock).

    stopped_by: ``estop``, ``limit``, ``home_fails`` or nothing; restarts: how many so far; releases: how often its motors were switched
    off, so that an axis that is not balanced would have fallen.
    """

    def __init__(self, table: Description, clock: Clock, faults: Sequence[Fault]):
        self.description, self._clock = table, clock
        self.begin_s = clock.now_s()
        self.tracks = tuple(AxisTrack() for _ in table.axes)
        self.unknown = [0.0] * len(self.tracks)  #: rad, stated minus true
        self.stopped_by, self.restarts, self.releases = "", 0, 0
        self._moves, self._is_pressed = 0, False
        self._homing_until_s: float | None = None
        self._losing: tuple[int, float, float] | None = None  # axis of a move that loses steps, and rad where it begins and ends
        self._waiting = list(faults)
        self._since_s: dict[str, float] = {}

    def now_s(self) -> float:
        """Seconds since the start; what has happened by then has happened."""
        now_s = self._clock.now_s() - self.begin_s
        for fault in [fault for fault in self._waiting if fault.move is None and fault.at_s <= now_s]:
            self._waiting.remove(fault)
            self._since_s[fault.kind] = fault.at_s
            if fault.kind in ("estop", "limit"):
                self.stopped_by, self._is_pressed = fault.kind, fault.kind == "estop"
                self._stop(fault.at_s, BRAKE)
            elif fault.kind == "restart":
                self.restart(fault.at_s)
        if self._homing_until_s is not None and now_s >= self._homing_until_s:
            self._homing_until_s = None
            self.unknown = [0.0] * len(self.tracks)
        return now_s

    def suffers(self, kind: str) -> bool:
        """Whether a fault is present."""
        now_s = self.now_s()
        if kind in REFUSED and (fault := next((f for f in self._waiting if (f.kind, f.move) == (kind, self._moves + 1)), None)):
            self._waiting.remove(fault)
            self._since_s[kind] = now_s
        return kind in self._since_s and now_s < self._since_s[kind] + DURATION_S.get(kind, float("inf"))

    def once(self, kind: str) -> bool:
        """Whether a fault is present; it is gone afterwards."""
        return self.suffers(kind) and bool(self._since_s.pop(kind, None) is not None)

    @property
    def is_homing(self) -> bool:
        """Whether the reference marks are being searched."""
        self.now_s()
        return self._homing_until_s is not None

    def is_moving(self, axis: int | None = None) -> bool:
        """Whether an axis, or any, is in motion; while homing all are."""
        now_s = self.now_s()
        return self._homing_until_s is not None or any(
            track.busy_until_s > now_s for track in (self.tracks if axis is None else (self.tracks[axis],))
        )

    def reported(self, axis: int) -> float:
        """The angle that the controller states, rad."""
        now_s = self.now_s()
        jump = JUMP_RAD if self.suffers("wrong_angle") else 0.0
        angle = self.tracks[axis].state(now_s)[0]
        if self._losing is not None and self._losing[0] == axis:
            _, begin, end = self._losing
            jump -= LOST_RAD * (end - angle) / abs(end - begin)  # not lost yet
        return angle + self.unknown[axis] + jump

    def turn_to(self, axis: int, reported_rad: float, rate_rps: float) -> None:
        """Begin a move, behind the present one of that axis where there is one."""
        self._count()
        now_s, track = self.now_s(), self.tracks[axis]
        begin_s = max(now_s, track.busy_until_s)
        if begin_s == float("inf"):
            track.turn_at(now_s, 0.0, self._acceleration(axis))
            begin_s = track.busy_until_s
        if self.once("stall"):
            return
        here = track.state(begin_s)[0]
        way = reported_rad - self.unknown[axis] - here
        if self.once("endless"):
            track.turn_at(begin_s, math.copysign(rate_rps, way), self._acceleration(axis))
            return
        self._losing = None
        if self.once("lost_steps"):
            self.unknown[axis] += math.copysign(LOST_RAD, way)  # it lags, whatever its sense
            self._losing = axis, here, reported_rad - self.unknown[axis]
        track.turn_to(begin_s, reported_rad - self.unknown[axis], rate_rps, self._acceleration(axis))
        self._expect(begin_s, track.busy_until_s)

    def turn_at(self, axis: int, rate_rps: float) -> None:
        """Begin to turn at a rate; 0 brings it to rest."""
        self._count()
        now_s = self.now_s()
        if rate_rps and self.once("stall"):
            return
        self.tracks[axis].turn_at(now_s, rate_rps, self._acceleration(axis))
        self._expect(now_s, now_s + 2.0)

    def home(self, rest_rad: float = 0.0) -> bool:
        """Begin to search the reference marks of all axes, which are at angles of zero, and rest next to them; False where it fails."""
        self._count()
        now_s = self.now_s()
        if self.once("home_fails"):
            self.stopped_by = "home_fails"
            return False
        for axis, track in enumerate(self.tracks):
            if track.busy_until_s > now_s:
                track.turn_at(now_s, 0.0, self._acceleration(axis))
            for angle_rad in (0.0, rest_rad):
                track.turn_to(max(track.busy_until_s, now_s), angle_rad, HOMING_RPS, self._acceleration(axis))
        self._homing_until_s = max(now_s, *(track.busy_until_s for track in self.tracks))
        self._expect(now_s, self._homing_until_s)
        return True

    def stop(self, brake: float = 1.0) -> None:
        """Bring all axes to rest."""
        self._stop(self.now_s(), brake)

    def clear(self) -> bool:
        """Forget an alarm; False while the emergency stop is pressed."""
        if self._is_pressed:
            return False
        self.stopped_by = ""
        return True

    def release(self) -> None:
        """Somebody releases the emergency stop; the alarm remains until it is cleared."""
        self._is_pressed = False

    def restart(self, t_s: float | None = None) -> None:
        """Reset the controller: at rest, no alarm, and its angles are 0 where it stands."""
        now_s = self.now_s() if t_s is None else t_s
        self._stop(now_s, BRAKE)
        self.restarts += 1
        self.clear()
        self.unknown = [-track.state(now_s)[0] for track in self.tracks]

    def _stop(self, now_s: float, brake: float) -> None:
        self._homing_until_s = None
        for axis, track in enumerate(self.tracks):
            if track.busy_until_s > now_s:
                track.turn_at(now_s, 0.0, brake * self._acceleration(axis))

    def _acceleration(self, axis: int) -> float:
        return self.description.axes[axis].acceleration_rps2

    def _count(self) -> None:
        self._moves += 1
        for fault in [fault for fault in self._waiting if fault.move == self._moves and fault.kind in AT_ONCE]:
            self._waiting.remove(fault)
            self._since_s[fault.kind] = self.now_s()

    def _expect(self, begin_s: float, end_s: float) -> None:
        """Faults of the middle of this move, at their time."""
        for fault in [fault for fault in self._waiting if fault.move == self._moves]:
            self._waiting.remove(fault)
            self._waiting.append(Fault(fault.kind, (begin_s + end_s) / 2))
