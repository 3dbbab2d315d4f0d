"""Inversion of an effect: repeated substitution, and effects that jump with the rate."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from session.base.rotation import identities
from tinygc.effects.device import MOST_PASSES, PASSES
from tinygc.effects.movement import Movement, Reach

# Inversion by repeated substitution, rate <- measured - added(rate).
#
# Each pass multiplies the error by the slope of what is added.  Where no row uses its neighbours, each goes on until
# it converges, so that a strong effect takes more passes than a weak one.  Where rows use their neighbours, all of them take the declared
# number of passes.  A log in pieces then gives the same result as the whole log, and the result has a known reach.

#: passes of plain substitution, before slopes are estimated: a slope of 0.03 of 5 dps has then converged, and most effects are weaker
PLAIN_PASSES = 7
#: rad/s: a millionth of any register's step, a tenth of what a log in pieces and a whole one may differ by
SETTLED_RPS = 1e-10
#: successively halved steps of one row without improvement
MOST_HALVES = 4
#: least relative and absolute change by which a step shows the slope
KNOWN, LEAST_KNOWN = 0.05, 1e-28


def substituted(measured: np.ndarray, movement: Movement, added: Callable[[Movement], np.ndarray], passes: int | None = None) -> np.ndarray:
    """Solve rate + added(movement with that rate) = measured (N, 3) for the rate (N, 3) rad/s.

    passes: number for all rows; None: rows are independent, and each goes on until it converges.  A row that does not converge, because
    what is added has a slope of 1 or more there, or jumps, gets the rate with the smallest error.
    """
    if passes is None:
        return _until_settled(measured, movement, added)
    rate = measured
    for _ in range(passes):
        before, rate = rate, measured - added(movement.with_rate(rate))
        if np.abs(rate - before).max(initial=0.0) < SETTLED_RPS:
            break  # an effect that does not depend on the rate converges at once
    return rate


def _until_settled(measured: np.ndarray, movement: Movement, added: Callable[[Movement], np.ndarray]) -> np.ndarray:
    """Solve each row independently: most converge after few substitutions; for the others the slope is estimated."""
    rate, settled = measured, np.zeros(len(measured), dtype=bool)
    for _ in range(PLAIN_PASSES):
        missing = measured - added(movement.with_rate(rate)) - rate
        # Converged rows stay: a row's result does not depend on how long another takes.  One more substitution costs nothing
        # here, and removes an error smaller than ``SETTLED_RPS``.
        rate = np.where(settled[:, None], rate, rate + missing)
        settled |= np.abs(missing).max(axis=1, initial=0.0) < SETTLED_RPS
        if settled.all():
            return rate
    rows = np.flatnonzero(~settled)
    rate = rate.copy()
    rate[rows] = _with_slopes(measured, movement, added, rows)
    return rate


def _with_slopes(measured: np.ndarray, movement: Movement, added: Callable[[Movement], np.ndarray], rows: np.ndarray) -> np.ndarray:
    """Solve for the rate (K, 3) of rows (K,) by Broyden's method.

    The first step is plain substitution.  After a step without improvement, plain substitution is repeated from where that step began,
    then with half the step.
    """
    rate, aim = measured.copy(), measured[rows]
    here = found = aim
    least, left = np.full(len(rows), np.inf), np.zeros_like(aim)
    since = np.zeros(len(rows), dtype=int)
    inverse, step = identities(len(rows)), left
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
        # A row has converged, or no step improves it: what is added jumps there.
        if not ((least >= SETTLED_RPS) & (since < MOST_HALVES)).any():
            break
        step = np.einsum("nij,nj->ni", inverse, left) * 0.5 ** np.maximum(since - 1, 0)[:, None]
        here = found + step
    return np.where((least < SETTLED_RPS)[:, None], found + left, found)


def _learned(inverse: np.ndarray, step: np.ndarray, answer: np.ndarray) -> np.ndarray:
    """Update the inverse slopes (N, 3, 3) by steps (N, 3) and the changes ``answer`` (N, 3) that they caused, if large enough."""
    expected = np.einsum("nij,nj->ni", inverse, answer)
    along = np.einsum("ni,ni->n", step, expected)
    known = np.abs(along) > np.maximum(KNOWN * np.einsum("ni,ni->n", step, step), LEAST_KNOWN)
    share = np.divide(1.0, along, out=np.zeros_like(along), where=known)
    backward = np.einsum("ni,nij->nj", step, inverse)
    return inverse + share[:, None, None] * (step - expected)[:, :, None] * backward[:, None, :]


# Inversion of an effect that jumps with the rate: at a threshold, at zero, where the sense of rotation reverses.
#
# A downward jump makes some readings belong to two rates, one on each side of it; repeated substitution finds either.  A
# rate is smooth: the right one of the two continues the rate before it.

#: samples in a row that may belong to two rates: a hand passes a threshold within some
JUMPS_REACH = Reach(before_samples=64)
#: rates that differ by less than this share of the effect's maximum are the same
ALIKE = 0.01


def undone_with_jumps(
    measured: np.ndarray, movement: Movement, added: Callable[[Movement], np.ndarray], passes: int = PASSES
) -> np.ndarray:
    """Solve rate + added(movement with that rate) = measured for the rate (N, 3) rad/s; of several, take the one that continues smoothly.

    passes: number of substitutions; a strong effect needs more.
    """

    def without(rate: np.ndarray) -> np.ndarray:
        for _ in range(passes):
            rate = measured - added(movement.with_rate(rate))
        return rate

    plain = without(measured)
    step = np.abs(measured - plain).max(axis=0, initial=0.0)
    # The true rate is at most a step from the measured one, so it is on the side of one of these.
    outward = step * np.where(measured < 0, -1.0, 1.0)
    found = np.stack([plain, without(measured + outward), without(measured - outward)])
    holds = np.stack([np.abs(measured - added(movement.with_rate(rate)) - rate) <= ALIKE * step for rate in found])
    rate = np.where(holds[0], found[0], np.where(holds[1], found[1], np.where(holds[2], found[2], plain)))
    several = (holds & (np.abs(found - rate) > ALIKE * step)).any(axis=0)
    for axis in np.flatnonzero(several.any(axis=0)):
        _go_on(rate[:, axis], np.flatnonzero(several[:, axis]), found[:, :, axis], holds[:, :, axis])
    return rate


def _go_on(rate: np.ndarray, rows: np.ndarray, found: np.ndarray, holds: np.ndarray) -> None:
    """Write into ``rate`` (N,) that of the valid rates (K, N) of an axis which is nearest to a straight line through the rates before."""
    for row in rows:
        before = rate[max(row - 2, 0) : row]
        ahead = 2 * before[-1] - before[0] if len(before) else 0.0
        those = found[holds[:, row], row]
        rate[row] = those[np.argmin(np.abs(those - ahead))]
