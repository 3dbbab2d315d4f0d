"""Rest logs of a few blocks, made from arrays."""

from pathlib import Path

import numpy as np

from session.io.rests import RestLog


def small_rest(temp_c, gyro=None, block_s=10.0, number=None, name="rest.csv", sd=None):
    """Temperatures (B,), block means (B,) or (B, 3), scatter (B, 3); number (B,) where blocks are missing."""
    count = len(temp_c)
    gyro = np.zeros((count, 3)) if gyro is None else np.asarray(gyro, dtype=float).reshape(count, -1) * np.ones(3)
    number = np.arange(count) if number is None else np.asarray(number)
    sd = np.ones((count, 3)) if sd is None else np.asarray(sd, dtype=float)
    temp, force, ten = np.asarray(temp_c, dtype=float), np.tile([0.0, 0.0, -9.8], (count, 1)), np.full(count, 10)
    return RestLog(Path(name), number, block_s, temp, gyro, force, sd, 1e-3 * sd, ten, 10 * count, block_s / 10)


def triangle(count, half, low=10.0, high=30.0):
    """Temperatures (count,) that go up for ``half`` blocks, down for as many, and so on."""
    return low + (high - low) * (1 - np.abs((np.arange(count) % (2 * half)) / half - 1))
