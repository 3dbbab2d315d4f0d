"""Which attitudes and turn axes the accepted segments cover."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from session.common.units import DEG
from session.guide.messages import AcceptedTurn

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
