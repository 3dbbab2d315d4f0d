"""Registers whose steps are larger than the noise: a gyro repeats one value at rest, and rest cannot be told from a slow turn; an
accelerometer repeats one in each still, and how far gravity is off cannot be told."""

from __future__ import annotations

import numpy as np

from session.checks.findings import Finding, axes_text
from session.common.units import MDPS, MG
from session.detect.stills import Noise
from session.log.config import Sensor
from session.log.logfile import Log

WHAT = "quantisation"
#: of neighbours that are equal: a step of 2.5 sigma makes so many of pure noise
REPEATS = 0.6
#: stretches that are looked at, and the share of them, the quietest, that must repeat
STRETCH_S, LEAST_READINGS, QUIETEST = 1.0, 8, 0.2
#: of a step: scatter in the stills that is nothing but the rounding of sums
NO_SCATTER = 1e-3


def check_quantised(log: Log, sensor: Sensor) -> list[Finding]:
    """Of a log in which no still was found: whether its steps are the reason, axis by axis; one that never moves is said as stuck."""
    gyro = log.samples.gyro
    moves = np.ptp(gyro, axis=0) > 0
    size = max(LEAST_READINGS, round(STRETCH_S / log.samples.period_s))
    count = (len(gyro) - 1) // size
    if not count or not moves.any():
        return []
    same = (np.diff(gyro, axis=0) == 0)[: count * size].reshape(count, size, 3).mean(axis=1)
    share = np.quantile(same, 1 - QUIETEST, axis=0)
    coarse = moves & (share > REPEATS)
    if not coarse.any():
        return []
    steps = np.abs(np.diff(gyro, axis=0))
    step = float(np.min(steps[:, coarse], where=steps[:, coarse] > 0, initial=np.inf))
    says = f"the gyro ({axes_text(coarse)}) moves in steps of {step / MDPS:.3g} mdps, and repeats {share[coarse].max():.0%} of its readings"
    says += " where it is quietest: the steps are larger than its noise"
    if (typical := sensor.typical("gyro_noise_mdps_rthz")) is not None:
        rms = typical[1] * np.sqrt(0.5 / log.samples.period_s)
        says += f" ({rms:.3g} mdps rms for the {typical[0]} at {1 / log.samples.period_s:.4g} Hz)"
    do = "choose a smaller full scale, or a higher data rate; with such steps a rest cannot be told from a slow turn"
    return [Finding("error", log.path.name, WHAT, says, do)]


def check_repeated_gravity(log: Log, noise: Noise | None) -> list[Finding]:
    """Whether the accelerometer, on some axis that moves, repeats one reading in each still; noise: of these stills."""
    if noise is None:
        return []
    accel = log.samples.accel
    steps = np.abs(np.diff(accel, axis=0))
    step = np.min(steps, axis=0, where=steps > 0, initial=np.inf)
    coarse = np.isfinite(step) & (noise.accel * np.sqrt(0.5 / log.samples.period_s) < NO_SCATTER * step)
    if not coarse.any():
        return []
    says = (
        f"the accelerometer ({axes_text(coarse)}) moves in steps of {step[coarse].max() / MG:.3g} mg, and repeats one reading in each still"
    )
    says += ": the steps are larger than its noise, so nothing tells how far gravity is off"
    do = "choose a smaller full scale, a higher data rate or a wider filter; was the log rounded where it was written?"
    return [Finding("error", log.path.name, WHAT, says, do)]
