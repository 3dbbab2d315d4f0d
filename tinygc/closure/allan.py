"""Overlapping Allan deviation of whatever stillness there is (IEEE 952, annex C).

A session's stillness comes in pieces, a still each, in different attitudes.  The Allan variance is built of second differences of the
angle, which know nothing of a piece's mean; so the pieces are pooled, and no difference reaches over a turn.  Sums of pieces may be kept
(``AllanSums``) where there are too many to hold, and curves at short and at long times put together.
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
    pieces = [piece for piece in pieces if len(piece) >= 4]
    if not pieces:
        raise ValueError("no piece of four samples or more")
    longest = max(map(len, pieces))
    return curve_of([AllanSums.of(piece, averaging_factors(longest, per_octave)) for piece in pieces], period_s, longest * period_s)


def averaging_factors(samples: int, per_octave: int) -> tuple[int, ...]:
    """Numbers of samples to average, up to half of so many."""
    return tuple(np.unique(np.round(2 ** np.arange(0, np.log2(samples / 2) + 1e-9, 1 / per_octave)).astype(int)).tolist())


@dataclass(frozen=True, eq=False)
class AllanSums:
    """What a piece adds: factors (K,); total (K, 3) of squared second differences of the summed rate; count, freedom (K,)."""

    factors: tuple[int, ...]
    total: np.ndarray
    count: np.ndarray
    freedom: np.ndarray

    @classmethod
    def of(cls, piece: np.ndarray, factors: tuple[int, ...]) -> AllanSums:
        """Of rates (N, 3)."""
        theta = np.vstack([np.zeros(3), np.cumsum(piece - piece.mean(axis=0), axis=0)])
        total, count, freedom = np.zeros((len(factors), 3)), np.zeros(len(factors)), np.zeros(len(factors))
        for k, m in enumerate(factors):
            if len(theta) <= 2 * m:
                continue
            second = theta[2 * m :] - 2 * theta[m:-m] + theta[: -2 * m]
            total[k], count[k], freedom[k] = np.einsum("ij,ij->j", second, second), len(second), _freedom(len(theta), m)
        return cls(factors, total, count, freedom)


def curve_of(pieces: list[AllanSums], period_s: float, longest_s: float) -> AllanCurve:
    """Pieces' sums, of the same factors, pooled; times that are hardly known are left out."""
    total, count, freedom = (sum(getattr(piece, name) for piece in pieces) for name in ("total", "count", "freedom"))
    variance = total / (2 * np.square(pieces[0].factors) * np.maximum(count, 1))[:, None]
    known = freedom >= LEAST_FREEDOM
    known[0] |= not known.any()
    return AllanCurve(np.multiply(pieces[0].factors, period_s)[known], np.sqrt(variance[known]), freedom[known], longest_s)


def joined_curves(short: AllanCurve, long: AllanCurve) -> AllanCurve:
    """One curve: the short times of the one, then what the other has beyond them."""
    later = long.tau_s > short.tau_s[-1]
    tau_s, deviation, freedom = (
        np.concatenate([getattr(short, name), getattr(long, name)[later]]) for name in ("tau_s", "deviation", "freedom")
    )
    return AllanCurve(tau_s, deviation, freedom, max(short.longest_s, long.longest_s))


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
