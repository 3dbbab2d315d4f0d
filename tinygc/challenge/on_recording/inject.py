"""Put an effect into a recording's readings: only what it changes is added, the rest stays as it was recorded."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from session.log.samples import Samples
from tinygc.challenge.concealment import Scene
from tinygc.challenge.on_recording.recording import Recording, Steps, steps_of, with_gyro
from tinygc.challenge.on_recording.trials import Trial
from tinygc.challenge.other_effects import BURST_SAMPLES, BURSTS, CLIPPED, GLITCH_RPS, GLITCH_SAMPLES, GLITCHES
from tinygc.challenge.outsiders import OUTSIDERS
from tinygc.challenge.rate_effects import OFFSET_S
from tinygc.effects import catalogue


@dataclass(frozen=True, eq=False)
class Spoilt:
    """logs of the session with something concealed in them, and its truth: parameters by the names of docs/formats.md."""

    logs: tuple[Samples, ...]
    truth: dict


def inject(recording: Recording, trial: Trial) -> Spoilt:
    """The recording with what a trial conceals; the trial's seed decides directions, signs and moments."""
    rng = np.random.default_rng(trial.seed)
    logs = tuple(log.samples for log in recording.session.logs)
    steps = [steps_of(recording.session, number) for number in range(len(logs))]
    if trial.id in FAULTS:
        return FAULTS[trial.id](logs, steps, trial.size, rng)
    if trial.id == "reference.accelerometer":
        return _accelerometer(recording, logs, steps, trial.size, rng)
    changes, truth = rate_changes(recording, trial, rng)
    spoilt = [with_gyro(log, requantised(log.gyro, change, step.gyro, rng)) for log, change, step in zip(logs, changes, steps, strict=True)]
    return Spoilt(tuple(spoilt), truth)


def rate_changes(recording: Recording, trial: Trial, rng: np.random.Generator) -> tuple[list[np.ndarray], dict]:
    """What the readings of each log (N, 3), rad/s, gain: E^-1 (distorted less true rate); and the truth."""
    if trial.id in OUTSIDERS:
        hidden = OUTSIDERS[trial.id](Scene(rng, trial.size, recording, recording))
        distort, truth = hidden.distort, dict(hidden.truth)
        assert distort is not None  # all outsiders bend the rate
        distorted = [distort(m.t_s, m.rate, recording.force(log), m.temp_c) for log, m in enumerate(recording.movements)]
    elif trial.id == "timing.gyro_accel_offset":
        seconds = trial.size * OFFSET_S * float(rng.choice((-1.0, 1.0)))
        truth = {"seconds": seconds}
        distorted = [np.stack([np.interp(m.t_s - seconds, m.t_s, axis) for axis in m.rate.T], axis=-1) for m in recording.movements]
    else:
        effect = catalogue()[trial.id]
        if effect.scan is not None:
            values = effect.scan.grid(recording.movements) if effect.scan.grid else recording.log_s * rng.uniform(0.25, 0.75, 1)
            effect = effect.at(float(rng.choice(values)))
        direction = rng.standard_normal(effect.parameter.size)
        if getattr(effect.gauge, "never_negative", False):
            direction = np.abs(direction)
        shown = trial.size * direction / np.linalg.norm(direction)
        truth = {effect.parameter.name: shown.reshape(effect.parameter.shape).tolist(), **effect.shape}
        distorted = [effect.distort(m, shown * effect.parameter.si) for m in recording.movements]
    back = np.linalg.inv(recording.problem.first.E).T
    return [(each - m.rate) @ back for each, m in zip(distorted, recording.movements, strict=True)], truth


def requantised(old: np.ndarray, change: np.ndarray, step: float, rng: np.random.Generator) -> np.ndarray:
    """Readings with a change, in whole steps from the old ones: what is less than a step is rounded up as often as it is large, since
    nobody knows where between two steps the old reading was."""
    return old + step * np.floor(change / step + rng.uniform(size=change.shape))


def _accelerometer(recording: Recording, logs: tuple[Samples, ...], steps: list[Steps], size_mg: float, rng: np.random.Generator) -> Spoilt:
    """The accelerometer's pre-calibration leaves a bias, here of so many mg in a random direction."""
    parameter, direction = catalogue()["reference.accelerometer"].parameter, rng.standard_normal(3)
    bias = size_mg * direction / np.linalg.norm(direction)
    measured = np.linalg.inv(recording.session.config.accelerometer.matrix) @ (bias * parameter.si)
    changed = [
        log.with_accel(requantised(log.accel, np.broadcast_to(measured, log.accel.shape), step.accel, rng))
        for log, step in zip(logs, steps, strict=True)
    ]
    return Spoilt(tuple(changed), {parameter.name: bias.tolist()})


# Faults of the registers; strengths are of the strong size of ``other_effects``


def _saturation(logs: tuple[Samples, ...], steps: list[Steps], strength: float, rng: np.random.Generator) -> Spoilt:
    step = steps[0].gyro
    level = step * round((1 - CLIPPED * strength) * max(np.abs(log.gyro).max() for log in logs) / step)
    return Spoilt(tuple(with_gyro(log, np.clip(log.gyro, -level, level)) for log in logs), {"dps": float(np.rad2deg(level))})


def _glitches(logs: tuple[Samples, ...], steps: list[Steps], strength: float, rng: np.random.Generator) -> Spoilt:
    spoilt, at, before = [], [], 0
    for log, step in zip(logs, steps, strict=True):
        number = max(1, round(GLITCHES * len(log) / sum(map(len, logs))))
        gap, gyro = len(log) // (number + 1), log.gyro.copy()
        jump = step.gyro * max(1, round(strength * GLITCH_RPS / step.gyro))
        for row in gap * np.arange(1, number + 1) + rng.integers(-gap // 3, gap // 3, number):
            gyro[row : row + GLITCH_SAMPLES] += jump * rng.choice((-1, 1), 3)
            at.append(before + int(row))
        spoilt.append(with_gyro(log, gyro))
        before += len(log)
    return Spoilt(tuple(spoilt), {"at": at, "samples": GLITCH_SAMPLES})


def _dropped(logs: tuple[Samples, ...], steps: list[Steps], strength: float, rng: np.random.Generator) -> Spoilt:
    """Bursts are lost while the body turns, and the later samples take the stamps of the earlier ones."""
    length, spoilt = max(1, round(BURST_SAMPLES * strength)), []
    for log in logs:
        speed = np.linalg.norm(log.gyro - np.median(log.gyro, axis=0), axis=1)
        fast = np.flatnonzero(speed > np.quantile(speed, 0.75))
        number = max(1, round(BURSTS * len(log) / sum(map(len, logs))))
        rows = [int(rng.choice(part)) for part in np.array_split(fast, number) if len(part)]
        lost = np.unique(np.add.outer(rows, np.arange(length)).clip(0, len(log) - 1))
        kept = np.delete(np.arange(len(log)), lost)
        temp_c = None if log.temp_c is None else log.temp_c[kept]
        spoilt.append(replace(log, t_ns=log.t_ns[: len(kept)], gyro=log.gyro[kept], accel=log.accel[kept], temp_c=temp_c))
    return Spoilt(tuple(spoilt), {"length": length})


FAULTS = {"gyro.saturation": _saturation, "data.glitches": _glitches, "timing.dropped_samples": _dropped}
