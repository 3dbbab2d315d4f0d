"""A drawn movement, of no recording: by it, forms are told apart that any movement would tell apart."""

from __future__ import annotations

import numpy as np

from session.common.units import DEG
from tinygc.effects import Movement

SAMPLES, RATE_HZ, PARTS = 600, 10.0, 24


def some_movement(seed: int) -> Movement:
    """A minute of turns and rests, warming up and cooling down, vibrated; begun some time after switch-on."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(SAMPLES) / RATE_HZ
    turning = np.repeat(rng.uniform(size=PARTS) > 0.4, SAMPLES // PARTS)[:, None]
    rate = turning * _wandering(rng, 3) * 150 * DEG
    force = rng.standard_normal(3) + _wandering(rng, 3)
    return Movement(
        t_s=rng.uniform(0.5, 3.0) + t_s,
        dt_s=1 / RATE_HZ,
        rate=rate,
        force_g=force / np.linalg.norm(force, axis=1, keepdims=True) * rng.uniform(0.9, 1.1, (SAMPLES, 1)),
        temp_c=25 + 3 * _wandering(rng, 1)[:, 0],
        vibration_g2=rng.uniform(0.01, 0.2, SAMPLES),
        duration_s=SAMPLES / RATE_HZ + 3.0,
        fs_rps=500 * DEG,
        first_temp_c=25.0 + rng.uniform(-1, 1),
    )


def _wandering(rng: np.random.Generator, axes: int) -> np.ndarray:
    """(SAMPLES, axes) smooth over a second or so, of size one, of both signs."""
    steps = np.cumsum(rng.standard_normal((SAMPLES, axes)), axis=0)
    slow = np.cumsum(steps, axis=0)
    beside = 10
    smooth = (slow[beside:] - slow[:-beside])[np.linspace(0, SAMPLES - beside - 1, SAMPLES).astype(int)]
    smooth = smooth - smooth.mean(axis=0)
    return smooth / smooth.std(axis=0)
