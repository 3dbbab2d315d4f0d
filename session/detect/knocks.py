"""Blocks of a rest log in which somebody knocked, leant or walked: their scatter is beyond what the others have.

The scatter may follow temperature, so a block is held against its neighbours in time; how far the logarithm of a variance strays without
a knock is taken from the log itself.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import percentile_filter
from scipy.stats import norm

from session.log.rests import RestLog

#: percentiles by which quiet blocks are known: a quarter of all is taken to be quiet, and how these scatter is their sigma
LOWEST, QUIET = 5, 25
#: blocks around one whose quarter is its yardstick: a knock is shorter, a change of temperature slower
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
        off = level - percentile_filter(level, QUIET, size=min(AROUND, len(level)), mode="nearest")
        # By the quieter blocks: they are still even where half of a log is not.
        low, quiet = np.percentile(off, [LOWEST, QUIET])
        sigma = max((quiet - low) / (norm.ppf(QUIET / 100) - norm.ppf(LOWEST / 100)), 1e-9)
        found |= off - quiet + norm.ppf(QUIET / 100) * sigma > sigmas * sigma
    return _widened(found, BESIDE)


def _widened(flags: np.ndarray, by: int) -> np.ndarray:
    wide = flags.copy()
    for step in range(1, by + 1):
        wide[step:] |= flags[:-step]
        wide[:-step] |= flags[step:]
    return wide
