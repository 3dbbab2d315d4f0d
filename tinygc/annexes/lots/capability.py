"""Capability of a lot against limits (Cp, Cpk, Pp, Ppk), and control charts by production order."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.special import bdtrc, gammaincinv, ndtr, ndtri, pdtrc, stdtr

from session.io.errors import FormatError
from session.io.requirements import bounds_of
from session.io.results import Mismatch, require_schema
from session.io.toml import read_toml
from tinygc.annexes.lots.lot import SENSOR_ERRORS
from tinygc.estimation.requirements import quantile

# Limits of a lot's numbers, from the user's TOML file: lower and upper, in the displayed units (docs/lots.md).

SCHEMA = "tinygc-limits/1"
#: a section may name all components of one kind: ``gyro_bias_mdps``
KEYS = tuple(each.key for each in SENSOR_ERRORS)
KINDS = {each.key: f"{each.sensor} {each.word} {each.unit}".replace(" ", "_") for each in SENSOR_ERRORS}
GROUPS = {kind: tuple(key for key in KEYS if KINDS[key] == kind) for kind in dict.fromkeys(KINDS.values())}


def read_limits(path: Path | str) -> dict[str, tuple[float, float]]:
    """Return (lower, upper) of each number that has limits, by its key; infinite where only one side is given.

    Raises FormatError, in one line, for an unknown key, a limit that is no number, and a lower one that is not below the upper.
    """
    table = read_toml(Path(path))
    require_schema(table, SCHEMA, str(path), "write it at the top (docs/lots.md)")
    sections = {name: value for name, value in table.items() if name != "schema"}
    try:
        found = bounds_of(sections, GROUPS, KEYS, "docs/lots.md")
    except Mismatch as mismatch:
        raise FormatError(f"{path}: {mismatch}") from None
    if not found:
        raise FormatError(f"{path}: no limits, expected a section such as [gyro_bias_mdps] with lower and upper (docs/lots.md)")
    return found


# Capability of a lot against limits: Cp, Cpk within, Pp, Ppk overall, parts per million outside, and the effect of measurement noise.
#
#     Cp = (upper - lower) / 6 sigma_within      Cpk = min(upper - mean, mean - lower) / 3 sigma_within
#     Pp, Ppk: the same with sigma_overall
#
# Within is the short-term sigma of the control chart, overall the lot's spread. Both are given as observed, with measurement noise, and
# with the noise removed, which describes the sensors. Source: AIAG, Statistical Process Control, 2nd edition; interval of Cpk: A. F.
# Bissell, Applied Statistics 39, 1990; guard band: ISO 14253-1.

CONFIDENCE = 0.95
#: probability that a unit at its limit is accepted by a reading within the guarded limits: ISO 14253-1's one-sided 95 %
GUARD_SIGMAS = quantile(0.95)


@dataclass(frozen=True)
class Indices:
    """Spread index (Cp or Pp) and the index that includes the mean (Cpk or Ppk), with their intervals; NaN with one limit only."""

    index: float
    index_interval: tuple[float, float]
    centred: float
    centred_interval: tuple[float, float]


@dataclass(frozen=True)
class Capability:
    """Capability of one number against its limits, all in its unit.

    lower, upper: -inf or inf where there is none; mean; sigma: overall, without measurement noise, and observed_sigma with it; within and
    overall, their indices without noise; observed, the overall ones with it; ppm_normal, ppm_tails: outside, by a normal distribution and
    by the lot's tails; found_outside: number of units with a reading outside; false_accept_ppm, units outside that a reading accepts;
    false_reject_ppm, the reverse; guard_band: tightening of the limits with which a unit at its limit is accepted at most once in twenty,
    and the false accepts and rejects with it.
    """

    lower: float
    upper: float
    mean: float
    sigma: float
    observed_sigma: float
    within: Indices
    overall: Indices
    observed: Indices
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
    """Compute the indices for a sigma with these degrees of freedom, and a mean of this many units."""
    nan = (float("nan"), float("nan"))
    if not sigma > 0:
        return Indices(float("nan"), nan, float("nan"), nan)
    both = np.isfinite(lower) and np.isfinite(upper)
    index = (upper - lower) / (6 * sigma) if both else float("nan")
    centred = min(upper - mean, mean - lower) / (3 * sigma)
    freedom = max(freedom, 1.0)
    ends = np.sqrt(2 * gammaincinv(freedom / 2, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2]) / freedom)
    half = ndtri((1 + CONFIDENCE) / 2) * np.sqrt(1 / (9 * units) + centred**2 / (2 * freedom))
    of_index = (float(index * ends[0]), float(index * ends[1])) if both else nan
    return Indices(float(index), of_index, float(centred), (float(centred - half), float(centred + half)))


def outside_ppm(lower: float, upper: float, mean: float, sigma: float, tails: float = np.inf) -> float:
    """Return the parts per million beyond the limits, for a normal distribution or Student's t with that sigma."""
    if not sigma > 0:
        return 1e6 * float(not lower <= mean <= upper)
    scale = sigma * np.sqrt((tails - 2) / tails) if np.isfinite(tails) else sigma
    below, above = (lower - mean) / scale, (mean - upper) / scale
    return float(1e6 * (stdtr(tails, below) + stdtr(tails, above) if np.isfinite(tails) else ndtr(below) + ndtr(above)))


def risks(lower: float, upper: float, mean: float, sigma: float, noise: float, guard: float = 0.0) -> tuple[float, float]:
    """Return ppm of units outside that are accepted by a reading within the limits less the guard, and of units inside that are
    rejected."""
    if not (sigma > 0 and noise > 0):
        return 0.0, 0.0
    # quadrature nodes over the units, as fine as the noise near a limit
    edges = [edge + noise * np.linspace(-7, 7, 801) for edge in (lower, upper) if np.isfinite(edge)]
    x = np.unique(np.concatenate([mean + sigma * np.linspace(-9, 9, 2001), *edges]))
    middle, width = (x[1:] + x[:-1]) / 2, np.diff(x)
    density = np.exp(-(((middle - mean) / sigma) ** 2) / 2) / np.sqrt(2 * np.pi) / sigma * width
    accepted = ndtr((upper - guard - middle) / noise) - ndtr((lower + guard - middle) / noise)
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
    """Compute the capability of one number.

    mean and sigma of the lot without noise; noise of a session, one sigma, with its repeatability; within: the short-term sigma without
    noise; freedom of sigma; readings (U,) of the units, NaN where unknown.
    """
    lower, upper = limits
    units = int(np.isfinite(readings).sum())
    observed_sigma = float(np.hypot(sigma, noise))
    guard = GUARD_SIGMAS * noise
    accept, reject = risks(lower, upper, mean, sigma, noise)
    guarded_accept, guarded_reject = risks(lower, upper, mean, sigma, noise, guard)
    return Capability(
        lower,
        upper,
        mean,
        sigma,
        observed_sigma,
        indices(lower, upper, mean, within, 0.6 * (units - 1), units),
        indices(lower, upper, mean, sigma, freedom, units),
        indices(lower, upper, mean, observed_sigma, units - 1, units),
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


# Control charts of one number by production order: individuals and moving range, EWMA, and the run rules.
#
# Every point has its own limits, since each session has its own measurement noise: the process's short-term variance, from moving ranges,
# less the mean noise, plus the point's own. Points are converted to normal scores, with the lot's tails, so that one rule fits all. A rule
# applied to every point of 21 charts is sure to trigger in a long lot. So the limits for a single point are family-wise over the whole lot
# (one false alarm in a hundred lots), and the counts of the classical rules are compared with their expectation by chance.
#
# Source: Western Electric, Statistical Quality Control Handbook, 1956; L. S. Nelson, J. Quality Technology 16(4), 1984; J. M. Lucas,
# M. S. Saccucci, Technometrics 32(1), 1990.

#: one false alarm of all charts together in this many lots
FAMILY_P = 0.01
#: mean distance of two normal draws, in sigmas
D2 = 2 / np.sqrt(np.pi)
#: weight of the newest point in the moving average: detects steps of a half to one sigma soonest, of those that a lot's limits can detect
EWMA_WEIGHT = 0.05
#: number of independent points, for each point and weight, as likely to leave the limits as the moving average is
EWMA_POINTS = 4.0
#: degrees of freedom, for each point, of a sigma from moving ranges: of their median, and of their mean (simulated, benchmarks/lot.py)
MEDIAN_FREEDOM, MEAN_FREEDOM = 0.31, 0.63
#: limit of a score in the moving average
WILD = 3.0
#: chance of each rule at a point in control, for independent normal points
RULES = {
    "beyond 3 sigma": float(2 * ndtr(-3)),
    "2 of 3 beyond 2 sigma": float(2 * bdtrc(1, 3, ndtr(-2))),
    "4 of 5 beyond 1 sigma": float(2 * bdtrc(3, 5, ndtr(-1))),
    "9 on one side": 2 * 0.5**9,
}
#: significance of a rule's count, over all rules and charts
COUNT_P = 0.01


@dataclass(frozen=True, eq=False)
class ControlChart:
    """Control charts of one number, in its unit.

    place (N,) in production, y (N,), sigma (N,) short-term and the point's own noise; centre; short_term: one sigma of the process without
    measurement noise; moving_range (N,), first NaN; range_limit; score (N,); ewma (N,) of scores and its limit; limit: of a score, over all
    charts; alarms and ewma_alarms: numbers of points; counts and chance: of each rule, observed and expected; broken: rules that trigger
    significantly more often than by chance.
    """

    place: np.ndarray
    y: np.ndarray
    sigma: np.ndarray
    centre: float
    short_term: float
    moving_range: np.ndarray
    range_limit: float
    score: np.ndarray
    ewma: np.ndarray
    ewma_limit: float
    limit: float
    alarms: np.ndarray
    ewma_alarms: np.ndarray
    counts: dict[str, int]
    chance: dict[str, float]
    broken: tuple[str, ...]


def chart(y: np.ndarray, noise: np.ndarray, tails: float = np.inf, charts: int = 1, place: np.ndarray | None = None) -> ControlChart:
    """Chart points y (N,) in production order, one for each unit, with one sigma of noise each (N,).

    tails: degrees of freedom of the units' distribution; charts: number of charts of the lot; place (N,): production index of the unit,
    from 0.

    Raises ValueError for fewer than 3 points.
    """
    n = len(y)
    if n < 3:
        raise ValueError(f"a control chart needs 3 points, got {n}")
    centre = float(np.median(y)) if n > 20 else float(np.mean(y))
    moving = np.concatenate([[np.nan], np.abs(np.diff(y))])
    # The mean moving range is not robust: an outlier enters it twice. The median of normal ranges is 0.954 sigma.
    whole = float(np.nanmedian(moving)) / (np.sqrt(2) * ndtri(0.75)) if n > 20 else float(np.nanmean(moving)) / D2
    short = float(np.sqrt(max(whole**2 - np.mean(noise**2), 0.0)))
    sigma = np.sqrt(short**2 + noise**2)
    # the scores' distribution includes the uncertainty of sigma
    known = (MEDIAN_FREEDOM if n > 20 else MEAN_FREEDOM) * (n - 1)
    score = _scores((y - centre) / np.maximum(sigma, 1e-300), 1 / (1 / tails + 1 / known) if np.isfinite(tails) else known, tails)
    limit = float(-ndtri(FAMILY_P / 2 / (n * charts) / 2))
    ewma, ewma_limit = _ewma(score, charts)
    counts = {name: int(hits.sum()) for name, hits in rule_violations(score).items()}
    chance = {name: rate * n for name, rate in RULES.items()}
    seldom = COUNT_P / (len(RULES) * charts)
    # hits of a rule come in runs; a run of up to this length counts as one draw
    runs = {"beyond 3 sigma": 1, "2 of 3 beyond 2 sigma": 2, "4 of 5 beyond 1 sigma": 5, "9 on one side": 5}
    often = [name for name in RULES if counts[name]]
    broken = tuple(name for name in often if pdtrc((counts[name] - 1) // runs[name], chance[name] / runs[name]) < seldom)
    return ControlChart(
        np.arange(n) if place is None else place,
        y,
        sigma,
        centre,
        short,
        moving,
        float(3.267 * D2 * whole),
        score,
        ewma,
        ewma_limit,
        limit,
        np.flatnonzero(np.abs(score) > limit),
        np.flatnonzero(np.abs(ewma) > ewma_limit),
        counts,
        chance,
        broken,
    )


def _scores(z: np.ndarray, freedom: float, tails: float) -> np.ndarray:
    """Return normal scores of Student's t; tails: of the lot, whose variance has scaled z."""
    t = np.abs(z) * (np.sqrt(tails / (tails - 2)) if np.isfinite(tails) else 1.0)
    return np.sign(z) * -ndtri(np.maximum(stdtr(freedom, -t), 1e-300))


def _ewma(score: np.ndarray, charts: int) -> tuple[np.ndarray, float]:
    """Return the moving average at each point, in sigmas of its own, and its limit over all points of all charts."""
    from scipy.signal import lfilter

    w = EWMA_WEIGHT
    # An outlier is no drift: it has its own rule, and is clipped here.
    found = lfilter([w], [1, w - 1], np.clip(score, -WILD, WILD))
    own = np.sqrt(w / (2 - w) * (1 - (1 - w) ** (2 * np.arange(1, len(score) + 1))))
    independent = max(len(score) * w * EWMA_POINTS, 1.0) * charts
    return found / own, float(-ndtri(FAMILY_P / 2 / independent / 2))


def rule_violations(score: np.ndarray) -> dict[str, np.ndarray]:
    """Return (N,) bool for each rule: whether it triggers at a point."""

    def of(span: int, least: int, beyond: float) -> np.ndarray:
        hits = np.zeros(len(score), dtype=bool)
        for side in (score, -score):
            far = np.concatenate([np.zeros(span - 1), side > beyond])
            hits |= np.convolve(far, np.ones(span), "valid") >= least - 0.5
        return hits

    return {
        "beyond 3 sigma": of(1, 1, 3.0),
        "2 of 3 beyond 2 sigma": of(3, 2, 2.0),
        "4 of 5 beyond 1 sigma": of(5, 4, 1.0),
        "9 on one side": of(9, 9, 0.0),
    }
