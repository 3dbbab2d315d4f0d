"""The way back from an effect that jumps with the rate: at a threshold, at zero, where a sense turns over.

A jump that takes off what it adds makes some readings belong to two rates, one on each side of it; repeated substitution takes either.  A
rate is smooth: of the two, the one is right that goes on as the rate did before.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tinygc.effects.device import PASSES
from tinygc.effects.movement import Movement
from tinygc.effects.reach import Reach

#: samples in a row that may belong to two rates, and whose beginning tells which: a hand passes a threshold within some
JUMPS_REACH = Reach(before_samples=64)
#: of what the effect adds at most: rates that are so near are one
ALIKE = 0.01


def undone_with_jumps(
    measured: np.ndarray, movement: Movement, added: Callable[[Movement], np.ndarray], passes: int = PASSES
) -> np.ndarray:
    """The rate (N, 3) rad/s with rate + added(movement with that rate) = measured; of several, the one that goes on as it did before.

    passes: of substitution; a strong effect needs more.
    """

    def without(rate: np.ndarray) -> np.ndarray:
        for _ in range(passes):
            rate = measured - added(movement.with_rate(rate))
        return rate

    plain = without(measured)
    step = np.abs(measured - plain).max(axis=0, initial=0.0)
    # The true rate is no farther than a step from the measured one, so it is on the side of one of these.
    outward = step * np.where(measured < 0, -1.0, 1.0)
    found = np.stack([plain, without(measured + outward), without(measured - outward)])
    holds = np.stack([np.abs(measured - added(movement.with_rate(rate)) - rate) <= ALIKE * step for rate in found])
    rate = np.where(holds[0], found[0], np.where(holds[1], found[1], np.where(holds[2], found[2], plain)))
    several = (holds & (np.abs(found - rate) > ALIKE * step)).any(axis=0)
    for axis in np.flatnonzero(several.any(axis=0)):
        _go_on(rate[:, axis], np.flatnonzero(several[:, axis]), found[:, :, axis], holds[:, :, axis])
    return rate


def _go_on(rate: np.ndarray, rows: np.ndarray, found: np.ndarray, holds: np.ndarray) -> None:
    """Of the rates (K, N) of an axis that hold in these rows, into ``rate`` (N,), the nearest to a straight line through those before."""
    for row in rows:
        before = rate[max(row - 2, 0) : row]
        ahead = 2 * before[-1] - before[0] if len(before) else 0.0
        those = found[holds[:, row], row]
        rate[row] = those[np.argmin(np.abs(those - ahead))]
