"""Stillness as it happens, a block of 0.1 s at a time, by the bars of ``session.detect.stills``.

What it says is for the person at the table.  Whether a still counts is asked of ``session.detect.stills`` itself (``window``), so that the
recorded log is judged alike.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from session.common.robust import sigma_of
from session.common.units import DEG, MDPS, MG
from session.detect.blocks import block_moments, block_size
from session.detect.stills import MEAN_SIGMAS, QUIET_ACCEL_RATIO, QUIET_VARIANCE_RATIO, TURNING_RPS, noise_variance
from session.log.samples import Samples

#: until a first still is known, no more than this is taken for the sensor's own noise: three times the data sheet's, one-sided densities
GYRO_CEILING, ACCEL_CEILING = 15 * MDPS, 180e-3 * MG
CEILING_S = 60.0  #: a table that has not rested for so long trembles; then its own calmest blocks are the yardstick
MEMORY_BLOCKS = 12_000  #: 20 min
NOISE_EVERY = 10  #: blocks from one look at the noise to the next
UNKNOWN_ZERO_RPS = 10.0 * DEG  #: no gyro reads that much at rest


@dataclass(frozen=True, eq=False)
class Block:
    """Mean rate (3,) and peak of one block, rad/s; quiet: whether it could be part of a still; why not, with number and bar."""

    duration_s: float
    gyro_mean: np.ndarray
    peak_rps: float
    quiet: bool
    why: str


class Stillness:
    """Judges one block after the other.  period_s: the usual time between two samples."""

    def __init__(self, period_s: float):
        self._period_s = period_s
        self.size = block_size(period_s)
        self._gyro_var: deque[np.ndarray] = deque(maxlen=MEMORY_BLOCKS)
        self._accel_var: deque[np.ndarray] = deque(maxlen=MEMORY_BLOCKS)
        self._steps: deque[np.ndarray] = deque(maxlen=200)
        self._noise: tuple[np.ndarray, np.ndarray] | None = None
        self._run: list[np.ndarray] = []
        self.zero_rps: np.ndarray | None = None  #: what the gyro reads at rest, once a still is known

    @property
    def block_s(self) -> float:
        """Length of a block, s."""
        return self.size * self._period_s

    def feed(self, samples: Samples) -> Block:
        """What a block of ``size`` samples shows."""
        moments = block_moments(samples, self.size)
        gyro_mean, gyro_var, accel_var = moments.gyro_mean[0], moments.gyro_var[0], moments.accel_var[0]
        self._gyro_var.append(gyro_var)
        self._accel_var.append(accel_var)
        why = self._why_not_quiet(gyro_mean, gyro_var, accel_var)
        if why:
            self._run = []
        else:
            if self._run:
                self._steps.append(np.abs(gyro_mean - self._run[-1]))
            self._run = [*self._run[-100:], gyro_mean]
        return Block(self.block_s, gyro_mean, float(np.abs(samples.gyro).max()), not why, why)

    def _why_not_quiet(self, gyro_mean: np.ndarray, gyro_var: np.ndarray, accel_var: np.ndarray) -> str:
        gyro_noise, accel_noise = self._noise_now()
        rate = gyro_mean - (0.0 if self.zero_rps is None else self.zero_rps)
        bar = UNKNOWN_ZERO_RPS if self.zero_rps is None else TURNING_RPS
        if np.abs(rate).max() > bar:
            axis = int(np.argmax(np.abs(rate)))
            return f"turning at {abs(rate[axis]) / DEG:.1f} > {bar / DEG:.0f} dps about {'xyz'[axis]}"
        if words := _scatter(gyro_var, gyro_noise, QUIET_VARIANCE_RATIO, DEG, "rate scatter", "dps"):
            return words
        if words := _scatter(accel_var, accel_noise, QUIET_ACCEL_RATIO, MG, "it trembles:", "mg"):
            return words
        if len(self._run) >= 3:
            away = np.abs(gyro_mean - np.median(self._run, axis=0)) / (MEAN_SIGMAS * self._spread(gyro_noise))
            axis = int(np.argmax(away))
            if away[axis] > 1:
                rate = abs(gyro_mean - np.median(self._run, axis=0))[axis] / DEG
                return f"rate moved by {rate:.3f} > {rate / away[axis]:.3f} dps on {'xyz'[axis]}"
        return ""

    def _noise_now(self) -> tuple[np.ndarray, np.ndarray]:
        """Variances (3,) of the sensor's noise."""
        if self._noise is None or len(self._gyro_var) % NOISE_EVERY == 0 or len(self._gyro_var) < 50:
            gyro, accel = noise_variance(np.array(self._gyro_var)), noise_variance(np.array(self._accel_var))
            if self.zero_rps is None and len(self._gyro_var) * self.block_s < CEILING_S:
                band_hz = 0.5 / self._period_s
                gyro, accel = np.minimum(gyro, GYRO_CEILING**2 * band_hz), np.minimum(accel, ACCEL_CEILING**2 * band_hz)
            self._noise = gyro, accel
        return self._noise

    def _spread(self, gyro_noise: np.ndarray) -> np.ndarray:
        """(3,) standard deviation of a block's mean.  Noise behind a low-pass is not white: a few blocks tell better than their samples."""
        if len(self._steps) < 20:
            return 2 * np.sqrt(gyro_noise / self.size)
        return sigma_of(np.array(self._steps)) / np.sqrt(2)


def _scatter(variance: np.ndarray, noise: np.ndarray, ratio: float, unit: float, what: str, unit_name: str) -> str:
    """Whether a block's scatter leaves what the noise allows: "rate scatter 0.31 > 0.20 dps on z"."""
    share = np.maximum(variance / (2 * ratio * noise), (variance / noise).mean() / ratio * (variance == variance.max()))
    axis = int(np.argmax(share))
    if share[axis] < 1:
        return ""
    found = np.sqrt(variance[axis]) / unit
    return f"{what} {found:.2f} > {found / np.sqrt(share[axis]):.2f} {unit_name} on {'xyz'[axis]}"
