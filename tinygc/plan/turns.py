"""Turns that an operator can be asked for, from an attitude, and what each would tell: its columns of the linear sensitivity.

About one of the sensor's own axes or about the vertical, by quarter turns, one such turn or two without a rest between: what can be said
in one sentence and done by one hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from session.common.units import DEG
from session.guide.coverage import face_up
from tinygc import closure
from tinygc.attitude import rotation
from tinygc.closure.residual import Batch
from tinygc.models import linear

QUARTERS = (90, 180, 270, 360)
#: an accelerometer's axes are seen askew only between the faces
HALVES = (45, 90, 135, 180, 225, 270, 315, 360)
SINGLE_S, DOUBLE_S = 3.0, 2.0  #: of one turn alone; of each of two
STILL_S, RATE_HZ = 1.0, 20.0
VERTICAL = 0.90  #: cosine above which an axis is called vertical
TOWARDS = (("y", "z"), ("z", "x"), ("x", "y"))  #: a positive turn about x takes y towards z, …


@dataclass(frozen=True, eq=False)
class TurnPart:
    """A turn about one axis: axis (3,) unit, in the body as it lies before; words without angle and time."""

    axis: np.ndarray
    angle_rad: float
    seconds: float
    words: str

    def carries(self, accel: np.ndarray) -> np.ndarray:
        """What a still accelerometer that read accel (3,) before the turn reads after it."""
        return rotation.matrix(rotation.exp(self.axis * self.angle_rad)).T @ accel


@dataclass(frozen=True, eq=False)
class Turn:
    """What lies between two stills."""

    parts: tuple[TurnPart, ...]

    @property
    def words(self) -> str:
        """What to do, for the operator."""
        said = ", then at once ".join(f"{part.words} by {part.angle_rad / DEG:.0f}°" for part in self.parts)
        return f"turn {said}; about {sum(part.seconds for part in self.parts):.0f} s"

    def carries(self, accel: np.ndarray) -> np.ndarray:
        """What a still accelerometer that read accel (3,) before the turn reads after it."""
        for part in self.parts:
            accel = part.carries(accel)
        return accel


def turns_from(accel: np.ndarray, singles_deg: tuple[int, ...] = QUARTERS) -> list[Turn]:
    """All turns from a still in which the accelerometer reads accel (3,); singles_deg: angles of those that stand alone."""
    singles = [Turn((part,)) for part in _parts(accel, singles_deg, SINGLE_S)]
    doubles = [
        Turn((first, second))
        for first in _parts(accel, (90, 180, 270), DOUBLE_S)
        for second in _parts(first.carries(accel), (90, 180, 270), DOUBLE_S)
        if abs(first.axis @ second.axis) < VERTICAL  # on about the same axis would be one turn
    ]
    return singles + doubles


def columns(accel: np.ndarray, turns: list[Turn]) -> np.ndarray:
    """(M, 2, 12) rad per unit of each parameter: what each turn adds, begun where the accelerometer reads accel (3,)."""
    lengths = np.array([sum(part.seconds for part in turn.parts) for turn in turns])[:, None] + 2 * STILL_S
    t = np.arange(0, lengths.max(), 1 / RATE_HZ)
    rate = np.zeros((len(turns), len(t), 3))
    began = np.full((len(turns), 1), STILL_S)
    for number in range(max(len(turn.parts) for turn in turns)):
        parts = [turn.parts[number] if number < len(turn.parts) else _NOTHING for turn in turns]
        angle, seconds = (np.array([getattr(part, name) for part in parts])[:, None] for name in ("angle_rad", "seconds"))
        speed = angle / seconds * 2 * np.sin(np.pi * np.clip((t - began) / seconds, 0, 1)) ** 2
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
    for number in range(max(len(turn.parts) for turn in turns)):
        parts = [turn.parts[number] if number < len(turn.parts) else _NOTHING for turn in turns]
        last = rotation.multiply(last, rotation.exp(np.array([part.axis * part.angle_rad for part in parts])))
    return first, last


_NOTHING = TurnPart(np.zeros(3), 0.0, 1.0, "")


def _parts(accel: np.ndarray, angles_deg: tuple[int, ...], seconds: float) -> list[TurnPart]:
    up = accel / np.linalg.norm(accel)
    face = face_up(up)
    lies = f" ({face.replace('+', '')} axis up)" if face else ""
    found = []
    for sense, degrees in product((1, -1), angles_deg):
        found.append(TurnPart(sense * up, degrees * DEG, seconds, f"{'left' if sense > 0 else 'right'} about the vertical{lies}"))
        for i, axis in enumerate(np.eye(3)):
            if abs(axis @ up) < VERTICAL:
                before, after = TOWARDS[i] if sense > 0 else TOWARDS[i][::-1]
                words = f"about the sensor's {'xyz'[i]} axis ({before} towards {after})"
                found.append(TurnPart(sense * axis, degrees * DEG, seconds, words))
    return found
