"""Rest and movement, block by block: how long it has been still, how far it has turned since.

A bump that is short and leaves the attitude as it was does not end a still, as in ``session.detect.stills``.
"""

from __future__ import annotations

import numpy as np

from session.detect.stills import BUMP_RAD, BUMP_S, TURNING_RPS
from session.guide.stillness import UNKNOWN_ZERO_RPS, Block

BUMP_SLACK_RAD = 2 * BUMP_RAD  #: blocks of 0.1 s see an angle no better; the log's own judgement comes later


class TurnInProgress:
    """What the table does now, and since the last reference still.

    still_s: of the present still, bumps included; moving: whether it is not still now, for moving_s, the last restless_s of it without
    turning (a hand rests on the table); path_rad, peak_rps: of the movement since the last reference still.
    """

    def __init__(self) -> None:
        self.still_s = self.moving_s = self.restless_s = 0.0
        self.path_rad = self.peak_rps = 0.0
        self._bump, self._bump_path = np.zeros(3), 0.0
        self._in_bump = False

    @property
    def moving(self) -> bool:
        """Whether the table moves, or has just been touched."""
        return self.still_s == 0.0 or self._in_bump

    def feed(self, block: Block, zero_rps: np.ndarray | None) -> float:
        """Take a block; returns how long the still was that it ends, or 0."""
        if block.quiet:
            if self._in_bump:
                self.still_s += self.moving_s
            self._calm()
            self.still_s += block.duration_s
            return 0.0
        rate = block.gyro_mean if zero_rps is None else block.gyro_mean - zero_rps
        self.moving_s += block.duration_s
        turning = np.abs(rate).max() > (UNKNOWN_ZERO_RPS if zero_rps is None else TURNING_RPS)
        self.restless_s = 0.0 if turning else self.restless_s + block.duration_s
        self._bump = self._bump + rate * block.duration_s
        angle = float(np.linalg.norm(rate)) * block.duration_s
        if self.still_s > 0.0:
            self._bump_path += angle
            self._in_bump = self.moving_s <= BUMP_S and float(np.linalg.norm(self._bump)) < BUMP_SLACK_RAD
            if self._in_bump:
                return 0.0
            ended_s, self.still_s = self.still_s, 0.0
            self._count(self._bump_path, block)
            return ended_s
        self._count(angle, block)
        return 0.0

    def accepted_still(self) -> None:
        """The still is a reference: what moves from now on is the next turn.  One that has just been left is moving already."""
        path_rad, peak_rps = (self._bump_path, self.peak_rps) if self.still_s == 0.0 else (0.0, 0.0)
        self.path_rad = path_rad
        self.peak_rps = peak_rps

    def interrupted(self) -> None:
        """Nobody saw what happened since: whatever it was, it has to come to rest anew."""
        self.still_s = self.moving_s = 0.0
        self._calm()

    def _calm(self) -> None:
        self.moving_s = self.restless_s = 0.0
        self._in_bump = False
        self._bump, self._bump_path = np.zeros(3), 0.0

    def _count(self, angle_rad: float, block: Block) -> None:
        self.path_rad += angle_rad
        self.peak_rps = max(self.peak_rps, block.peak_rps)
