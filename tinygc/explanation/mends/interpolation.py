"""What was not read, from its neighbours: a polynomial across the gap, of the order that crosses this recording's own movement best.

A smooth movement asks for a high order, noise and long gaps for a low one.  Gaps of the same length where nothing is missing say which,
and how far off the rotation over the gap may be: so much nobody can know.
"""

from __future__ import annotations

import numpy as np

from session.log.samples import Samples

SIDE = 4  #: samples on either side that carry the polynomial: two more than the highest order has coefficients
ORDERS = (1, 3, 5)
#: share of the speed at the gaps, from which on a place is like them, up to its inverse (not critical: benchmarks/thresholds.py)
AS_FAST = 0.5
FEWEST_TRIALS = 40  #: places: their rms is then known to 11 %; where fewer are alike, all that are as fast
MOST_TRIALS = 400  #: gaps that are tried where nothing is missing: their rms is then known to 4 %


def across(values: np.ndarray, before: int, after: int, count: int, order: int) -> np.ndarray:
    """``count`` readings (count, C) between rows ``before`` and ``after`` of values (N, C)."""
    rows = np.concatenate([np.arange(before - SIDE + 1, before + 1), np.arange(after, after + SIDE)])
    return _weights(count, order) @ values[np.clip(rows, 0, len(values) - 1)]


def best_order(samples: Samples, rows: np.ndarray, count: int) -> tuple[int, float]:
    """The order that crosses gaps of ``count`` best where the gyro turns as it does at ``rows``, and the rotation, rad rms per axis,
    that it misses."""
    speed = np.linalg.norm(samples.gyro, axis=1)
    reach = count + SIDE
    here = np.median(speed[rows])
    usable = speed >= AS_FAST * here
    for row in rows:
        usable[max(row - reach - count, 0) : row + reach + count] = False
    usable[:reach] = usable[len(usable) - 2 * reach :] = False
    alike = np.flatnonzero(usable & (speed <= here / AS_FAST))
    places = alike if len(alike) >= FEWEST_TRIALS else np.flatnonzero(usable)
    if not len(places):
        return 3, 0.0
    places = places[:: -(-len(places) // MOST_TRIALS)]
    beside = np.concatenate([np.arange(-SIDE, 0), np.arange(count, count + SIDE)])
    true = samples.gyro[places[:, None] + np.arange(count)].sum(axis=1)
    missed = {}
    for order in ORDERS:
        crossed = np.einsum("s,psj->pj", _weights(count, order).sum(axis=0), samples.gyro[places[:, None] + beside])
        missed[order] = float(np.sqrt(np.mean((crossed - true) ** 2))) * samples.period_s
    order = min(missed, key=missed.__getitem__)
    return order, missed[order]


def _weights(count: int, order: int) -> np.ndarray:
    """(count, 2 SIDE): of the neighbours' readings in each reading between, by least squares."""
    at = np.concatenate([np.arange(-SIDE, 0), np.arange(count, count + SIDE)])
    scale = count / 2 + SIDE
    middle = (count - 1) / 2
    known = np.polynomial.legendre.legvander((at - middle) / scale, order)
    return np.polynomial.legendre.legvander((np.arange(count) - middle) / scale, order) @ np.linalg.pinv(known)
