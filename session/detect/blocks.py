"""Short blocks of samples and their moments: what stillness and noise are judged by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.log.samples import Samples

BLOCK_S = 0.1  #: long beside a gyro's filter, short beside a hand's pause
MIN_BLOCK_SAMPLES = 8  #: below this a variance says little
_CHUNK_BLOCKS = 20_000  #: keeps the working memory small on logs of any length


@dataclass(frozen=True, eq=False)
class Blocks:
    """Moments of consecutive blocks of ``size`` samples: gyro_mean, gyro_var, accel_mean, accel_var, all (B, 3), SI."""

    size: int
    duration_s: float
    gyro_mean: np.ndarray
    gyro_var: np.ndarray
    accel_mean: np.ndarray
    accel_var: np.ndarray

    def __len__(self) -> int:
        return len(self.gyro_mean)


def block_size(period_s: float) -> int:
    """Samples in a block of about ``BLOCK_S``."""
    return max(MIN_BLOCK_SAMPLES, round(BLOCK_S / period_s))


def block_moments(samples: Samples, size: int | None = None) -> Blocks:
    """Cut samples into blocks of ``size`` samples, or of about ``BLOCK_S``; what is left at the end and fills no block is not looked at."""
    size = size or block_size(samples.period_s)
    gyro_mean, gyro_var = _moments(samples.gyro, size)
    accel_mean, accel_var = _moments(samples.accel, size)
    return Blocks(size, size * samples.period_s, gyro_mean, gyro_var, accel_mean, accel_var)


def _moments(values: np.ndarray, size: int) -> tuple[np.ndarray, np.ndarray]:
    count = len(values) // size
    mean, var = np.empty((count, 3)), np.empty((count, 3))
    for first in range(0, count, _CHUNK_BLOCKS):
        last = min(first + _CHUNK_BLOCKS, count)
        part = values[first * size : last * size].reshape(last - first, size, 3)
        mean[first:last] = part.sum(axis=1) / size
        centred = part - mean[first:last, None]
        var[first:last] = np.einsum("bsi,bsi->bi", centred, centred) / (size - 1)
    return mean, var
