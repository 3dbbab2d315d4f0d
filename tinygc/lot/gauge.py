"""Repeatability and reproducibility of a lot's sessions, in the terms of measurement-system analysis: %GRR, ndc.

The parts are units, the trials are sessions, the appraisers are who turned them: operators, or stations where only these are named.
EV equipment variation (repeatability), AV appraiser variation (reproducibility, the interaction in it), GRR both together, PV part
variation, TV total variation; all one sigma.  ndc = 1.41 PV / GRR.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.lot.anova import Anova, anova, components, drawn
from tinygc.lot.variances import cells_of, variances

#: distinct categories per PV / GRR, AIAG
NDC = 1.41
#: sigmas of a study's width and of a tolerance's, AIAG's fourth edition
WIDTH = 6.0
#: of an interval
CONFIDENCE = 0.95
#: sessions that the likelihood looks at, those of units with several before others
MOST_SESSIONS = 4000
#: AIAG's limits: below the first acceptable, from the second on not
ACCEPTABLE, MARGINAL = 10.0, 30.0
_DRAWS = 4000


@dataclass(frozen=True, eq=False)
class Gauge:
    """One number's study.  ev, av, interaction (part of av), grr, pv, tv: one sigma each in the number's unit, NaN where sessions cannot
    tell; percent_grr of tv and percent_tolerance, of the limits' distance, %; ndc, not cut to a whole number; ``*_interval``: from, to, at
    95 %.  method: ``anova`` or ``likelihood``; table: the analysis of variance; appraisers: what they are, or empty; parts, sessions:
    how many; why: what could not be told, and why.
    """

    ev: float
    av: float
    interaction: float
    grr: float
    pv: float
    tv: float
    percent_grr: float
    percent_tolerance: float
    ndc: float
    percent_grr_interval: tuple[float, float]
    ndc_interval: tuple[float, float]
    method: str
    table: Anova | None
    appraisers: str
    parts: int
    sessions: int
    why: str

    @property
    def verdict(self) -> str:
        """AIAG's words for %GRR."""
        if not np.isfinite(self.percent_grr):
            return "not told"
        return "acceptable" if self.percent_grr < ACCEPTABLE else "marginal" if self.percent_grr <= MARGINAL else "not acceptable"


def gauge(
    y: np.ndarray, part: np.ndarray, appraiser: np.ndarray | None, tolerance: float = float("nan"), what: str = "operator", seed: int = 0
) -> Gauge:
    """Of sessions y (S,), numbers of their units (S,), and of their appraisers (S,) or None; tolerance: upper less lower limit, or NaN."""
    fine = np.isfinite(y)
    y, part = y[fine], part[fine]
    who = np.zeros(len(y), dtype=int) if appraiser is None else appraiser[fine]
    several = len(np.unique(who)) > 1
    why = "" if several else "one operator or none is named: reproducibility is not told, and GRR is repeatability alone"
    study = _crossed(y, part, who)
    names, of = np.unique(part, return_inverse=True)
    if len(names) < 2 or (np.bincount(of) < 2).all():
        return _nothing(len(names), len(y), "no unit has two sessions: repeatability is not told")
    if study is not None and (study.shape[1] > 1 or study.shape[2] > 1):
        table = anova(study)
        found, draws = components(table), drawn(table, seed)
        method = "anova"
    else:
        keep = _looked_at(of, seed)
        cells = cells_of(y[keep], of[keep], who[keep])
        found, covariance = variances(cells)
        table, method = None, "likelihood"
        rng = np.random.default_rng(seed)
        steps = rng.multivariate_normal(np.zeros(4), np.nan_to_num(covariance), size=_DRAWS, method="eigh")
        draws = np.nan_to_num(found) * np.exp(np.clip(steps, -20, 20))
    return _in_words(found, draws, tolerance, method, table, what if several else "", len(names), len(y), why)


def _nothing(parts: int, sessions: int, why: str) -> Gauge:
    nan = float("nan")
    return Gauge(nan, nan, nan, nan, nan, nan, nan, nan, nan, (nan, nan), (nan, nan), "none", None, "", parts, sessions, why)


def _crossed(y: np.ndarray, part: np.ndarray, who: np.ndarray) -> np.ndarray | None:
    """(parts, appraisers, trials) where every appraiser has measured every part as often, else None."""
    parts, p = np.unique(part, return_inverse=True)
    people, w = np.unique(who, return_inverse=True)
    cell = p * len(people) + w
    count = np.bincount(cell, minlength=len(parts) * len(people))
    if count.min() != count.max() or count.max() == 0:
        return None
    return y[np.argsort(cell, kind="stable")].reshape(len(parts), len(people), count.max())


def _looked_at(of: np.ndarray, seed: int) -> np.ndarray:
    """Numbers of sessions, whole units at a time, those with several sessions first."""
    if len(of) <= MOST_SESSIONS:
        return np.arange(len(of))
    count = np.bincount(of)
    rank = np.random.default_rng(seed).permutation(len(count)) + np.where(count > 1, 0, len(count))
    order = np.argsort(rank)
    enough = order[np.cumsum(count[order]) <= MOST_SESSIONS]
    return np.flatnonzero(np.isin(of, enough))


def _in_words(
    found: np.ndarray,
    draws: np.ndarray,
    tolerance: float,
    method: str,
    table: Anova | None,
    what: str,
    parts: int,
    sessions: int,
    why: str,
) -> Gauge:
    part, who, both, again = np.sqrt(np.nan_to_num(found))
    av = float(np.hypot(who, both)) if what else float("nan")
    grr, pv = float(np.sqrt(who**2 + both**2 + again**2)), float(part)
    tv = float(np.hypot(grr, pv))
    spread = np.sum(draws[:, 1:], axis=1)
    shares = 100 * np.sqrt(spread / np.maximum(spread + draws[:, 0], 1e-300))
    categories = NDC * np.sqrt(draws[:, 0] / np.maximum(spread, 1e-300))
    return Gauge(
        float(again),
        av,
        float(both) if what else float("nan"),
        grr,
        pv,
        tv,
        100 * grr / tv if tv else float("nan"),
        100 * WIDTH * grr / tolerance if np.isfinite(tolerance) else float("nan"),
        NDC * pv / grr if grr else float("inf"),
        _ends(shares),
        _ends(categories),
        method,
        table,
        what,
        parts,
        sessions,
        why,
    )


def _ends(draws: np.ndarray) -> tuple[float, float]:
    low, high = np.percentile(draws, [50 * (1 - CONFIDENCE), 50 * (1 + CONFIDENCE)])
    return float(low), float(high)
