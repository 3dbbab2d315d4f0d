"""A drawn movement, of no recording: by it, forms are told apart that any movement would tell apart.

Every quantity takes values all over its range and of both signs, independent of the others, so that steps at neighbouring thresholds
differ in a few samples.
"""

from __future__ import annotations

import numpy as np

from session.common.units import DEG
from tinygc.effects import Movement

SAMPLES, RATE_HZ, FULL_SCALE = 2400, 10.0, 500 * DEG
#: of a sampling period, by which samples stray, so that no time is a multiple of it; samples of the shortest and the longest turn or rest
STRAY, SHORTEST, LONGEST = 0.2, 10, 240
#: of a turn's size: 1 to 10 dps is slower than what ends a rest, and faster than noise
CREEP = 0.015


def some_movement(seed: int) -> Movement:
    """Four minutes of turns, rests and creeps of many lengths, warming up and cooling down, vibrated."""
    rng = np.random.default_rng(seed)
    t_s = (np.arange(SAMPLES) + rng.uniform(0, STRAY, SAMPLES)) / RATE_HZ
    force = _wandering(rng, 3)
    return Movement(
        t_s=rng.uniform(0.1, 0.5) + t_s,
        dt_s=1 / RATE_HZ,
        rate=0.8 * FULL_SCALE * _turning(rng)[:, None] * _wandering(rng, 3),
        force_g=force / np.linalg.norm(force, axis=1, keepdims=True) * rng.uniform(0.8, 1.2, (SAMPLES, 1)),
        temp_c=25 + 10 * _wandering(rng, 1)[:, 0],
        vibration_g2=rng.uniform(0.0, 0.2, SAMPLES),
        duration_s=SAMPLES / RATE_HZ + 1.0,
        fs_rps=FULL_SCALE,
        first_temp_c=25.0,
    )


def _turning(rng: np.random.Generator) -> np.ndarray:
    """(SAMPLES,) a swell up to 1 in turns and to ``CREEP`` in every other rest, 0 in the others.

    It begins in a turn, soon over, and with the longest rest: what settles with time is not yet settled there.
    """
    found, first, number = np.zeros(SAMPLES), 0, 0
    while first < SAMPLES:
        length = (SHORTEST, LONGEST)[number] if number < 2 else int(np.exp(rng.uniform(np.log(SHORTEST), np.log(LONGEST))))
        phase = (np.arange(length) + 0.5) / length
        swell = np.cos(np.pi / 2 * phase) if number == 0 else np.sin(np.pi * phase)
        found[first : first + length] = ((1.0, 0.0, 1.0, CREEP)[number % 4] * swell)[: SAMPLES - first]
        first, number = first + length, number + 1
    return found


def _wandering(rng: np.random.Generator, axes: int) -> np.ndarray:
    """(SAMPLES, axes) smooth over a second or so, even over −1 to 1."""
    noise = rng.standard_normal((SAMPLES + 20, axes))
    smooth = np.stack([np.convolve(column, np.hanning(22)[1:], mode="valid") for column in noise.T], axis=1)
    return 2 * np.argsort(np.argsort(smooth, axis=0), axis=0) / (SAMPLES - 1) - 1
