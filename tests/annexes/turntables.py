"""Simulated recordings of a gyroscope alone on a turntable: rests, and turns about one fixed axis, exact to the trapezoid."""

from dataclasses import dataclass, field

import numpy as np

from session.annexes.turntable.folder import GyroLog, turn_session
from session.io.logfile import KnownTurn
from session.io.units import DEG

RAMP_S = 0.2


@dataclass(frozen=True)
class Turned:
    """Plan: (axis 0 to 2, stated angle deg with its sign, dps) of each turn.

    plus, minus (3,): scale factor errors of the two senses; noise, play rad or rad/s of a reading; lsb rad/s; lean: rotation vector (3,)
    rad from the sensor's axes to the table's; wander of the bias, rad/s per root s; lost: number of a turn -> deg that it did not turn.
    """

    plan: tuple[tuple[int, float, float], ...]
    plus: tuple[float, float, float] = (0.0, 0.0, 0.0)
    minus: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bias: tuple[float, float, float] = (0.0, 0.0, 0.0)
    noise: float = 0.0
    play: float = 0.0
    lsb: float = 0.0
    lean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    wander: float = 0.0
    rest_s: float = 1.5
    odr_hz: float = 100.0
    stop_deg: float = 0.1
    seed: int = 0
    lost: dict = field(default_factory=dict)

    def arrays(self):
        """Stamps (N,) ns and readings (N, 3) rad/s."""
        rng = np.random.default_rng(self.seed)
        rest = np.zeros((round(self.rest_s * self.odr_hz), 3))
        parts = [rest]
        for number, (axis, angle_deg, dps) in enumerate(self.plan):
            u = rotated(np.eye(3)[axis], np.array(self.lean))
            steady = max(round((abs(angle_deg) / dps - RAMP_S) * self.odr_hz), 1)
            ramp = round(RAMP_S * self.odr_hz)
            shape = np.concatenate([np.arange(1, ramp) / ramp, np.ones(steady + 1), np.arange(ramp - 1, 0, -1) / ramp])
            angle = (
                angle_deg * DEG
                + np.hypot(self.play, self.stop_deg * DEG) * rng.normal()
                - np.sign(angle_deg) * self.lost.get(number, 0.0) * DEG
            )
            parts += [np.outer(shape, angle / (shape.sum() / self.odr_hz) * u), rest]
        rate = np.concatenate(parts)
        gain = np.where(rate > 0, 1 + np.array(self.plus), 1 + np.array(self.minus))
        walk = np.cumsum(rng.normal(size=rate.shape), axis=0) * self.wander / np.sqrt(self.odr_hz)
        readings = gain * rate + np.array(self.bias) + walk + self.noise * rng.normal(size=rate.shape)
        if self.lsb:
            readings = np.round(readings / self.lsb) * self.lsb
        return np.rint(np.arange(len(rate)) * (1e9 / self.odr_hz)).astype(np.int64), readings

    def known(self, log="log"):
        """A row of turns.csv for each turn."""
        rows = enumerate(self.plan)
        return [KnownTurn(i, log, np.eye(3)[a], "xyz"[a], angle * DEG, self.stop_deg * DEG) for i, (a, angle, _) in rows]

    def session(self):
        return turn_session([GyroLog("log", *self.arrays())], self.known())


def rotated(v, by):
    """v (3,) turned by a rotation vector (3,) (Rodrigues)."""
    angle = np.linalg.norm(by)
    if angle == 0:
        return v
    k = by / angle
    return v * np.cos(angle) + np.cross(k, v) * np.sin(angle) + k * (k @ v) * (1 - np.cos(angle))


def within_one_sigma(z):
    """Whether as many of z (n,) are within one sigma as chance allows in 999 of 1000 cases."""
    from scipy.stats import binom

    count, n = int(np.sum(np.abs(z) < 1)), len(z)
    low, high = binom.ppf([0.0005, 0.9995], n, 0.6827)
    return low <= count <= high
