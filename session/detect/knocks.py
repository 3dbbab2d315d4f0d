"""Blocks of a rest log in which somebody knocked, leant or walked: their scatter is beyond what the others have.

The scatter may follow temperature, so a block is held against its neighbours in time; how far the logarithm of a variance strays without
a knock is taken from the log itself.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import median_filter
from scipy.stats import norm

from session.common.robust import sigma_of
from session.log.rests import RestLog

#: blocks around one whose median is its yardstick: a knock is shorter, a change of temperature slower
AROUND = 121
#: knocks that are found in a whole log where there is none, on average
FALSE = 0.01
#: blocks on either side of a knock that go with it: it rings on
BESIDE = 1


def knocked(log: RestLog) -> np.ndarray:
    """(B,) bool: blocks to leave out."""
    found = np.zeros(len(log), dtype=bool)
    sigmas = norm.isf(FALSE / max(6 * len(log), 1))
    for values in (*log.gyro_sd.T, *log.accel_sd.T):
        # A sensor whose register stands still has no scatter: half the smallest that there is stands for none.
        least = values[values > 0].min(initial=np.inf)
        if not np.isfinite(least):
            continue
        level = np.log(np.maximum(values, least / 2))
        off = level - median_filter(level, size=min(AROUND, len(level)), mode="nearest")
        found |= off > sigmas * max(float(sigma_of(off)), 1e-9)
    return _widened(found, BESIDE)


def _widened(flags: np.ndarray, by: int) -> np.ndarray:
    wide = flags.copy()
    for step in range(1, by + 1):
        wide[step:] |= flags[:-step]
        wide[:-step] |= flags[step:]
    return wide
