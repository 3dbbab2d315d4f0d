"""Capability of a lot against limits: Cp, Cpk within, Pp, Ppk overall, parts per million outside, and what measurement noise does to them.

    Cp = (upper - lower) / 6 sigma_within      Cpk = min(upper - mean, mean - lower) / 3 sigma_within
    Pp, Ppk: the same with sigma_overall

Within is the short-term sigma of the control chart, overall the lot's spread.  Both are given as seen, with measurement noise, and with
it taken out, which is what the sensors do.  Source: AIAG, Statistical Process Control, 2nd edition; interval of Cpk: A. F. Bissell,
Applied Statistics 39, 1990; guard band: ISO 14253-1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

CONFIDENCE = 0.95
#: of a unit at its limit that is accepted by a reading within the guarded limits: ISO 14253-1's one-sided 95 %
GUARD_SIGMAS = float(stats.norm.ppf(0.95))


@dataclass(frozen=True)
class Indices:
    """spread index (Cp or Pp) and the one that looks where the mean is (Cpk or Ppk), with their intervals; NaN with one limit only."""

    index: float
    index_interval: tuple[float, float]
    centred: float
    centred_interval: tuple[float, float]


@dataclass(frozen=True)
class Capability:
    """One number against its limits, all in its unit.

    lower, upper: -inf or inf where there is none; mean; sigma: overall, without measurement noise, and seen_sigma with it; within and
    overall, their indices without noise; seen, the overall ones with it; ppm_normal and ppm_tails: outside, by a normal distribution and
    by the lot's tails; found_outside: of how many units the reading is; false_accept_ppm, units outside that a reading accepts;
    false_reject_ppm, the reverse; guard_band: by how much limits must be drawn in for a unit at its limit to be accepted at most once in
    twenty, and what is falsely accepted and rejected then.
    """

    lower: float
    upper: float
    mean: float
    sigma: float
    seen_sigma: float
    within: Indices
    overall: Indices
    seen: Indices
    ppm_normal: float
    ppm_tails: float
    found_outside: int
    units: int
    false_accept_ppm: float
    false_reject_ppm: float
    guard_band: float
    guarded_accept_ppm: float
    guarded_reject_ppm: float


def indices(lower: float, upper: float, mean: float, sigma: float, freedom: float, units: int) -> Indices:
    """Of a sigma that is known with so many degrees of freedom, and a mean of so many units."""
    nan = (float("nan"), float("nan"))
    if not sigma > 0:
        return Indices(float("nan"), nan, float("nan"), nan)
    both = np.isfinite(lower) and np.isfinite(upper)
    index = (upper - lower) / (6 * sigma) if both else float("nan")
    centred = min(upper - mean, mean - lower) / (3 * sigma)
    freedom = max(freedom, 1.0)
    ends = np.sqrt(stats.chi2.ppf([(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2], freedom) / freedom)
    half = stats.norm.ppf((1 + CONFIDENCE) / 2) * np.sqrt(1 / (9 * units) + centred**2 / (2 * freedom))
    of_index = (float(index * ends[0]), float(index * ends[1])) if both else nan
    return Indices(float(index), of_index, float(centred), (float(centred - half), float(centred + half)))


def outside_ppm(lower: float, upper: float, mean: float, sigma: float, tails: float = np.inf) -> float:
    """Parts per million beyond the limits, of a normal distribution or of Student's t with that sigma."""
    if not sigma > 0:
        return 1e6 * float(not lower <= mean <= upper)
    scale = sigma * np.sqrt((tails - 2) / tails) if np.isfinite(tails) else sigma
    of = stats.t(tails) if np.isfinite(tails) else stats.norm()
    return float(1e6 * (of.cdf((lower - mean) / scale) + of.sf((upper - mean) / scale)))


def risks(lower: float, upper: float, mean: float, sigma: float, noise: float, guard: float = 0.0) -> tuple[float, float]:
    """ppm: units outside that are accepted by a reading within the limits less the guard; units inside that are rejected."""
    if not (sigma > 0 and noise > 0):
        return 0.0, 0.0
    # Nodes over the units, as fine as the noise where a limit is near.
    edges = [edge + noise * np.linspace(-7, 7, 801) for edge in (lower, upper) if np.isfinite(edge)]
    x = np.unique(np.concatenate([mean + sigma * np.linspace(-9, 9, 2001), *edges]))
    middle, width = (x[1:] + x[:-1]) / 2, np.diff(x)
    density = stats.norm.pdf(middle, mean, sigma) * width
    accepted = stats.norm.cdf((upper - guard - middle) / noise) - stats.norm.cdf((lower + guard - middle) / noise)
    accepted = np.clip(accepted, 0, 1)
    inside = (middle >= lower) & (middle <= upper)
    return float(1e6 * np.sum(density[~inside] * accepted[~inside])), float(1e6 * np.sum(density[inside] * (1 - accepted[inside])))


def capability(
    limits: tuple[float, float],
    mean: float,
    sigma: float,
    noise: float,
    within: float,
    freedom: float,
    tails: float,
    readings: np.ndarray,
) -> Capability:
    """Of one number: mean and sigma of the lot without noise; noise of a session, one sigma, with what does not repeat; within: the
    short-term sigma without noise; freedom of sigma; readings (U,) of the units, NaN where not told."""
    lower, upper = limits
    units = int(np.isfinite(readings).sum())
    seen_sigma = float(np.hypot(sigma, noise))
    guard = GUARD_SIGMAS * noise
    accept, reject = risks(lower, upper, mean, sigma, noise)
    guarded_accept, guarded_reject = risks(lower, upper, mean, sigma, noise, guard)
    return Capability(
        lower,
        upper,
        mean,
        sigma,
        seen_sigma,
        indices(lower, upper, mean, within, max(0.6 * (units - 1), 1), units),
        indices(lower, upper, mean, sigma, freedom, units),
        indices(lower, upper, mean, seen_sigma, max(units - 1, 1), units),
        outside_ppm(lower, upper, mean, sigma),
        outside_ppm(lower, upper, mean, sigma, tails),
        int(np.sum((readings < lower) | (readings > upper))),
        units,
        accept,
        reject,
        guard,
        guarded_accept,
        guarded_reject,
    )
