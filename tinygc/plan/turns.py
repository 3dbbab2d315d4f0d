"""Turns that an operator can be asked for, from an attitude, and what each would tell: its columns of the linear sensitivity.

One movement, or two without a rest between, each about one axis that a hand knows: the board's own axis that stands upright, or one that
is level; by quarter turns.  The board is taken for set straight before, on the side that it lies nearest to, and it ends on a side.  So
"by 90° about y" and "until -x is up" are the same turn, and the errors of the last turn are not carried on.  Words, picture
and estimate are of this one turn.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from session.common.units import DEG
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.residual import Batch
from tinygc.models import linear
from tinygc.plan.lying import nearest_up, on_a_side, straight, up_words

QUARTERS = (90, 180, 270, 360)
#: an accelerometer's axes are seen askew only between the sides: such a turn ends on an edge, or begins there
EIGHTHS = (45, 90, 135, 180, 225, 270, 315, 360)
MOST_DEG = 360  #: of two movements together: what one hand does
SINGLE_S, PAIR_S = 3.0, 4.0  #: of one movement; of two, shared by their angles; longer where the full scale is small
SLANTED_RAD = 20 * DEG  #: a board that lies further from straight is to be set straight in so many words
PEAK = 2.0  #: of a smooth turn's rate, beside its mean
STRAIGHT_S = 1.0  #: of setting it straight, where the estimate reckons with it
STILL_S, RATE_HZ = 1.0, 20.0
LEVEL = 0.1  #: cosine, on sides and edges: below it an axis is level


@dataclass(frozen=True, eq=False)
class TurnPart:
    """A movement about one axis (3,), a unit vector of the body; words: what to do, and what is up then; up (3,): the same, in the body."""

    axis: np.ndarray
    angle_rad: float
    seconds: float
    words: str
    up: np.ndarray


@dataclass(frozen=True, eq=False)
class Turn:
    """What lies between two stills.  straightened: how the board is set straight first; up (3,) unit: what of it points up then."""

    straightened: TurnPart
    parts: tuple[TurnPart, ...]

    @property
    def up(self) -> np.ndarray:
        """(3,) unit: what of the board points up where the movements begin."""
        return self.straightened.up

    @property
    def words(self) -> str:
        """What to do, for the operator."""
        said = ", then at once ".join(part.words for part in self.parts)
        return f"{self.straightened.words}turn {said} ({sum(part.seconds for part in self.parts):.0f} s)"

    def carries(self, accel: np.ndarray) -> np.ndarray:
        """What a still accelerometer that read accel (3,) before the turn reads after it."""
        return self.parts[-1].up * np.linalg.norm(accel)


def turns_from(accel: np.ndarray, singles_deg: tuple[int, ...] = QUARTERS, most_rps: float = np.inf) -> list[Turn]:
    """All turns from a still in which the accelerometer reads accel (3,); singles_deg: the angles; most_rps: no turn's peak is above."""
    up = nearest_up(accel, with_edges=singles_deg != QUARTERS)
    straightened = _straightened(accel / np.linalg.norm(accel), up)
    together = [pair for pair in product([degrees for degrees in singles_deg if degrees < 300], repeat=2) if sum(pair) <= MOST_DEG]

    def lasts(degrees: int, least_s: float) -> float:
        return max(least_s, PEAK * degrees * DEG / most_rps)

    singles = [Turn(straightened, (part,)) for degrees in singles_deg for part in parts_from(up, degrees, lasts(degrees, SINGLE_S))]
    pairs = [
        Turn(straightened, (first, second))
        for one, other in together
        for first in parts_from(up, one, lasts(one + other, PAIR_S) * one / (one + other))
        for second in parts_from(first.up, other, lasts(one + other, PAIR_S) * other / (one + other), "its")
        if abs(first.axis @ second.axis) < LEVEL  # about the same axis it would be one turn
    ]
    return singles + pairs


def columns(accel: np.ndarray, turns: list[Turn]) -> np.ndarray:
    """(M, 2, 12) rad per unit of each parameter: what each turn adds, begun where the accelerometer reads accel (3,)."""
    movements = [(turn.straightened, *turn.parts) for turn in turns]
    lengths = np.array([sum(part.seconds for part in parts) for parts in movements])[:, None] + 2 * STILL_S
    t = np.arange(0, lengths.max(), 1 / RATE_HZ)
    rate = np.zeros((len(turns), len(t), 3))
    began = np.full((len(turns), 1), STILL_S)
    for parts in _abreast(movements):
        angle, seconds = (np.array([getattr(part, name) for part in parts])[:, None] for name in ("angle_rad", "seconds"))
        speed = angle / seconds * PEAK * np.sin(np.pi * np.clip((t - began) / seconds, 0, 1)) ** 2
        rate += speed[..., None] * np.array([part.axis for part in parts])[:, None]
        began = began + seconds
    dt = (t[1:] <= lengths) / RATE_HZ
    start = np.broadcast_to(rotation.from_gravity(accel), (len(turns), 4))
    batch = Batch(rate, dt, np.zeros_like(rate), start, start, yaw_known=False)
    return linear.columns(closure.sensitivity(batch, rate), rate)[:, :2]


def ends(accel: np.ndarray, turns: list[Turn]) -> tuple[np.ndarray, np.ndarray]:
    """Attitudes (M, 4) before and after each turn, begun where the accelerometer reads accel (3,)."""
    first = np.broadcast_to(rotation.from_gravity(accel), (len(turns), 4))
    last = first
    for parts in _abreast([(turn.straightened, *turn.parts) for turn in turns]):
        last = rotation.multiply(last, rotation.exp(np.array([part.axis * part.angle_rad for part in parts])))
    return first, last


_NOTHING = TurnPart(np.zeros(3), 0.0, 1.0, "", np.zeros(3))


def _abreast(movements: list[tuple[TurnPart, ...]]) -> list[list[TurnPart]]:
    """The first part of each, then the second of each, and so on."""
    most = max(map(len, movements))
    return [[parts[number] if number < len(parts) else _NOTHING for parts in movements] for number in range(most)]


def _straightened(lies: np.ndarray, up: np.ndarray) -> TurnPart:
    """The shortest way from where lies (3,) points up to where ``up`` does."""
    axis, angle = np.cross(up, lies), float(np.arccos(np.clip(up @ lies, -1.0, 1.0)))
    length = np.linalg.norm(axis)
    axis = axis / length if length > 0 else axis
    how = f"with {up_words(up)} set straight up" if on_a_side(up) else f"on its edge with {up_words(up)} up"
    words = f"{how}, " if angle > SLANTED_RAD else ""
    return TurnPart(axis, angle, STRAIGHT_S, words, up)


def parts_from(up: np.ndarray, degrees: int, seconds: float, whose: str = "the board's") -> list[TurnPart]:
    """About what stands upright, and about what is level, both ways.  up (3,): what points up before."""
    return list(_parts_from(tuple(up.tolist()), degrees, seconds, whose))


@cache  # there are 18 ways to lie, and every advice needs some hundred movements
def _parts_from(lies: tuple[float, ...], degrees: int, seconds: float, whose: str) -> tuple[TurnPart, ...]:
    up, angle, found = np.array(lies), degrees * DEG, []
    if degrees % 90 == 0:
        axis_words = f"{whose} {up_words(up).removeprefix('-')} axis" if on_a_side(up) else "the vertical"
        for sense, side in ((1.0, "left"), (-1.0, "right")):
            words = f"{degrees}° to the {side} about {axis_words}, {up_words(up)} {'stays' if on_a_side(up) else 'stay'} up"
            found.append(TurnPart(sense * up, angle, seconds, words, up))
    for axis, name in zip(np.eye(3), "xyz", strict=True):
        if abs(axis @ up) > LEVEL:
            continue
        for sense in (1.0, -1.0):
            first, last = (_turned(up, sense * axis, each) for each in (90 if on_a_side(up) else 45, degrees))
            passes = "" if np.array_equal(first, last) else f", {up_words(first)} up first,"
            words = f"{degrees}° about {whose} {name} axis (level){passes} until {up_words(last)} {'is' if on_a_side(last) else 'are'} up"
            found.append(TurnPart(sense * axis, angle, seconds, words, last))
    return tuple(found)


def _turned(up: np.ndarray, axis: np.ndarray, degrees: int) -> np.ndarray:
    """What of the board points up after a turn about a level axis of it."""
    return straight(rotation.matrix(rotation.exp(axis * degrees * DEG)).T @ up)
