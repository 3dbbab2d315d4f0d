"""Simulation of a rest log: temperature up and down, a zero that lags it, noise; and its folder."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

from session.base.errors import CalibrationError
from session.base.files import folder_whole, write_new
from session.base.units import DEG, DEG_PER_HOUR, G
from session.log.registers import DEFAULT, accel_mps2_per_lsb, gyro_rps_per_lsb
from session.log.written import toml_text
from tinygc.features.temperature.feature import RestOptions
from tinygc.simulation.options import MOST_SAMPLES, SimulationOptions
from tinygc.simulation.sensor import Flicker, RegisterLog, registers_of, white
from tinygc.simulation.simulator import unit_of
from tinygc.simulation.write import (
    CONFIG,
    REST,
    SIMULATED,
    TRUTH,
    TRUTH_SCHEMA,
    check_folder,
    config_of,
    earlier_in,
    write_log,
)

# A simulated rest log: temperature up and down, a zero with lag and hysteresis, white and coloured noise.
#
# The element's lag is integrated sample by sample, and the hysteresis is a play operator.  No estimator shares this code.

#: of half the range: how far the temperature must reverse before the hysteresis has changed its branch
PLAY_SHARE = 0.2
#: LSB per degC, and the temperature of register value 0 (docs/sensor.md)
TEMP_LSB_PER_C, TEMP_ZERO_C = 256.0, 25.0


def simulate_rest(options: RestOptions, sensor: SimulationOptions, seed: int = 0) -> tuple[RegisterLog, np.ndarray]:
    """Return the registers, and the times of the knocks, s; sensor: whose data rate, full scales and noise it has.

    Raises CalibrationError for a log that would not fit into memory.
    """
    count = round(options.cycles * options.cycle_s * sensor.odr_hz)
    if not 2 <= count <= MOST_SAMPLES:
        raise CalibrationError(f"--rest-cycles makes {count} samples, expected 2 to {MOST_SAMPLES}; shorten it, or lower --odr-hz")
    rng = np.random.default_rng([seed, 13])
    dt_s = 1 / sensor.odr_hz
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
    noise = white(sensor.gyro_noise_dps_rthz, sensor.odr_hz, count, rng) * louder[:, None]
    flicker = Flicker(sensor.bias_instability_dph * DEG_PER_HOUR / DEG, count / sensor.odr_hz, rng)(np.arange(count) / sensor.odr_hz)
    gyro_dps = np.array(options.zero_dps) + follows[:, None] * sign + walk + noise + flicker
    down_g = np.array([0.0, 0.0, -1.0])
    force_g = down_g if sensor.unit_seed < 0 else unit_of(sensor).measured_force(down_g * G) / G
    accel_g = force_g + white(sensor.accel_noise_ug_rthz * 1e-6, sensor.odr_hz, count, rng)
    knock_s = np.sort(rng.uniform(0.05, 0.95, options.knocks)) * t_s[-1]
    for moment in knock_s:
        here = (t_s >= moment) & (t_s < moment + max(0.1, 2 * dt_s))
        gyro_dps[here] += rng.normal(size=(here.sum(), 3)) * 5
        accel_g[here] += rng.normal(size=(here.sum(), 3)) * 0.3
    log = RegisterLog(
        np.rint(t_s * 1e6).astype(np.int64),
        registers_of(gyro_dps * DEG, sensor.gyro_fs_dps * DEG, gyro_rps_per_lsb(sensor.gyro_fs_dps)),
        registers_of(accel_g * G, sensor.accel_fs_g * G, accel_mps2_per_lsb(sensor.accel_fs_g)),
        np.rint((reading - TEMP_ZERO_C) * TEMP_LSB_PER_C + rng.normal(size=count)).astype(np.int16),
    )
    return log, knock_s


def _behind(values: np.ndarray, lag_s: float, dt_s: float) -> np.ndarray:
    """First-order lag, by trapezoids (bilinear), in steady state at the first value."""
    if lag_s <= 0:
        return values
    k = dt_s / (2 * lag_s + dt_s)
    b, a = [k, k], [1.0, -(2 * lag_s - dt_s) / (2 * lag_s + dt_s)]
    return values[0] + lfilter(b, a, values - values[0])


def _play(values: np.ndarray, width: float) -> np.ndarray:
    """Play operator of width +/- width, started in the middle: (N,)."""
    out, held = np.empty(len(values)), float(values[0])
    for k, value in enumerate(values.tolist()):
        held = min(max(held, value - width), value + width)
        out[k] = held
    return out


# Write a simulated rest log as a session folder, with its truth.


def write_rest(options: RestOptions, session: SimulationOptions, folder: Path, force: bool = False) -> Path:
    """Simulate a rest log, write its folder and return the folder.  Raises FormatError like ``write_session``."""
    check_folder(folder, force)
    if session.sensor != DEFAULT:
        raise CalibrationError(
            f"--sensor is {session.sensor!r}, expected {DEFAULT}: the registers of a rest log are simulated for it alone"
        )
    unit = unit_of(session)
    given = f"--rest-cycles {options.cycles:g} --seed {session.seed}"
    if session.unit_seed >= 0:  # the unit whose sessions have this seed, with its zero
        options = replace(options, zero_dps=tuple((-np.linalg.solve(unit.E, unit.B) / DEG).tolist()))
        given += f" --unit-seed {session.unit_seed}"
    log, knock_s = simulate_rest(options, session, session.seed)
    truth = {"schema": TRUTH_SCHEMA, "effects": {}, "rest": asdict(options) | {"knock_s": knock_s.tolist()}}
    head = f"{SIMULATED}, not recorded: calibrate.py simulate {given} and what truth.json has\n"
    with folder_whole(folder, earlier_in(folder)) as work:
        write_new(work / CONFIG, head + toml_text(config_of(session, unit, calibrated=False)))
        write_log(work / REST, session, session.odr_hz, log)
        write_new(work / TRUTH, json.dumps(truth, indent=1) + "\n")
    return folder
