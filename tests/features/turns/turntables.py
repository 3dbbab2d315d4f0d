"""Simulated recordings of a gyroscope alone on a turntable: rests, and turns about one fixed axis, exact to the trapezoid."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from session.base.units import DEG, NS
from session.log.arrays import samples_of_arrays
from session.log.config import Accelerometer, Config, Protocol, Sensor, Site
from session.log.folder import Session
from session.log.logfile import KnownTurn, Log
from tinygc.features.turns import TURNS
from tinygc.features.turns.folder import GyroLog, _full_scale, _rate_hz, _refuse

RAMP_S = 0.2


def turn_session(logs, turns, gyro_fs_dps=None):
    """A session of logs that were never files; ``turns`` name their logs as they are named here."""
    _refuse(logs)
    held = []
    for log in logs:
        samples = samples_of_arrays(f"{log.name}: ", (log.t_ns * NS, log.gyro_rps, np.zeros((len(log.t_ns), 3))), None, (1.0, 1.0))
        samples = replace(samples, t_ns=np.asarray(log.t_ns, dtype=np.int64), accel=np.full((len(log.t_ns), 3), np.nan))
        held.append(Log(Path(log.name), samples, raw=False, in_memory=True))
    sensor = Sensor("unknown", "", _rate_hz(logs), gyro_fs_dps or _full_scale(logs), math.nan)
    return Session(
        Path("turns"), Config(sensor, Accelerometer(source="none"), Site(), Protocol(reference=TURNS)), tuple(held), (), turns=tuple(turns)
    )


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
            u = Rotation.from_rotvec(self.lean).apply(np.eye(3)[axis])
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
