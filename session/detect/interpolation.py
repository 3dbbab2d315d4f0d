"""What was not read, from its neighbours: a polynomial across the gap, of the order that crosses this recording's own movement best.

A smooth movement asks for a high order, noise and long gaps for a low one.  Gaps of the same length where nothing is missing say which,
and how far off the rotation over the gap may be: so much nobody can know.
"""

from __future__ import annotations

import numpy as np

from session.log.readings import pieces
from session.log.samples import Samples

SIDE = 4  #: samples on either side that carry the polynomial: two more than the highest order has coefficients
ORDERS = (1, 3, 5)
#: share of the speed at the gaps, or of the bend beside one, from which on a place is like them, up to its inverse
#: (not critical: benchmarks/thresholds.py)
AS_FAST = 0.5
FEWEST_TRIALS = 40  #: places: their rms is then known to 11 %; where fewer are alike, all that are as fast
BEND_STEPS = 4  #: to an octave, in which bends are alike
#: places whose bend is looked up: those of a session of an hour; of a day every so many
MOST_PLACES = 1 << 20
MOST_TRIALS = 400  #: gaps that are tried where nothing is missing: their rms is then known to 4 %


def across(values: np.ndarray, before: int, after: int, count: int, order: int) -> np.ndarray:
    """``count`` readings (count, C) between rows ``before`` and ``after`` of values (N, C)."""
    rows = np.concatenate([np.arange(before - SIDE + 1, before + 1), np.arange(after, after + SIDE)])
    return _weights(count, order) @ values[np.clip(rows, 0, len(values) - 1)]


def best_order(samples: Samples, rows: np.ndarray, count: int) -> tuple[int, float]:
    """The order that crosses gaps of ``count`` best where the gyro turns as it does at ``rows``, and the rotation, rad rms per axis,
    that it misses."""
    speed = np.concatenate([np.linalg.norm(part, axis=1) for _, part in pieces(samples.gyro)])
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


class Crossings:
    """How well gaps of ``count`` readings are crossed where nothing is missing, in one log, at places that bend as it does beside a gap."""

    def __init__(self, gyro: np.ndarray, count: int, spoilt: np.ndarray):
        """gyro (N, 3); spoilt (N,) bool: rows that are no example."""
        self._gyro, self._count = gyro, count
        places = np.arange(SIDE, max(len(gyro) - count - SIDE + 1, SIDE))
        near = np.concatenate([[0], np.cumsum(spoilt)])
        places = places[near[places + count + SIDE] == near[places - SIDE]]
        places = places[:: max(1, -(-len(places) // MOST_PLACES))]
        bends = bend(gyro, places - 1, places + count)
        order = np.argsort(bends)
        self._places, self._bends = places[order], bends[order]
        self._known: dict[float, tuple[int, np.ndarray]] = {}

    def like(self, bent: float) -> tuple[int, np.ndarray]:
        """The order that crosses best where the rate bends by ``bent``, and the errors (K, count, 3) rad/s of K such crossings."""
        near = float(2 ** (np.round(BEND_STEPS * np.log2(max(bent, 1e-12))) / BEND_STEPS))  # many gaps bend alike
        if near not in self._known:
            self._known[near] = self._tried(near)
        return self._known[near]

    def _tried(self, bent: float) -> tuple[int, np.ndarray]:
        places, factor = self._alike(bent)
        beside = np.concatenate([np.arange(-SIDE, 0), np.arange(self._count, self._count + SIDE)])
        known, true = self._gyro[places[:, None] + beside], self._gyro[places[:, None] + np.arange(self._count)]
        errors = {order: np.einsum("cs,ksi->kci", _weights(self._count, order), known) - true for order in ORDERS}
        order = min(errors, key=lambda each: float(np.mean(errors[each].sum(axis=1) ** 2)))
        return order, factor * errors[order]

    def _alike(self, bent: float) -> tuple[np.ndarray, float]:
        """Places, and by how much more the rate bends than at any of them."""
        first, last = np.searchsorted(self._bends, [AS_FAST * bent, bent / AS_FAST])
        if last - first < FEWEST_TRIALS:  # the nearest in size, then
            middle = int(np.searchsorted(self._bends, bent))
            first = max(0, min(middle - FEWEST_TRIALS // 2, len(self._bends) - FEWEST_TRIALS))
            last = min(len(self._bends), first + FEWEST_TRIALS)
        chosen = slice(first, last, -(-(last - first) // MOST_TRIALS) or 1)
        return self._places[chosen], max(1.0, bent / self._bends[last - 1]) if last > first and self._bends[last - 1] > 0 else 1.0

    def __len__(self) -> int:
        return len(self._places)


def bend(gyro: np.ndarray, before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(K,) rad/s: how much the slope of rates (N, 3) changes, per reading, between the last one before a gap and the first one after."""
    last = len(gyro) - 1
    slope_before = gyro[before] - gyro[np.maximum(before - 1, 0)]
    slope_after = gyro[np.minimum(after + 1, last)] - gyro[after]
    return np.linalg.norm(slope_after - slope_before, axis=-1)


def _weights(count: int, order: int) -> np.ndarray:
    """(count, 2 SIDE): of the neighbours' readings in each reading between, by least squares."""
    at = np.concatenate([np.arange(-SIDE, 0), np.arange(count, count + SIDE)])
    scale = count / 2 + SIDE
    middle = (count - 1) / 2
    known = np.polynomial.legendre.legvander((at - middle) / scale, order)
    return np.polynomial.legendre.legvander((np.arange(count) - middle) / scale, order) @ np.linalg.pinv(known)
