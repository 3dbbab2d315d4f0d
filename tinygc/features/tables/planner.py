"""The moves of a table that the coach chooses from: one axis, or two after each other, within limits, each with its time.

A move of axis k turns the body about an axis that does not change meanwhile, since only the axes inside of k carry it.  So each move is a
``TurnPart`` of ``tinygc.planning.turns``, with constant accelerations at both ends, and the coach computes its columns as of a hand's turn.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from session.base.errors import CalibrationError
from session.base.units import DEG
from session.bench.guide import USUAL_TURNS
from session.bench.messages import AxisMove
from session.detect.segments import LONGEST_TURN_SEGMENTS
from session.log.config import Protocol
from tinygc.features.tables.machines.description import Description, attitudes, body_axes
from tinygc.planning.coach import MOST_TO_GO, Coach, parameter_name
from tinygc.planning.turns import Turn, TurnPart

#: changes of one axis alone, and of each of two
SINGLES_DEG = (45, 90, 135, 180, 270, 360)
PAIRS_DEG = (90, 180, 270)
#: of the way from limit to limit, where none of the usual changes fits
SHARES = (0.0, 0.5, 1.0)
#: a turn that the guide counts, with some room for scale and play
_LEAST_TURN_RAD = 35 * DEG
#: rad that an axis without limits may turn either way from where it began: a cable may hang on it
MOST_WOUND_RAD = 4 * np.pi
#: s from the end of a move to a still that counts, beyond its length: play and tremor die away, and the answer comes at 20 Hz
SETTLE_S = 0.6
_NOTHING_S, ROUNDING_RAD = 1e-3, 1e-9
#: of an angle, rad: places within half of the last one are the same
PLACE_DECIMALS = 3
MOST_PARTS = 2


def _seconds_of(change_rad: float, rate_rps: float, acceleration_rps2: float) -> tuple[float, float]:
    """Duration of a move from rest to rest, and of each of its two accelerations, s."""
    ramp_s = min(rate_rps / acceleration_rps2, float(np.sqrt(abs(change_rad) / acceleration_rps2)))
    return abs(change_rad) / (ramp_s * acceleration_rps2) + ramp_s, ramp_s


class TableMoves:
    """The moves from ``angles`` (K,) rad, which whoever turns the table keeps up to date.  hold_s: length of a still between two turns;
    longest_s: of a turn, beyond which it is no segment; limits: least and most angle of each axis, rad, that any of them goes to; first:
    the moves to begin with, before there is advice."""

    def __init__(self, table: Description, angles: np.ndarray, hold_s: float, seed: int = 0):
        self.table, self.angles, self.hold_s = table, np.array(angles, dtype=float), hold_s
        self.limits = [
            (at - MOST_WOUND_RAD, at + MOST_WOUND_RAD) if axis.is_endless else (axis.least_rad, axis.most_rad)
            for axis, at in zip(table.axes, self.angles, strict=True)
        ]
        self.longest_s = LONGEST_TURN_SEGMENTS * Protocol().segment_s
        self.first: tuple[AxisMove, ...] = ()
        self._rng = np.random.default_rng(seed)
        self._found: dict[tuple[float, ...], list[Turn]] = {}

    def turns_from(self, angles: np.ndarray | None, most_rps: float) -> list[Turn]:
        """Return all turns from angles, None: the present ones; those from the same place are the same list.  Raises CalibrationError where
        the limits allow none."""
        start = self.angles if angles is None else angles
        place = (*np.round(start, PLACE_DECIMALS).tolist(), most_rps, self.hold_s, self.longest_s)
        if place not in self._found:
            changes = list(self._changes(start))
            places = np.repeat(np.array(start, dtype=float)[None, None], len(changes), axis=0).repeat(MOST_PARTS + 1, axis=1)
            for turn, parts in enumerate(changes):
                for number, (axis, change) in enumerate(parts):
                    places[turn, number + 1 :, axis] += change
            flat = places.reshape(-1, places.shape[-1])
            about = body_axes(self.table, flat).reshape(*places.shape, 3)
            up = -attitudes(self.table, flat)[:, 2].reshape(*places.shape[:2], 3)
            found = [self._turn(*each, most_rps) for each in zip(changes, places, about, up, strict=True)]
            self._found[place] = [turn for turn in found if sum(part.seconds + SETTLE_S for part in turn.parts) <= self.longest_s]
        if not self._found[place]:
            least = f"no turn of {_LEAST_TURN_RAD / DEG:.0f} deg or more"
            raise CalibrationError(
                f"{self.table.name}: {least} lies within the limits of its axes and ends within {self.longest_s:g} s, the longest segment"
            )
        return self._found[place]

    def reach_rad(self, axis: int) -> float:
        """How far an axis turns at most in one turn that is short enough for a segment."""
        of = self.table.axes[axis]
        within_s, ramp_s = self.longest_s - SETTLE_S, of.fastest_rps / of.acceleration_rps2
        return of.fastest_rps * (within_s - ramp_s) if within_s > 2 * ramp_s else of.acceleration_rps2 * within_s**2 / 4

    def choose(self, most_rps: float) -> tuple[AxisMove, ...]:
        """Return any turn from the present angles, where nothing is requested."""
        planned, self.first = self.first, ()
        if planned and all(move.rate_rps <= most_rps for move in planned):
            return planned
        turns = self.turns_from(None, most_rps)
        return turns[int(self._rng.integers(len(turns)))].moves

    def _changes(self, start: np.ndarray) -> Iterator[tuple[tuple[int, float], ...]]:
        """Yield (axis, change rad) of one axis, then of two after each other."""
        singles = [(axis, change) for axis in range(len(start)) for change in self._of_axis(axis, start[axis], SINGLES_DEG)]
        yield from ((each,) for each in singles)
        pairs = [(axis, change) for axis in range(len(start)) for change in self._of_axis(axis, start[axis], PAIRS_DEG)]
        yield from ((one, other) for one in pairs for other in pairs if one[0] != other[0])

    def _of_axis(self, axis: int, at_rad: float, usual_deg: tuple[int, ...]) -> list[float]:
        """Changes of an axis that its limits allow: the usual ones, and to places between its limits."""
        least, most = self.limits[axis]
        changes = [sign * degrees * DEG for degrees in usual_deg for sign in (1.0, -1.0)]
        if not self.table.axes[axis].is_endless:
            changes += [least + share * (most - least) - at_rad for share in SHARES]
        within = [change for change in changes if least - ROUNDING_RAD <= at_rad + change <= most + ROUNDING_RAD]
        return [change for change in dict.fromkeys(within) if abs(change) >= _LEAST_TURN_RAD]

    def _turn(self, changes: tuple[tuple[int, float], ...], places: np.ndarray, about: np.ndarray, up: np.ndarray, most_rps: float) -> Turn:
        """A turn.  Before it and after each part: places (N, K) rad; about (N, K, 3): the axes; up (N, 3): what points up, of the body."""
        parts, moves = list[TurnPart](), list[AxisMove]()
        for number, (axis, change) in enumerate(changes):
            of, angle = self.table.axes[axis], float(places[number + 1, axis])
            rate = min(of.fastest_rps, most_rps)
            seconds, ramp_s = _seconds_of(change, rate, of.acceleration_rps2)
            words = f"{of.name} to {angle / DEG:.0f}°"
            parts.append(TurnPart(about[number, axis] * np.sign(change), abs(change), seconds, words, up[number + 1], ramp_s))
            moves.append(AxisMove(axis, angle, rate))
        cost_s = sum(part.seconds for part in parts) + SETTLE_S + self.hold_s
        nothing = TurnPart(np.zeros(3), 0.0, _NOTHING_S, "", up[0])
        return Turn(nothing, tuple(parts), cost_s, tuple(moves), places[len(changes)])


def plan_of(moves: TableMoves, own: bool, segments: int, stop_at_target: bool) -> tuple[tuple[Turn, ...], tuple[str, ...]]:
    """Plan a session from the present angles: the turns that the coach would choose if all went well, and the names of the parameters that
    no turns of this table show, however many.

    own: whether the accelerometer is not calibrated.  The session itself chooses by what it has seen, so its turns may differ; their limits
    do not.
    """
    rehearsal = Coach(machine=moves).rehearse(own, max(segments, MOST_TO_GO))
    turns = rehearsal.turns[:segments]
    least = min(USUAL_TURNS, segments) if stop_at_target else segments
    turns += tuple(turns[number % len(turns)] for number in range(len(turns), least))  # every target is met: they are like those before
    unseen = [] if len(rehearsal.turns) < MOST_TO_GO else np.flatnonzero(rehearsal.unseen).tolist()
    return turns, tuple(map(parameter_name, unseen))
