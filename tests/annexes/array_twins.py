"""Units of one body that is turned by hand, with a known truth: their clocks, mountings, linear errors, noise and the ages of readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from session.annexes.arrays.recording import ArraySession
from session.io.config import Accelerometer, Config, Protocol, Sensor, Site
from session.io.folder import Session
from session.io.logfile import Log
from session.io.samples import Samples

DEG = np.pi / 180
GRAVITY = 9.80665
FINE_S = 1e-3


class Body:
    """Turns of 30 to 90 degrees about any axes, a second each, with stills between them; then, if asked, as much shaking."""

    def __init__(self, turns: int, seed: int, still_s: float = 2.0, shaken_s: float = 0.0):
        random = np.random.default_rng(seed)
        self.duration_s = turns * (still_s + 1.0) + still_s + shaken_s
        t = np.arange(0, self.duration_s, FINE_S)
        rate = np.zeros((len(t), 3))
        for turn in range(turns):
            begin, angle = still_s + turn * (still_s + 1.0), random.uniform(30, 90) * DEG
            axis = random.normal(size=3)
            phase = np.clip(t - begin, 0, 1)
            rate += angle * (1 - np.cos(2 * np.pi * phase))[:, None] * axis / np.linalg.norm(axis)
        if shaken_s:
            begin = self.duration_s - shaken_s
            window = np.clip((t - begin) / 0.5, 0, 1) ** 2
            for axis in range(3):
                for hertz in random.uniform(0.8, 3.0, 4):
                    rate[:, axis] += window * 120 * DEG * np.sin(2 * np.pi * hertz * (t - begin) + random.uniform(0, 6))
        self.rate = CubicSpline(t, rate)
        steps = Rotation.from_rotvec((rate[1:] + rate[:-1]) / 2 * FINE_S)
        attitudes = [np.eye(3)]
        for step in steps.as_matrix():
            attitudes.append(attitudes[-1] @ step)
        self.force = CubicSpline(t, np.array(attitudes)[:, 2] * -GRAVITY)  # level and still: (0, 0, -g)


@dataclass(frozen=True, eq=False)
class Unit:
    """rotation: of the unit's axes against the body's (mounting); gyro (3, 3): what the gyroscope makes of a rate in the unit's axes; the
    unit's time is (t - offset_s - …)/(1 + rate) of the body's; noise_dps of a reading; beat_hz and period_s of its readings' ages."""

    rotation: np.ndarray = field(default_factory=lambda: np.eye(3))
    gyro: np.ndarray = field(default_factory=lambda: np.eye(3))
    offset_s: float = 0.0
    rate: float = 0.0
    noise_dps: float = 0.1
    accel_noise_mps2: float = 0.02
    beat_hz: float = 0.0
    phase: float = 0.0
    period_s: float = 0.0

    def age_s(self, t_s: np.ndarray) -> np.ndarray:
        cycles = self.phase + self.beat_hz * t_s
        return np.asarray(self.period_s * (cycles - np.floor(cycles)))


def samples_of(body: Body, unit: Unit, odr_hz: float, seed: int) -> Samples:
    """Its log, from second 1 of its own clock to as near the end as all clocks can be."""
    random = np.random.default_rng(seed)
    t_unit = 1.0 + np.arange(int((body.duration_s - 2.0) * odr_hz)) / odr_hz
    about = body.duration_s / 2
    made = t_unit + unit.offset_s + unit.rate * (t_unit - about) - unit.age_s(t_unit)
    inside = (made > 0) & (made < body.duration_s - FINE_S)
    t_unit, made = t_unit[inside], made[inside]
    gyro = body.rate(made) @ unit.rotation @ unit.gyro.T + random.normal(0, unit.noise_dps * DEG, (len(made), 3)) + random.normal(0, DEG, 3)
    accel = body.force(made) @ unit.rotation + random.normal(0, unit.accel_noise_mps2, (len(made), 3))
    return Samples(np.rint(t_unit * 1e9).astype(np.int64), gyro, accel)


def array_of(body: Body, units: Sequence[Unit], odr_hz: float = 100.0, seed: int = 0) -> ArraySession:
    """With accelerometers that are right, and said to be."""
    config = Config(Sensor("unknown", "", odr_hz, 2000.0, 16.0), Accelerometer(), Site(), Protocol())
    sessions = []
    for number, unit in enumerate(units):
        log = Log(Path(f"log0001.unit{number}"), samples_of(body, unit, odr_hz, 100 * seed + number), raw=False, in_memory=True)
        sessions.append(Session(Path("twins"), config, (log,), ()))
    return ArraySession(Path("twins"), tuple(range(len(units))), tuple(sessions))


def any_unit(seed: int, **more: float) -> Unit:
    """Any mounting, scales and misalignments of some percent."""
    random = np.random.default_rng(seed)
    rotation = Rotation.random(rng=random).as_matrix()
    return Unit(rotation, np.eye(3) + random.normal(0, 0.015, (3, 3)), **more)
