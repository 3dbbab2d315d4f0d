"""A drawn movement, of no recording: by it, forms are told apart that any movement would."""

from __future__ import annotations

from functools import cache

import numpy as np

from session.common.units import DEG
from tinygc.effects import Movement

SAMPLES, RATE_HZ = 240, 20.0


@cache
def some_movement(seed: int = 20261123) -> Movement:
    """Twelve seconds of turns and rests, warming up and cooling down, vibrated; begun some time after switch-on."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(SAMPLES) / RATE_HZ
    turning = np.repeat(rng.uniform(size=12) > 0.35, SAMPLES // 12)[:, None]
    smooth = np.cumsum(rng.standard_normal((SAMPLES, 3)), axis=0)
    rate = turning * (smooth - smooth.mean(axis=0)) * 25 * DEG
    force = rng.standard_normal(3) + 0.2 * np.cumsum(rng.standard_normal((SAMPLES, 3)), axis=0)
    return Movement(
        t_s=37.0 + t_s,
        dt_s=1 / RATE_HZ,
        rate=rate,
        force_g=force / np.linalg.norm(force, axis=1, keepdims=True) * rng.uniform(0.9, 1.1, (SAMPLES, 1)),
        temp_c=25 + 4 * np.sin(t_s / 3) + t_s / 5,
        vibration_g2=rng.uniform(0.01, 0.2, SAMPLES),
        duration_s=60.0,
        fs_rps=500 * DEG,
        first_temp_c=24.0,
    )
