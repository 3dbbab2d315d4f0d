"""Which attitudes and turn axes the accepted segments cover."""

from __future__ import annotations

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
    """stills: how many with each face up, and slanted; turned_deg: how far about each axis, each way."""

    def __init__(self) -> None:
        self.stills = dict.fromkeys((*FACES, "slanted"), 0)
        self.turned_deg = dict.fromkeys(FACES, 0.0)

    def first(self, accel: np.ndarray) -> None:
        """A log's first still, with its specific force (3,)."""
        self.stills[face_up(accel) or "slanted"] += 1

    def add(self, turn: AcceptedTurn) -> None:
        """A turn that was accepted, and the still that it ended in."""
        first, last = turn.segment.stills
        self.first(last.accel_mean)
        rate = turn.samples.gyro - (first.gyro_mean + last.gyro_mean) / 2
        step = np.diff(turn.samples.t_s)[:, None]
        noise = 3 * np.maximum(first.gyro_std, last.gyro_std)  # what the noise alone turns to and fro is no turn
        moved = np.where(np.abs(rate[:-1]) > noise, rate[:-1], 0.0) * step
        for axis, name in enumerate("xyz"):
            self.turned_deg[f"+{name}"] += float(np.sum(moved[:, axis], where=moved[:, axis] > 0)) / DEG
            self.turned_deg[f"-{name}"] -= float(np.sum(moved[:, axis], where=moved[:, axis] < 0)) / DEG
