"""Effects concealed in registers, reference or site, and effects without a file in the catalogue."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.io.registers import gyro_rps_per_lsb
from session.io.sensors.profile import REGISTER_MAX
from session.io.units import DEG, MG, G
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


# Effects without a file in the catalogue: ``explain`` must not report them as one that it has.
#
# Each is physics observed in some sensor; its truth has the parameters needed to reproduce it, SI.

# Strong sizes, SI
OSCILLATION, PERIOD_S = 0.1 * DEG, (20.0, 60.0)
TELEGRAPH = 0.15 * DEG
RATE_PRODUCT = 0.02  #: of full scale, where both rates are at full scale
DEAD_ZONE = 0.3 * DEG
TEMPERATURE_CURVE = 0.01 * DEG  #: rad/s per degC^2 around the middle of a warm-up of 10 degC
FORCE_PRODUCT = 0.1 * DEG  #: rad/s per g^2
ROOT_SCALE = 0.01  #: fraction of the sensitivity, at full scale


def oscillation(scene: Scene) -> Concealment:
    """The zero oscillates, as under a poor supply or a heater's regulator."""
    size, period_s, phase = scene.signed(OSCILLATION), scene.rng.uniform(*PERIOD_S), scene.rng.uniform(0, 2 * np.pi, 3)
    return Concealment(
        "outside.oscillation",
        {"rps": size.tolist(), "period_s": period_s},
        distort=lambda t, rate, force, temp: rate + size * np.sin(2 * np.pi * t[:, None] / period_s + phase),
    )


def telegraph(scene: Scene) -> Concealment:
    """The zero jumps away and back, twice."""
    size = scene.signed(TELEGRAPH)
    at_s = scene.plan.log_s * (np.array([0.15, 0.35, 0.55, 0.75]) + scene.rng.uniform(0, 0.15, 4))
    return Concealment(
        "outside.telegraph",
        {"rps": size.tolist(), "at_s": at_s.tolist()},
        distort=lambda t, rate, force, temp: rate + (np.searchsorted(at_s, t) % 2)[:, None] * size,
    )


def rate_product(scene: Scene) -> Concealment:
    """Simultaneous rates about two axes add to the third."""
    size, full_scale = scene.signed(RATE_PRODUCT), scene.options.gyro_fs_dps * DEG
    return Concealment(
        "outside.rate_product",
        {"of_full_scale": size.tolist()},
        distort=lambda t, rate, force, temp: rate + size * np.roll(rate, -1, axis=1) * np.roll(rate, -2, axis=1) / full_scale,
    )


def dead_zone(scene: Scene) -> Concealment:
    """The output does not change around zero rate."""
    width = np.abs(scene.signed(DEAD_ZONE))
    return Concealment(
        "outside.dead_zone",
        {"rps": width.tolist()},
        distort=lambda t, rate, force, temp: np.sign(rate) * np.maximum(np.abs(rate) - width, 0),
    )


def temperature_curve(scene: Scene) -> Concealment:
    """The zero has a turning point in the middle of the session's temperatures."""
    size, middle_c = scene.signed(TEMPERATURE_CURVE), scene.options.temperature_start_c + scene.options.warm_up_c / 2
    return Concealment(
        "outside.temperature_curve",
        {"rps_per_c2": size.tolist(), "middle_c": middle_c},
        distort=lambda t, rate, force, temp: rate + np.outer((temp - middle_c) ** 2, size),
    )


def force_product(scene: Scene) -> Concealment:
    """The zero follows the product of the two other axes' forces."""
    size = scene.signed(FORCE_PRODUCT)
    return Concealment(
        "outside.force_product",
        {"rps_per_g2": size.tolist()},
        distort=lambda t, rate, force, temp: rate + size * np.roll(force, -1, axis=1) * np.roll(force, -2, axis=1) / G**2,
    )


def root_scale(scene: Scene) -> Concealment:
    """The sensitivity changes with the square root of the rate."""
    size, full_scale = scene.signed(ROOT_SCALE), scene.options.gyro_fs_dps * DEG
    return Concealment(
        "outside.root_scale",
        {"of_sensitivity": size.tolist()},
        distort=lambda t, rate, force, temp: rate * (1 + size * np.sqrt(np.abs(rate) / full_scale)),
    )


OUTSIDERS: dict[str, Maker] = {
    "outside.oscillation": oscillation,
    "outside.telegraph": telegraph,
    "outside.rate_product": rate_product,
    "outside.dead_zone": dead_zone,
    "outside.temperature_curve": temperature_curve,
    "outside.force_product": force_product,
    "outside.root_scale": root_scale,
}
