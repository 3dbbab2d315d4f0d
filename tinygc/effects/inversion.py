"""Undo what an effect adds to a rate: repeated substitution, and effects that jump with the rate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tinygc.effects.device import PASSES
from tinygc.effects.movement import Movement, Reach

# The way back from what an effect adds: repeated substitution, rate <- measured - added(rate).
#
# Each pass leaves a share of what was wrong before: the slope of what is added.  Where no row looks at its neighbours, each goes on until
# it stands still, so that a strong effect takes more passes than a weak one.  Where rows look around, all of them take as many passes as
# are declared: so a log in pieces gives what it gives whole, and it is known how far around a row the answer looks.

#: a share of 0.5 is then a billionth; what leaves more in a pass is no error but another sensor
MOST_PASSES = 30
#: of plain substitution, before slopes are learned: a share of 0.03 of 5 dps is then settled, and most effects are weaker
PLAIN_PASSES = 7
#: rad/s: a millionth of any register's step, a tenth of what a log in pieces and a whole one may differ by
SETTLED_RPS = 1e-10
#: steps of one row, one half of the other, that come no nearer
MOST_HALVES = 4
#: of a step, what it must have changed to say something of the slope
TOLD, LEAST_TOLD = 0.05, 1e-28


def substituted(measured: np.ndarray, movement: Movement, added: Callable[[Movement], np.ndarray], passes: int | None = None) -> np.ndarray:
    """The rate (N, 3) rad/s with rate + added(movement with that rate) = measured (N, 3).

    passes: of all rows alike; None: rows are alone, and each goes on until it stands still.  A row that does not, because what is added
    has a slope of 1 or more there, or jumps, is given the rate that came nearest to it.
    """
    if passes is None:
        return _until_settled(measured, movement, added)
    rate = measured
    for _ in range(passes):
        before, rate = rate, measured - added(movement.with_rate(rate))
        if np.abs(rate - before).max(initial=0.0) < SETTLED_RPS:
            break  # what does not follow the rate is there at once
    return rate


def _until_settled(measured: np.ndarray, movement: Movement, added: Callable[[Movement], np.ndarray]) -> np.ndarray:
    """Each row by itself: most stand still after few substitutions, and what does not has its slope learned."""
    rate, settled = measured, np.zeros(len(measured), dtype=bool)
    for _ in range(PLAIN_PASSES):
        missing = measured - added(movement.with_rate(rate)) - rate
        # What is done stays as it is: a row's answer does not hang on how long another takes.  One more substitution costs nothing
        # where it is known already, and takes off what is smaller than ``SETTLED_RPS``, too.
        rate = np.where(settled[:, None], rate, rate + missing)
        settled |= np.abs(missing).max(axis=1, initial=0.0) < SETTLED_RPS
        if settled.all():
            return rate
    rows = np.flatnonzero(~settled)
    rate = rate.copy()
    rate[rows] = _with_slopes(measured, movement, added, rows)
    return rate


def _with_slopes(measured: np.ndarray, movement: Movement, added: Callable[[Movement], np.ndarray], rows: np.ndarray) -> np.ndarray:
    """The rate (K, 3) of rows (K,), with the slope of what is added there learned on the way (Broyden's method).

    A first step is plain substitution; so is one after a step that came no nearer, from where it began, and then half of it.
    """
    rate, aim = measured.copy(), measured[rows]
    here = found = aim
    least, left = np.full(len(rows), np.inf), np.zeros_like(aim)
    since = np.zeros(len(rows), dtype=int)
    inverse, step = np.broadcast_to(np.eye(3), (len(rows), 3, 3)), left
    for _ in range(MOST_PASSES):
        rate[rows] = here
        missing = aim - added(movement.with_rate(rate))[rows] - here
        off = np.abs(missing).max(axis=1, initial=0.0)
        nearer = (off < least) & (least >= SETTLED_RPS) & (since < MOST_HALVES)
        since = np.where(nearer, 0, since + 1)
        if np.isfinite(least).any():
            inverse = np.where(nearer[:, None, None], _learned(inverse, step, left - missing), np.eye(3))
        found, left = np.where(nearer[:, None], here, found), np.where(nearer[:, None], missing, left)
        least = np.where(nearer, off, least)
        # A row is done, or nothing comes nearer: what is added jumps there.
        if not ((least >= SETTLED_RPS) & (since < MOST_HALVES)).any():
            break
        step = np.einsum("nij,nj->ni", inverse, left) * 0.5 ** np.maximum(since - 1, 0)[:, None]
        here = found + step
    return np.where((least < SETTLED_RPS)[:, None], found + left, found)


def _learned(inverse: np.ndarray, step: np.ndarray, answer: np.ndarray) -> np.ndarray:
    """The inverse slopes (N, 3, 3) once steps (N, 3) changed what they are of by ``answer`` (N, 3); as before where that says nothing."""
    expected = np.einsum("nij,nj->ni", inverse, answer)
    along = np.einsum("ni,ni->n", step, expected)
    told = np.abs(along) > np.maximum(TOLD * np.einsum("ni,ni->n", step, step), LEAST_TOLD)
    share = np.divide(1.0, along, out=np.zeros_like(along), where=told)
    backward = np.einsum("ni,nij->nj", step, inverse)
    return inverse + share[:, None, None] * (step - expected)[:, :, None] * backward[:, None, :]


# The way back from an effect that jumps with the rate: at a threshold, at zero, where a sense turns over.
#
# A jump that takes off what it adds makes some readings belong to two rates, one on each side of it; repeated substitution takes either.  A
# rate is smooth: of the two, the one is right that goes on as the rate did before.

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
