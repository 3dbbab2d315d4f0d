"""Effects concealed in registers, reference or site, implemented independently of the catalogue."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.io.registers import gyro_rps_per_lsb
from session.io.sensors.profile import REGISTER_MAX
from session.io.units import DEG, MG
from tinygc.annexes.challenge.rate_effects import Concealment, Maker, Scene
from tinygc.simulation.movement import MovementPlan
from tinygc.simulation.simulator import RegisterLog

# Catalogue effects of the registers, the reference or the site, concealed after or around the simulation.

# Strong sizes
CLIPPED = 0.45  #: share of the session's peak that is clipped
BURSTS, BURST_SAMPLES = 12, 9
GLITCHES, GLITCH_SAMPLES, GLITCH_RPS = 14, 4, 65 * DEG
ACCEL_BIAS = 9 * MG  #: m/s^2
CREEP_RPS, CREEPING, CREEP_STARTS_S = 0.3 * DEG, 0.4, 0.1  #: rate, share of the stills, duration of its onset


def saturation(scene: Scene) -> Concealment:
    """Registers clip at a level below the session's peak rate, as if the full scale were smaller."""
    per_lsb = gyro_rps_per_lsb(scene.options.gyro_fs_dps)

    def spoil(log: RegisterLog) -> tuple[RegisterLog, dict]:
        level = round((1 - CLIPPED * scene.strength) * np.abs(log.gyro.astype(int)).max())
        return replace(log, gyro=np.clip(log.gyro, -level, level)), {"dps": level * per_lsb / DEG}

    return Concealment("gyro.saturation", spoil=spoil)


def dropped_samples(scene: Scene) -> Concealment:
    """A burst is lost in the middle of a turn, and the later samples have the stamps of the earlier ones."""
    length = max(1, round(BURST_SAMPLES * scene.strength))
    hit = scene.rng.choice(len(scene.plan.turns), min(BURSTS, len(scene.plan.turns)), replace=False)
    at_s = sorted(float(np.interp(scene.rng.uniform(0.3, 0.7), (0, 1), scene.plan.turns[turn])) for turn in hit)

    def spoil(log: RegisterLog) -> tuple[RegisterLog, dict]:
        lost = np.searchsorted(log.t_us, np.multiply(at_s, 1e6))[:, None] + np.arange(length)
        kept = np.delete(np.arange(len(log.t_us)), lost.ravel())
        closed_up = RegisterLog(log.t_us[: len(kept)], log.gyro[kept], log.accel[kept], log.temp[kept])
        return closed_up, {"at_s": at_s, "length": length}

    return Concealment("timing.dropped_samples", spoil=spoil)


def glitches(scene: Scene) -> Concealment:
    """A few samples at a time jump by the same step, with a sign of its own for each axis."""
    rng, counts = scene.rng, scene.strength * GLITCH_RPS / gyro_rps_per_lsb(scene.options.gyro_fs_dps)

    def spoil(log: RegisterLog) -> tuple[RegisterLog, dict]:
        gap = len(log.gyro) // (GLITCHES + 1)
        rows = gap * np.arange(1, GLITCHES + 1) + rng.integers(-gap // 3, gap // 3, GLITCHES)
        gyro = log.gyro.astype(int)
        for row in rows:
            gyro[row : row + GLITCH_SAMPLES] += np.rint(counts * rng.choice((-1, 1), 3)).astype(int)
        return replace(log, gyro=np.clip(gyro, -REGISTER_MAX, REGISTER_MAX).astype(np.int16)), {
            "at": rows.tolist(),
            "samples": GLITCH_SAMPLES,
        }

    return Concealment("data.glitches", spoil=spoil)


def accelerometer(scene: Scene) -> Concealment:
    """The accelerometer's pre-calibration left a bias, m/s^2 in b."""
    bias = scene.signed(ACCEL_BIAS)
    return Concealment("reference.accelerometer", {"bias_mg": (bias / MG).tolist()}, disturb=lambda t, force: force + bias)


@dataclass(frozen=True, eq=False)
class Creep:
    """A gimbal that turns at a steady rate between two moments, with the interface of ``Stroke``."""

    gimbal: int
    start_s: float
    stop_s: float
    rate_rps: float

    @property
    def change_rad(self) -> float:
        """Net change of the gimbal's angle, rad."""
        return self.rate_rps * (self.stop_s - self.start_s - CREEP_STARTS_S)

    def angle(self, t_s: np.ndarray) -> np.ndarray:
        """(3, N): angle since the start, rad, and its two derivatives; the rate starts and stops linearly."""
        ramps = np.array([self.start_s, self.start_s + CREEP_STARTS_S, self.stop_s - CREEP_STARTS_S, self.stop_s])
        slope = np.array([1.0, -1.0, -1.0, 1.0])[:, None] * self.rate_rps / CREEP_STARTS_S
        since = np.maximum(t_s - ramps[:, None], 0)
        return np.stack([np.sum(slope * since**2 / 2, axis=0), np.sum(slope * since, axis=0), np.sum(slope * (since > 0), axis=0)])


def not_still(scene: Scene) -> Concealment:
    """In some stills between two turns a gimbal creeps."""
    turns = scene.plan.turns
    stills = np.sort(scene.rng.choice(np.arange(1, len(turns)), round(CREEPING * len(turns)), replace=False))
    creeps = [
        Creep(int(scene.rng.integers(3)), turns[i - 1][1], turns[i][0], float(scene.rng.choice((-1, 1))) * scene.strength * CREEP_RPS)
        for i in stills
    ]

    def movement(plan: MovementPlan) -> MovementPlan:
        return replace(plan, strokes=(*plan.strokes, *creeps))

    return Concealment("reference.not_still", {"stills": stills.tolist()}, movement=movement)


def earth_rotation(scene: Scene) -> Concealment:
    """session.toml lacks the latitude, so the Earth's rotation is not removed."""
    return Concealment("earth.rotation", {"latitude_deg": scene.options.latitude_deg}, without_latitude=True)


OTHER_EFFECTS: dict[str, Maker] = {
    "gyro.saturation": saturation,
    "timing.dropped_samples": dropped_samples,
    "data.glitches": glitches,
    "reference.accelerometer": accelerometer,
    "reference.not_still": not_still,
    "earth.rotation": earth_rotation,
}
