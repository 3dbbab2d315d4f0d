"""What rewards smoothing without new labels: the log's own neighbours, and the stills' known zero.

The endpoint loss integrates, and integration hides noise.  Two figures of a filter h (one axis, taps h_j, sum 1) do not, and both are
quadratic in h:

    at rest     E f^2 = h' R h                                                     R_ij = r(i - j), r the noise's autocovariance
    in motion   E (f_k - s_k-D)^2 = h' A h + 2 sum_j h_j r(j - D) - r(0)           A_ij = mean (x_k-i - x_k-D)(x_k-j - x_k-D)

x = s + n is what the calibrated gyro reads, s the true rate D samples ago, which nobody knows.  Taking the noisy neighbour x_k-D for it is
noise-to-noise learning (Lehtinen et al. 2018); since x_k-D is in the window itself, the noise that filter and target share is paid
back (Stein 1981), with r as the stills show it, where the rate is known to be none but the Earth's.

The two pull against each other.  ``ideal`` weighs them so that noise at rest falls by a stated factor, and motion suffers least, among
the filters that pass every cubic unchanged, D samples late: moments 1 to 3 of the taps about D are zero.  Why those: by parts, over a
movement from rest to rest, the first moment of one axis against another's is a skew of the axes, and the second acts like
-m2/2 sum R (w x w') dt, a coning error; without the pins a threefold reduction cost half of the closure and more.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

#: lags beyond which the noise of a gyroscope behind its low-pass is taken to be independent
LAGS = 12
#: of white noise of the same variance: what rounding to whole steps alone leaves at any frequency is more
LEAST_POWER = 0.01
#: powers of ten between which the weight of rest against motion is sought
WEIGHTS = (-8.0, 9.0)
#: moments of the taps about the delay, the zeroth (the gain) included
MOMENTS = 4


@dataclass(frozen=True, eq=False)
class Risk:
    """Of one session at one delay: noise (3, K) rad^2/s^2, r at lags 0 to K - 1; motion (3, K, K), A; delay D; samples behind A."""

    noise: np.ndarray
    motion: np.ndarray
    delay: int
    samples: int

    @cached_property
    def covariance(self) -> np.ndarray:
        """(3, K, K): R."""
        k = np.arange(self.noise.shape[1])
        return self.noise[:, np.abs(k[:, None] - k)]

    @property
    def shared(self) -> np.ndarray:
        """(3, K): r(j - D), what tap j has in common with the target's noise."""
        return self.noise[:, np.abs(np.arange(self.noise.shape[1]) - self.delay)]

    def at_rest(self, taps: np.ndarray) -> np.ndarray:
        """(3,) rad^2/s^2: variance of filtered noise; taps (3, K)."""
        return np.einsum("ai,aij,aj->a", taps, self.covariance, taps)

    def in_motion(self, taps: np.ndarray) -> np.ndarray:
        """(3,) rad^2/s^2: expected squared error against the true rate D samples ago; taps (3, K) that sum to 1."""
        return np.einsum("ai,aij,aj->a", taps, self.motion, taps) + 2 * np.sum(self.shared * taps, axis=1) - self.noise[:, 0]

    def ideal(self, reduction: float) -> tuple[np.ndarray, np.ndarray]:
        """The taps (3, K) best in motion among those that divide noise at rest by ``reduction`` or more, and rest's weight (3,)."""
        taps, weights = np.zeros_like(self.noise), np.zeros(3)
        for axis in range(3):
            low, high = WEIGHTS
            for _ in range(40):
                middle = (low + high) / 2
                h = self._best(axis, 10.0**middle)
                enough = h @ self.covariance[axis] @ h * reduction**2 <= self.noise[axis, 0]
                low, high = (low, middle) if enough else (middle, high)
            taps[axis], weights[axis] = self._best(axis, 10.0**high), 10.0**high
        return taps, weights

    def _best(self, axis: int, weight: float) -> np.ndarray:
        """argmin of h' (A + weight R) h + 2 shared' h, with gain 1 and the other moments zero (Lagrange)."""
        pins = moments(self.noise.shape[1], self.delay)
        solved = np.linalg.solve(self.motion[axis] + weight * self.covariance[axis], np.column_stack([-self.shared[axis], pins.T]))
        free, pulls = solved[:, 0], solved[:, 1:]
        return free + pulls @ np.linalg.solve(pins @ pulls, np.eye(MOMENTS)[0] - pins @ free)


def moments(taps: int, delay: int) -> np.ndarray:
    """(MOMENTS, taps): rows whose product with the taps is their moments about the delay, in tens of samples."""
    return ((np.arange(taps) - delay) / 10.0) ** np.arange(MOMENTS)[:, None]


def autocovariance(stills: list[np.ndarray], taps: int) -> np.ndarray:
    """(3, taps) of the rates (n, 3) rad/s in each still about their mean, zero beyond LAGS."""
    total, count = np.zeros((3, taps)), np.zeros(taps)
    for rate in stills:
        x = rate - rate.mean(axis=0)
        for lag in range(min(LAGS + 1, taps, len(x))):
            total[:, lag] += np.sum(x[lag:] * x[: len(x) - lag], axis=0)
            count[lag] += max(len(x) - 1 - lag, 0)
    return np.array([_positive(each) for each in total / np.maximum(count, 1)])


def _positive(noise: np.ndarray) -> np.ndarray:
    """(K,) autocovariance of a process that can be.  Lags that were estimated one by one, and cut off at LAGS, need not be one: then the
    power of the frequencies where they leave less than ``LEAST_POWER`` is raised to that; all else stays."""
    taps = len(noise)
    k = np.arange(taps)
    if not noise[0] > 0 or not np.isfinite(noise).all() or np.linalg.eigvalsh(noise[np.abs(k[:, None] - k)])[0] > 0:
        return noise
    around = np.concatenate([noise, np.zeros(2 * taps), noise[:0:-1]])  # a circle, of which K lags in a row are no circle
    power = np.fft.fft(around).real
    raised = np.fft.ifft(np.maximum(power, LEAST_POWER * noise[0])).real[:taps]
    return raised * (noise[0] / raised[0])


def measure(rates: list[np.ndarray], stills: list[np.ndarray], taps: int, delay: int) -> Risk:
    """From calibrated rates (n, 3) rad/s of whole stretches of movement, and of stills."""
    total, count = np.zeros((3, taps, taps)), 0
    for rate in rates:
        for axis in range(3):
            windows = np.lib.stride_tricks.sliding_window_view(rate[:, axis], taps)[:, ::-1]  # newest first
            off = windows - windows[:, delay : delay + 1]
            total[axis] += off.T @ off
        count += len(rate) - taps + 1
    return Risk(autocovariance(stills, taps), total / max(count, 1), delay, count)
