"""The wandering of the bias that a sensor's data sheet allows: flicker noise of a given bias instability.

Flicker noise of instability B has the one-sided density B^2 / (pi f), so each octave of frequency carries the variance
B^2 ln 2 / pi, and the Allan deviation's floor is 0.664 B (IEEE 952, C.1).  One Gauss-Markov process an octave adds up to it.
"""

from __future__ import annotations

import numpy as np

from session.units import DEG_PER_HOUR

#: ISM330DHCX, the ASM330LHH's sibling (SENSOR, 1.2)
BIAS_INSTABILITY_RPS = 3 * DEG_PER_HOUR
#: correlation times of the octaves, s: from a still to a working hour
TIMES_S = 2.0 ** np.arange(-1, 12)


def wander_covariance(t_s: np.ndarray) -> np.ndarray:
    """(N, N) (rad/s)^2 of one axis' bias at moments t_s (N,)."""
    apart = np.abs(t_s[:, None] - t_s[None])
    octave = BIAS_INSTABILITY_RPS**2 * np.log(2) / np.pi
    return octave * sum(np.exp(-apart / time) for time in TIMES_S)
