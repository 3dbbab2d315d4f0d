"""A simulated rest log: temperature up and down, a zero that follows it late and comes back another way, noise of every colour.

The element's lag is stepped sample by sample, and the hysteresis is a play: code of its own, which no estimator shares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from session.common.errors import CalibrationError
from session.common.units import DEG, DEG_PER_HOUR, G
from session.sensor.registers import accel_mps2_per_lsb, gyro_rps_per_lsb
from tinygc.simulation.noise import bias_instability, white
from tinygc.simulation.options import MOST_SAMPLES
from tinygc.simulation.rest_options import RestOptions

#: of half the range: how far the temperature must turn back before the hysteresis has changed sides
PLAY_SHARE = 0.2
#: LSB per degC, and where it is 0 (docs/sensor.md)
TEMP_LSB_PER_C, TEMP_ZERO_C = 256.0, 25.0


@dataclass(frozen=True, eq=False)
class RestRecording:
    """Registers of a rest log: t_us (N,), gyro and accel (N, 3), temp (N,), whole numbers; knock_s: when it was knocked."""

    t_us: np.ndarray
    gyro: np.ndarray
    accel: np.ndarray
    temp: np.ndarray
    knock_s: np.ndarray


@dataclass(frozen=True)
class Chip:
    """What the rest log is recorded with: data rate Hz, full scales dps and g, white densities and bias instability of the datasheet."""

    odr_hz: float
    gyro_fs_dps: float
    accel_fs_g: float
    gyro_noise_dps_rthz: float
    accel_noise_ug_rthz: float
    bias_instability_dph: float


def simulate_rest(options: RestOptions, chip: Chip, seed: int = 0) -> RestRecording:
    """The registers.  CalibrationError for a log that memory would not hold."""
    count = round(options.cycles * options.cycle_s * chip.odr_hz)
    if not 2 <= count <= MOST_SAMPLES:
        raise CalibrationError(f"--rest-cycles makes {count} samples, expected 2 to {MOST_SAMPLES:.0e}; shorten it, or lower --odr-hz")
    rng = np.random.default_rng([seed, 13])
    dt_s = 1 / chip.odr_hz
    t_s = np.arange(count) * dt_s
    middle, half = (options.warm_c + options.cold_c) / 2, (options.warm_c - options.cold_c) / 2
    sign = np.array([1.0, -1.0, 1.0])
    heat = middle - half * np.cos(2 * np.pi * t_s / options.cycle_s)
    element, reading = (heat, _behind(heat, -options.lag_s, dt_s)) if options.lag_s < 0 else (_behind(heat, options.lag_s, dt_s), heat)
    away = element - middle
    follows = options.slope_dps_per_c * away + options.bend_dps_per_c2 * away**2
    if options.hysteresis_dps and half:
        play = PLAY_SHARE * half
        follows = follows + options.hysteresis_dps / 2 * (element - _play(element, play)) / play
    walk = options.random_walk_dps_rts * np.sqrt(dt_s) * np.cumsum(rng.standard_normal((count, 3)), axis=0)
    louder = 1 + options.noise_per_c * (element - middle)
    noise = white(chip.gyro_noise_dps_rthz, chip.odr_hz, count, rng) * louder[:, None]
    flicker = bias_instability(chip.bias_instability_dph * DEG_PER_HOUR / DEG, chip.odr_hz, count, rng)
    gyro_dps = np.array(options.zero_dps) + follows[:, None] * sign + walk + noise + flicker
    accel_g = np.array([0.0, 0.0, -1.0]) + white(chip.accel_noise_ug_rthz * 1e-6, chip.odr_hz, count, rng)
    knock_s = np.sort(rng.uniform(0.05, 0.95, options.knocks)) * t_s[-1]
    for moment in knock_s:
        here = (t_s >= moment) & (t_s < moment + max(0.1, 2 * dt_s))
        gyro_dps[here] += rng.normal(size=(here.sum(), 3)) * 5
        accel_g[here] += rng.normal(size=(here.sum(), 3)) * 0.3
    limit = 2**15 - 1
    gyro = np.clip(np.rint(gyro_dps * DEG / gyro_rps_per_lsb(chip.gyro_fs_dps)), -limit - 1, limit)
    accel = np.clip(np.rint(accel_g * G / accel_mps2_per_lsb(chip.accel_fs_g)), -limit - 1, limit)
    temp = np.rint((reading - TEMP_ZERO_C) * TEMP_LSB_PER_C + rng.normal(size=count))
    return RestRecording(np.rint(t_s * 1e6).astype(int), gyro.astype(int), accel.astype(int), temp.astype(int), knock_s)


def _behind(values: np.ndarray, lag_s: float, dt_s: float) -> np.ndarray:
    """First-order lag, by trapezoids (bilinear), from rest at the first value."""
    if lag_s <= 0:
        return values
    k = dt_s / (2 * lag_s + dt_s)
    b, a = [k, k], [1.0, -(2 * lag_s - dt_s) / (2 * lag_s + dt_s)]
    return values[0] + lfilter(b, a, values - values[0])


def _play(values: np.ndarray, width: float) -> np.ndarray:
    """What follows with a play of +/- width, begun in the middle: (N,)."""
    out, held = np.empty(len(values)), float(values[0])
    for k, value in enumerate(values.tolist()):
        held = min(max(held, value - width), value + width)
        out[k] = held
    return out
