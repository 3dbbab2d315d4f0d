"""Effects concealed in vibrated turns, registers, reference or site of a simulated session, implemented independently of the catalogue."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import butter, sosfiltfilt, sosfreqz

from session.base.units import DEG, MG, G
from session.log.registers import gyro_rps_per_lsb
from session.log.sensors import REGISTER_MAX
from tinygc.features.challenge.rate_effects import RATE_EFFECTS, Concealment, Scene
from tinygc.simulation.movement import MovementPlan, Stroke
from tinygc.simulation.options import SimulationOptions
from tinygc.simulation.sensor import ACCEL_BANDWIDTH_ODR, RegisterLog, oversampling


@dataclass(frozen=True, eq=False)
class Bench(Scene):
    """The scene of a simulated session, with its options and its movement."""

    options: SimulationOptions
    plan: MovementPlan


def bench(rng: np.random.Generator, strength: float, options: SimulationOptions, plan: MovementPlan) -> Bench:
    """A simulated session as the scene of a draw."""
    return Bench(rng, strength, options.gyro_fs_dps, options.temperature_start_c, plan.log_s, options, plan)


# Catalogue effects of vibration, the registers, the reference or the site, concealed after or around the simulation.

# Strong sizes
RECTIFICATION = 1.5 * DEG  #: rad/s per g^2
VIBRATION_G, VIBRATION_HZ, VIBRATED_TURNS = 0.4, (20.0, 45.0), 0.5  #: rms in g of each axis, band, share of the turns
CLIPPED = 0.45  #: share of the session's peak that is clipped
BURSTS, BURST_SAMPLES = 12, 9
GLITCHES, GLITCH_SAMPLES, GLITCH_RPS = 14, 4, 65 * DEG
ACCEL_BIAS = 9 * MG  #: m/s^2
CREEP_RPS, CREEPING, CREEP_STARTS_S = 0.3 * DEG, 0.4, 0.1  #: rate, share of the stills, duration of its onset


def vibration_rectification(scene: Bench, band_hz: tuple[float, float] = VIBRATION_HZ) -> Concealment:
    """Half of the turns are vibrated; the accelerometer feels the vibration, and the bias follows its mean square.

    The truth is per g² that the accelerometer passes, as the vibration above its low-pass cannot be measured.
    """
    k, seed = scene.signed(RECTIFICATION), int(scene.rng.integers(2**32))
    turns = [turn for turn in scene.plan.turns if scene.rng.uniform() < VIBRATED_TURNS] or list(scene.plan.turns[:1])

    def envelope(t: np.ndarray) -> np.ndarray:
        """(N,) g, rms of each axis: it rises and falls within a tenth of each turn."""
        rms = np.zeros(len(t))
        for start, stop in turns:
            first, last = np.searchsorted(t, (start, stop))
            u = np.linspace(0, 1, last - first)
            rms[first:last] = VIBRATION_G * np.clip(10 * np.minimum(u, 1 - u), 0, 1)
        return rms

    def disturb(t: np.ndarray, force: np.ndarray) -> np.ndarray:
        noise = np.random.default_rng(seed).standard_normal(force.shape)
        noise = sosfiltfilt(butter(2, band_hz, "bandpass", fs=1 / (t[1] - t[0]), output="sos"), noise, axis=0)
        return force + G * envelope(t)[:, None] * noise / noise.std(axis=0)

    # Share of the vibration's mean square after the accelerometer's low-pass, for vibration filtered twice to a band
    fine_hz = oversampling(scene.options.odr_hz) * scene.options.odr_hz
    f_hz, band = sosfreqz(butter(2, band_hz, "bandpass", fs=fine_hz, output="sos"), 8192, fs=fine_hz)
    _, passes = sosfreqz(butter(2, ACCEL_BANDWIDTH_ODR * scene.options.odr_hz, fs=fine_hz, output="sos"), f_hz, fs=fine_hz)
    power = np.abs(band) ** 4
    return Concealment(
        "gyro.vibration_rectification",
        {"dps_per_g2": (k / float(np.sum(power * np.abs(passes) ** 2) / np.sum(power)) / DEG).tolist()},
        lambda t, w, f, c: w + np.outer(envelope(t) ** 2, k),
        disturb=disturb,
    )


def saturation(scene: Bench) -> Concealment:
    """Registers clip at a level below the session's peak rate, as if the full scale were smaller."""
    per_lsb = gyro_rps_per_lsb(scene.gyro_fs_dps)

    def spoil(log: RegisterLog) -> tuple[RegisterLog, dict]:
        level = round((1 - CLIPPED * scene.strength) * np.abs(log.gyro.astype(int)).max())
        return replace(log, gyro=np.clip(log.gyro, -level, level)), {"dps": level * per_lsb / DEG}

    return Concealment("gyro.saturation", spoil=spoil)


def dropped_samples(scene: Bench) -> Concealment:
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


def glitches(scene: Bench) -> Concealment:
    """A few samples at a time jump by the same step, with a sign of its own for each axis."""
    rng, counts = scene.rng, scene.strength * GLITCH_RPS / gyro_rps_per_lsb(scene.gyro_fs_dps)

    def spoil(log: RegisterLog) -> tuple[RegisterLog, dict]:
        gap = len(log.gyro) // (GLITCHES + 1)
        rows = gap * np.arange(1, GLITCHES + 1) + rng.integers(-gap // 3, gap // 3, GLITCHES)
        gyro = log.gyro.astype(int)
        for row in rows:
            gyro[row : row + GLITCH_SAMPLES] += np.rint(counts * rng.choice((-1, 1), 3)).astype(int)
        clipped = np.clip(gyro, -REGISTER_MAX, REGISTER_MAX).astype(np.int16)
        return replace(log, gyro=clipped), {"at": rows.tolist(), "samples": GLITCH_SAMPLES}

    return Concealment("data.glitches", spoil=spoil)


def accelerometer(scene: Bench) -> Concealment:
    """The accelerometer's pre-calibration left a bias, m/s^2 in b."""
    bias = scene.signed(ACCEL_BIAS)
    return Concealment("reference.accelerometer", {"bias_mg": (bias / MG).tolist()}, disturb=lambda t, force: force + bias)


class Creep(Stroke):
    """A gimbal that turns at a steady rate; the rate starts and stops linearly."""

    def angle(self, t_s: np.ndarray) -> np.ndarray:
        """(3, N): angle since the start, rad, and its two derivatives."""
        ramps = np.array([self.start_s, self.start_s + CREEP_STARTS_S, self.stop_s - CREEP_STARTS_S, self.stop_s])
        slope = np.array([1.0, -1.0, -1.0, 1.0])[:, None] * self.change_rad / (self.duration_s - CREEP_STARTS_S) / CREEP_STARTS_S
        since = np.maximum(t_s - ramps[:, None], 0)
        return np.stack([np.sum(slope * since**2 / 2, axis=0), np.sum(slope * since, axis=0), np.sum(slope * (since > 0), axis=0)])


def not_still(scene: Bench) -> Concealment:
    """In some stills between two turns a gimbal creeps."""
    turns = scene.plan.turns
    stills = np.sort(scene.rng.choice(np.arange(1, len(turns)), round(CREEPING * len(turns)), replace=False))
    creeps = []
    for i in stills:
        gimbal, rate_rps = int(scene.rng.integers(3)), float(scene.rng.choice((-1, 1))) * scene.strength * CREEP_RPS
        rest_s = turns[i][0] - turns[i - 1][1]
        creeps.append(Creep(gimbal, turns[i - 1][1], rest_s, rate_rps * (rest_s - CREEP_STARTS_S)))

    def movement(plan: MovementPlan) -> MovementPlan:
        return replace(plan, strokes=(*plan.strokes, *creeps))

    return Concealment("reference.not_still", {"stills": stills.tolist()}, movement=movement)


def earth_rotation(scene: Bench) -> Concealment:
    """session.toml has no latitude, so the Earth's rotation is not removed."""
    return Concealment("earth.rotation", {"latitude_deg": scene.options.latitude_deg}, without_latitude=True)


MAKERS: dict[str, Callable[[Bench], Concealment]] = {
    **RATE_EFFECTS,
    "gyro.vibration_rectification": vibration_rectification,
    "gyro.saturation": saturation,
    "timing.dropped_samples": dropped_samples,
    "data.glitches": glitches,
    "reference.accelerometer": accelerometer,
    "reference.not_still": not_still,
    "earth.rotation": earth_rotation,
}
