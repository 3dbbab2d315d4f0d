"""The wandering of the bias that a sensor's data sheet allows: flicker noise of a given bias instability.

Flicker noise of instability B has the one-sided density B^2 / (pi f), so each octave of frequency carries the variance
B^2 ln 2 / pi, and the Allan deviation's floor is 0.664 B (IEEE 952, C.1).  One Gauss-Markov process an octave adds up to it.
"""

from __future__ import annotations

import numpy as np

from session.common.units import DEG_PER_HOUR

#: ISM330DHCX, the ASM330LHH's sibling (SENSOR, 1.2)
BIAS_INSTABILITY_RPS = 3 * DEG_PER_HOUR
#: correlation times of the octaves, s: from a still to a working hour
TIMES_S = 2.0 ** np.arange(-1, 12)


def wander_covariance(t_s: np.ndarray, span_s: np.ndarray | float = 0.0) -> np.ndarray:
    """(N, N) (rad/s)^2 of one axis' bias at moments t_s (N,), each the mean over a span_s (N,) around it."""
    apart = np.abs(t_s[:, None] - t_s[None])
    octave = BIAS_INSTABILITY_RPS**2 * np.log(2) / np.pi
    span = np.broadcast_to(span_s, t_s.shape)
    total = np.zeros(apart.shape)
    for time in TIMES_S:
        left = np.sqrt(_left_by_mean(span / time))
        total += np.exp(-apart / time) * np.outer(left, left)
    return octave * total


def _left_by_mean(x: np.ndarray) -> np.ndarray:
    """Share of a Gauss-Markov process's variance that its mean over x correlation times keeps: 2 (x - 1 + e^-x) / x^2."""
    safe = np.maximum(x, 1e-3)
    return np.where(x > 1e-3, 2 * (safe - 1 + np.exp(-safe)) / safe**2, 1.0)
