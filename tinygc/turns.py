"""Turns that an operator can be asked for, from an attitude, and what each would tell: its columns of the linear sensitivity.

About one of the sensor's own axes or about the vertical, by quarter turns: what can be said in one sentence and done by one hand.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from session.guide.coverage import face_up
from session.units import DEG
from tinygc import closure, linear, rotation
from tinygc.closure import Batch

QUARTERS_DEG = (90, 180, 270, 360)
FAST_S, SLOW_S = 3.0, 5.0
STILL_S, RATE_HZ = 1.0, 20.0
VERTICAL = 0.90  #: cosine above which an axis is called vertical
TOWARDS = ("yz", "zx", "xy")  #: a positive turn about x takes y towards z, …
SPEEDS = (("fast", FAST_S), ("slowly", SLOW_S))


@dataclass(frozen=True, eq=False)
class Turn:
    """axis (3,) unit in the body, angle_rad, seconds; words for the operator."""

    axis: np.ndarray
    angle_rad: float
    seconds: float
    words: str

    def carries(self, accel: np.ndarray) -> np.ndarray:
        """What a still accelerometer that read accel (3,) before the turn reads after it."""
        return rotation.matrix(rotation.exp(self.axis * self.angle_rad)).T @ accel


def turns_from(accel: np.ndarray) -> list[Turn]:
    """All turns from a still in which the accelerometer reads accel (3,)."""
    up = accel / np.linalg.norm(accel)
    axes = [(up, "vertical")] + [(axis, "body") for axis in np.eye(3) if abs(axis @ up) < VERTICAL]
    return [
        Turn(sense * axis, degrees * DEG, seconds, _words(axis, sense, kind, degrees, speed, seconds, up))
        for (axis, kind), sense, degrees, (speed, seconds) in product(axes, (1, -1), QUARTERS_DEG, SPEEDS)
    ]


def columns(accels: np.ndarray, turns: list[Turn]) -> np.ndarray:
    """(M, 2, 12) rad per unit of each parameter: what each turn adds, begun where the accelerometer reads accels (M, 3)."""
    t = np.arange(0, max(turn.seconds for turn in turns) + 2 * STILL_S, 1 / RATE_HZ)
    seconds = np.array([turn.seconds for turn in turns])[:, None]
    phase = np.clip((t - STILL_S) / seconds, 0, 1)
    speed = np.array([turn.angle_rad for turn in turns])[:, None] / seconds * 2 * np.sin(np.pi * phase) ** 2
    rate = speed[..., None] * np.array([turn.axis for turn in turns])[:, None]
    dt = np.full((len(turns), len(t) - 1), 1 / RATE_HZ) * (t[1:] <= seconds + 2 * STILL_S)
    start = rotation.from_gravity(accels)
    batch = Batch(rate, dt, np.zeros_like(rate), start, start, yaw_known=False)
    return linear.columns(closure.sensitivity(batch, rate), rate)[:, :2]


def _words(axis, sense: int, kind: str, degrees: float, speed: str, seconds: float, up: np.ndarray) -> str:
    how = f"by {degrees:.0f}°, {speed} (about {seconds:.0f} s)"
    if kind == "vertical":
        face = face_up(up)
        lies = f"with the {face[0].replace('+', '')}{face[1]} axis up" if face else "as it lies"
        return f"turn {'left' if sense > 0 else 'right'} about the vertical {lies}, {how}"
    i = int(np.argmax(axis))
    before, after = TOWARDS[i] if sense > 0 else TOWARDS[i][::-1]
    return f"turn about the sensor's {'xyz'[i]} axis, {before} towards {after}, {how}"
