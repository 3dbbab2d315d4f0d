"""Overlapping Allan deviation of whatever stillness there is (IEEE 952, annex C).

A session's stillness comes in pieces, a still each, in different attitudes.  The Allan variance is built of second differences of the
angle, which know nothing of a piece's mean; so the pieces are pooled, and no difference reaches over a turn.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: the floor of the Allan deviation is this share of the bias instability: sqrt(2 ln 2 / pi) (IEEE 952, C.1)
FLICKER_FLOOR = 0.6643
#: the angle random walk is read here: beyond the sensor's low-pass filter, and well within a still
READ_S, READ_SAMPLES = 0.2, 20
#: one sigma, as a share, of what still bends the curve there: the low-pass filter holds it down, the bias's own wander lifts it
BENT_SHARE = 0.015
#: a deviation with fewer degrees of freedom says nothing
LEAST_FREEDOM = 5.0
#: the curve's floor is looked for where it is known this well
FLOOR_FREEDOM = 20.0
#: it is a floor, and no longer the white slope, where it is above that slope by so many of its own sigmas, and by this share of itself
LEAVES_SIGMAS, FLOOR_SHARE = 3.0, 0.5


@dataclass(frozen=True, eq=False)
class AllanCurve:
    """tau_s (K,) s; deviation (K, 3) rad/s; freedom (K,) equivalent degrees of freedom of each; longest_s of one piece."""

    tau_s: np.ndarray
    deviation: np.ndarray
    freedom: np.ndarray
    longest_s: float

    @property
    def relative_sigma(self) -> np.ndarray:
        """(K,) one sigma of each deviation, as a share of it."""
        return 1 / np.sqrt(2 * self.freedom)


@dataclass(frozen=True)
class Reading:
    """One coefficient of one axis, SI: value with its sigma where it is observed; else at_most, the k = 2 upper limit, or NaN."""

    value: float
    sigma: float
    observed: bool
    at_most: float = np.nan


def allan_curve(pieces: list[np.ndarray], period_s: float, per_octave: int = 4) -> AllanCurve:
    """Pool pieces of rates (N_i, 3) rad/s, sampled every period_s; K averaging times, ``per_octave`` to an octave.

    Raises ValueError where no piece has four samples.
    """
    angles = [np.vstack([np.zeros(3), np.cumsum(piece, axis=0)]) * period_s for piece in pieces if len(piece) >= 4]
    if not angles:
        raise ValueError("no piece of four samples or more")
    longest = max(map(len, angles)) - 1
    factors = np.unique(np.round(2 ** np.arange(0, np.log2(longest / 2) + 1e-9, 1 / per_octave)).astype(int))
    rows = [_pooled(angles, int(m), period_s) for m in factors]
    rows = [row for row in rows if row[2] >= LEAST_FREEDOM] or rows[:1]
    tau, variance, freedom = (np.array(column) for column in zip(*rows, strict=True))
    return AllanCurve(tau, np.sqrt(variance), freedom, longest * period_s)


def _pooled(angles: list[np.ndarray], m: int, period_s: float) -> tuple[float, np.ndarray, float]:
    """tau, variance (3,) and degrees of freedom at averaging factor m."""
    tau, total, count, freedom = m * period_s, np.zeros(3), 0, 0.0
    for theta in angles:
        if len(theta) <= 2 * m:
            continue
        second = theta[2 * m :] - 2 * theta[m:-m] + theta[: -2 * m]
        total += np.sum(second**2, axis=0)
        count += len(second)
        freedom += _freedom(len(theta), m)
    return tau, total / (2 * tau**2 * max(count, 1)), freedom


def _freedom(points: int, m: int) -> float:
    """Of the overlapping estimate from so many angles, for white rate noise (NIST SP 1065, table 5)."""
    return max((3 * (points - 1) / (2 * m) - 2 * (points - 2) / points) * 4 * m**2 / (4 * m**2 + 5), 1.0)


def angle_random_walk(curve: AllanCurve, axis: int) -> Reading:
    """N, rad/sqrt(s): the deviation times sqrt(tau) where the slope is -1/2."""
    k = _read_at(curve)
    value = float(curve.deviation[k, axis] * np.sqrt(curve.tau_s[k]))
    enough = curve.tau_s[k] >= 0.5 * READ_S and curve.freedom[k] >= LEAST_FREEDOM
    return Reading(value, value * float(np.hypot(curve.relative_sigma[k], BENT_SHARE)), bool(enough and value > 0))


def bias_instability(curve: AllanCurve, axis: int) -> Reading:
    """B, rad/s: the curve's floor less its white part, / 0.664, where it has come to a floor; else an upper limit."""
    walk = angle_random_walk(curve, axis)
    variance, spread = curve.deviation[:, axis] ** 2, np.sqrt(2 / curve.freedom)
    later = curve.tau_s > 2 * curve.tau_s[_read_at(curve)]
    if not later.any():
        return Reading(np.nan, np.nan, False)
    white = walk.value**2 / curve.tau_s
    sigma = np.hypot(spread * variance, 2 * walk.sigma * walk.value / curve.tau_s)
    excess = variance - white
    lowest = int(np.argmin(np.where(later & (curve.freedom >= FLOOR_FREEDOM), variance, np.inf)))
    if later[lowest] and excess[lowest] > max(LEAVES_SIGMAS * sigma[lowest], FLOOR_SHARE * variance[lowest]):
        value = float(np.sqrt(excess[lowest])) / FLICKER_FLOOR
        return Reading(value, value * float(sigma[lowest] / excess[lowest]) / 2, True)
    at_most = np.sqrt(np.min((np.maximum(excess, 0) + 2 * sigma)[later])) / FLICKER_FLOOR
    return Reading(np.nan, np.nan, False, float(at_most))


def _read_at(curve: AllanCurve) -> int:
    """Index of the averaging time at which the random walk is read: the nearest there is."""
    sample_s = curve.tau_s[0]
    wanted = max(READ_S, READ_SAMPLES * sample_s)
    return int(np.argmin(np.abs(np.log(curve.tau_s / wanted))))
