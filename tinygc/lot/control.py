"""Control charts of one number by production order: individuals and moving range, EWMA, and the rules that say that chance ends here.

Every point has its own limits, since each session knows its own measurement noise: the process's short-term variance, from moving ranges,
less the mean noise, plus the point's own.  Points are turned into normal scores, with the lot's tails, so that one rule fits all.
A rule that looks at every point of 21 charts is sure to ring in a long lot.  So the limits for a single point are those of the whole lot
(one false alarm in a hundred lots), and of the classical rules the count is held against what chance gives.

Source: Western Electric, Statistical Quality Control Handbook, 1956; L. S. Nelson, J. Quality Technology 16(4), 1984; J. M. Lucas,
M. S. Saccucci, Technometrics 32(1), 1990.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal, stats

#: false alarms of all charts of a lot together, by chance, in so many lots
FAMILY_P = 0.01
#: of two normal draws, their mean distance in sigmas
D2 = 2 / np.sqrt(np.pi)
#: of the newest point in the moving average: what finds steps of a half to one sigma soonest, of those that limits of a lot can find
EWMA_WEIGHT = 0.05
#: points of the moving average that are as likely to leave its limits as an independent one, for each point and weight
EWMA_POINTS = 4.0
#: degrees of freedom of a sigma from moving ranges, for each point: of their median, and of their mean (simulated, benchmarks/lot.py)
MEDIAN_FREEDOM, MEAN_FREEDOM = 0.31, 0.63
#: score beyond which a point says no more of a drift
WILD = 3.0
#: chance of each rule at a point in control, of independent normal points
RULES = {
    "beyond 3 sigma": float(2 * stats.norm.sf(3)),
    "2 of 3 beyond 2 sigma": float(2 * stats.binom.sf(1, 3, stats.norm.sf(2))),
    "4 of 5 beyond 1 sigma": float(2 * stats.binom.sf(3, 5, stats.norm.sf(1))),
    "9 on one side": 2 * 0.5**9,
}
#: a count above what chance gives this seldom is said, over all rules and charts
COUNT_P = 0.01


@dataclass(frozen=True, eq=False)
class Chart:
    """One number's charts, in its unit.

    place (N,) in production, y (N,), sigma (N,) short-term and the point's own noise; centre; short_term: one sigma of the process without
    measurement noise; moving_range (N,), first NaN; range_limit; score (N,); ewma (N,) of scores and its limit; limit: of a score, over
    all charts; alarms and ewma_alarms: numbers of points; counts and chance: of each rule, found and by chance; broken: rules that
    ring more often than chance.
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


def chart(y: np.ndarray, noise: np.ndarray, tails: float = np.inf, charts: int = 1, place: np.ndarray | None = None) -> Chart:
    """Of points y (N,) in production order with one sigma of noise each (N,), a unit each; tails: degrees of freedom of the units'
    distribution; charts: how many the lot has in all; place (N,): which unit made, from 0.

    Raises ValueError for fewer than 3 points.
    """
    n = len(y)
    if n < 3:
        raise ValueError(f"a control chart needs 3 points, got {n}")
    centre = float(np.median(y)) if n > 20 else float(np.mean(y))
    moving = np.concatenate([[np.nan], np.abs(np.diff(y))])
    # The mean moving range is not robust: a wild point enters it twice.  The median of normal ranges is 0.954 sigma.
    whole = float(np.nanmedian(moving)) / (np.sqrt(2) * stats.norm.ppf(0.75)) if n > 20 else float(np.nanmean(moving)) / D2
    short = float(np.sqrt(max(whole**2 - np.mean(noise**2), 0.0)))
    sigma = np.sqrt(short**2 + noise**2)
    # Sigma itself is known from so many degrees of freedom, which tails have to count as well.
    known = (MEDIAN_FREEDOM if n > 20 else MEAN_FREEDOM) * (n - 1)
    score = _scores((y - centre) / np.maximum(sigma, 1e-300), 1 / (1 / tails + 1 / known) if np.isfinite(tails) else known, tails)
    limit = float(stats.norm.isf(FAMILY_P / 2 / (n * charts) / 2))
    ewma, ewma_limit = _ewma(score, charts)
    counts = {name: int(hits.sum()) for name, hits in _rung(score).items()}
    chance = {name: rate * n for name, rate in RULES.items()}
    seldom = COUNT_P / (len(RULES) * charts)
    # Hits of a rule come in runs: a run of up to so many counts as one draw of chance.
    runs = {"beyond 3 sigma": 1, "2 of 3 beyond 2 sigma": 2, "4 of 5 beyond 1 sigma": 5, "9 on one side": 5}
    broken = tuple(name for name in RULES if stats.poisson.sf((counts[name] - 1) // runs[name], chance[name] / runs[name]) < seldom)
    return Chart(
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
    """Normal scores of Student's t; tails: of the lot, by whose variance z was scaled."""
    t = np.abs(z) * (np.sqrt(tails / (tails - 2)) if np.isfinite(tails) else 1.0)
    return np.sign(z) * stats.norm.isf(np.maximum(stats.t.sf(t, freedom), 1e-300))


def _ewma(score: np.ndarray, charts: int) -> tuple[np.ndarray, float]:
    """In sigmas of its own at each point, and the limit over all points of all charts."""
    w = EWMA_WEIGHT
    # One wild point is no drift: it has a rule of its own, and counts here as what is still of this process.
    found = signal.lfilter([w], [1, w - 1], np.clip(score, -WILD, WILD))
    own = np.sqrt(w / (2 - w) * (1 - (1 - w) ** (2 * np.arange(1, len(score) + 1))))
    independent = max(len(score) * w * EWMA_POINTS, 1.0) * charts
    return found / own, float(stats.norm.isf(FAMILY_P / 2 / independent / 2))


def _rung(score: np.ndarray) -> dict[str, np.ndarray]:
    """(N,) bool of each rule: whether it rings at a point."""

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
