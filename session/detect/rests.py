"""Rests: phases in which a vehicle stands, though its motors may shake it.

A still (``session/detect/stills.py``) is quiet to the sensor's own noise; a rest need not be: only the means over quarter seconds of
rate and specific force stay where they are.  Good for a bias, not for a reference.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.runs import runs_of
from session.common.units import DEG
from session.log.samples import Samples

BLOCK_S = 0.25
LEAST_S = 1.5
#: scatter of the blocks' means, one sigma, per axis: a hovering vehicle sways by ten times as much
RATE_RPS = 0.25 * DEG
FORCE_MPS2 = 0.06


@dataclass(frozen=True, eq=False)
class Rest:
    """Samples ``start <= i < stop``; gyro_mean (3,) rad/s."""

    start: int
    stop: int
    gyro_mean: np.ndarray


def find_rests(samples: Samples) -> list[Rest]:
    """All rests of at least 1.5 s, in order.  Rows whose specific force is exactly zero have none, and are no part of a rest."""
    size = max(1, round(BLOCK_S / samples.period_s))
    count, length = len(samples) // size, round(LEAST_S / BLOCK_S)
    if count < length:
        return []
    blocks = [values[: count * size].reshape(count, size, 3) for values in (samples.gyro, samples.accel)]
    steady = np.ones(count - length + 1, dtype=bool)
    for values, bar in zip(blocks, (RATE_RPS, FORCE_MPS2), strict=True):
        windows = np.lib.stride_tricks.sliding_window_view(values.mean(axis=1), length, axis=0)
        steady &= (windows.std(axis=-1, ddof=1) < bar).all(axis=1)
    whole = (np.abs(blocks[1]).sum(axis=2) > 0).all(axis=1)
    steady &= np.lib.stride_tricks.sliding_window_view(whole, length).all(axis=1)
    rest = np.zeros(count, dtype=bool)
    for start in np.flatnonzero(steady):
        rest[start : start + length] = True
    rows = [(int(start) * size, int(stop) * size) for start, stop in zip(*runs_of(rest), strict=True)]
    return [Rest(start, stop, samples.gyro[start:stop].mean(axis=0)) for start, stop in rows]
