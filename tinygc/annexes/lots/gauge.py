"""Repeatability and reproducibility: the crossed study of measurement-system analysis (%GRR, ndc)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import fdtrc

# Crossed study of measurement-system analysis by analysis of variance: every appraiser measures every part equally often.
#
#     y = mean + part + appraiser + part x appraiser + repeat
#
# Source: AIAG, Measurement Systems Analysis, 4th edition, chapter III section B and appendix A; intervals by generalised pivotal
# quantities, R. K. Burdick, C. M. Borror, D. C. Montgomery, Design and Analysis of Gauge R&R Studies, SIAM 2005.

#: p-value from which the interaction is pooled with repeatability (AIAG's choice: 0.25 is the cautious one)
POOL_P = 0.25
DRAWS = 20_000
NAN = float("nan")


@dataclass(frozen=True)
class Anova:
    """Analysis of variance: sums of squares, degrees of freedom, of parts, appraisers, interaction and repeats (4,).

    interaction_f and interaction_p, NaN without repeats in a cell; pooled: whether the interaction counts as repeatability; parts,
    appraisers, trials: how many.
    """

    squares: np.ndarray
    freedom: np.ndarray
    interaction_f: float
    interaction_p: float
    pooled: bool
    parts: int
    appraisers: int
    trials: int

    @property
    def mean_squares(self) -> np.ndarray:
        """Return (4,); NaN for zero degrees of freedom."""
        return np.divide(self.squares, self.freedom, out=np.full(4, np.nan), where=self.freedom > 0)


def anova(y: np.ndarray, pool_p: float = POOL_P) -> Anova:
    """Analyse a crossed, balanced study y (parts, appraisers, trials); pool_p: p-value from which the interaction is pooled."""
    parts, appraisers, trials = y.shape
    whole, part, who, cell = y.mean(), y.mean(axis=(1, 2)), y.mean(axis=(0, 2)), y.mean(axis=2)
    squares = np.array(
        [
            appraisers * trials * np.sum((part - whole) ** 2),
            parts * trials * np.sum((who - whole) ** 2),
            trials * np.sum((cell - part[:, None] - who + whole) ** 2),
            np.sum((y - cell[:, :, None]) ** 2),
        ]
    )
    freedom = np.array([parts - 1, appraisers - 1, (parts - 1) * (appraisers - 1), parts * appraisers * (trials - 1)], dtype=float)
    f = p = NAN
    if freedom[2] > 0 and freedom[3] > 0 and squares[3] > 0:
        f = float(squares[2] / freedom[2] / (squares[3] / freedom[3]))
        p = float(fdtrc(freedom[2], freedom[3], f))
    pooled = bool(freedom[2] == 0 or trials == 1 or p > pool_p)
    return Anova(squares, freedom, f, p, pooled, parts, appraisers, trials)


def components(table: Anova, mean_squares: np.ndarray | None = None) -> np.ndarray:
    """Return (…, 4): variances of parts, appraisers, their interaction and repeats, none below 0; mean_squares (…, 4): instead of the
    table's.

    Without repeats in a cell, or where the interaction is pooled, the remainder after parts and appraisers is repeatability.
    """
    ms = table.mean_squares if mean_squares is None else mean_squares
    n, o, r = table.parts, table.appraisers, table.trials
    if table.pooled:
        freedom = table.freedom[2:]
        error = (np.nan_to_num(ms[..., 2:]) @ freedom) / max(freedom.sum(), 1)
        between, interaction = error, np.zeros_like(error)
    else:
        error, between = ms[..., 3], ms[..., 2]
        interaction = np.maximum(between - error, 0) / r
    part = np.maximum(ms[..., 0] - between, 0) / (o * r)
    appraiser = np.maximum(ms[..., 1] - between, 0) / (n * r) if o > 1 else np.zeros_like(error)
    return np.stack([part, appraiser, interaction, error], axis=-1)


def drawn(table: Anova, seed: int = 0, draws: int = DRAWS) -> np.ndarray:
    """Return (draws, 4): components drawn from their distribution, each mean square by its chi-square."""
    rng = np.random.default_rng(seed)
    chi = rng.chisquare(np.maximum(table.freedom, 1), size=(draws, 4))
    if table.pooled:  # one error, with the degrees of freedom of both
        both = table.freedom[2:].sum()
        error = np.sum(table.squares[2:]) / rng.chisquare(max(both, 1), size=draws)
        squares = np.column_stack([table.squares[:2] / chi[:, :2], error, error])
    else:
        squares = table.squares / chi
    return components(table, np.where(table.freedom > 0, squares, 0.0))


# Variances of parts, appraisers, their interaction and repeats in an unbalanced study: by restricted likelihood.
#
# Repeats within a cell (one part, one appraiser) are summed first, then parts, so that only a matrix of appraisers remains, for any number
# of sessions. A balanced study gives the analysis of variance's result unless a variance is zero.

#: floor of a variance relative to the largest one, for its logarithm
_LEAST = 1e-8


@dataclass(frozen=True, eq=False)
class Cells:
    """Summary of the cells: mean and count (C,) of each; part and appraiser (C,) as numbers; inside: sum of squares within cells, and its
    freedom."""

    mean: np.ndarray
    count: np.ndarray
    part: np.ndarray
    appraiser: np.ndarray
    inside: float
    freedom: int


def cells_of(y: np.ndarray, part: np.ndarray, appraiser: np.ndarray) -> Cells:
    """Summarise sessions y (S,), with numbers of their parts and appraisers (S,)."""
    _, part = np.unique(part, return_inverse=True)
    _, appraiser = np.unique(appraiser, return_inverse=True)
    number = part * (appraiser.max() + 1) + appraiser
    names, cell = np.unique(number, return_inverse=True)
    count = np.bincount(cell)
    mean = np.bincount(cell, y) / count
    inside = float(np.sum((y - mean[cell]) ** 2))
    return Cells(mean, count, names // (appraiser.max() + 1), names % (appraiser.max() + 1), inside, len(y) - len(names))


def told(cells: Cells) -> np.ndarray:
    """Return (4,) bool: which of the variances of parts, appraisers, interaction and repeats the study determines."""
    parts, who, n = cells.part.max() + 1, cells.appraiser.max() + 1, len(cells.mean)
    repeats = cells.freedom > 0
    beyond = n > parts + who - 1
    return np.array([parts > 1 and (repeats or beyond), who > 1, repeats and beyond and who > 1, repeats or beyond])


def minus_twice_log_likelihood(variances: np.ndarray, cells: Cells) -> float:
    """Return -2 log of the restricted likelihood of the four variances, up to a constant."""
    part, who, both, again = variances
    D = both + again / cells.count
    n, parts, people = len(D), cells.part.max() + 1, cells.appraiser.max() + 1
    w = 1 / D
    by_part = np.bincount(cells.part, w, parts)
    g = part / (1 + part * by_part)
    cross = np.bincount(cells.part * people + cells.appraiser, w, parts * people).reshape(parts, people)

    def whitened(x: np.ndarray) -> np.ndarray:
        """Remove the covariance of parts and cells: K^-1 x."""
        return w * (x - (g * np.bincount(cells.part, w * x, parts))[cells.part])

    S = np.diag(np.bincount(cells.appraiser, w, people)) - cross.T @ (cross * g[:, None])
    inner = np.eye(people) + who * S
    ones, y = np.ones(n), cells.mean - cells.mean.mean()
    k1, ky = whitened(ones), whitened(y)
    z1, zy = (np.bincount(cells.appraiser, k, people) for k in (k1, ky))
    solved = np.linalg.solve(inner, np.column_stack([z1, zy])) * who
    one_one, one_y, y_y = k1.sum() - z1 @ solved[:, 0], ky.sum() - z1 @ solved[:, 1], y @ ky - zy @ solved[:, 1]
    logs = np.log(D).sum() + np.log1p(part * by_part).sum() + np.linalg.slogdet(inner)[1] + np.log(one_one)
    return float(logs + y_y - one_y**2 / one_one + cells.freedom * np.log(again) + cells.inside / again)


def variances(cells: Cells) -> tuple[np.ndarray, np.ndarray]:
    """Return variances (4,) of parts, appraisers, interaction and repeats, and the covariance (4, 4) of their logarithms; NaN if
    undetermined."""
    from scipy.optimize import minimize

    can = told(cells)
    scale = max(float(np.var(cells.mean)), cells.inside / max(cells.freedom, 1), 1e-300)
    few = Cells(cells.mean / np.sqrt(scale), cells.count, cells.part, cells.appraiser, cells.inside / scale, cells.freedom)

    def cost(logs: np.ndarray) -> float:
        full = np.zeros(4)
        full[can] = np.exp(np.clip(logs, np.log(_LEAST), 25))
        full[3] = max(full[3], _LEAST)
        return minus_twice_log_likelihood(full, few)

    starts = [np.log(np.array([1.0, 0.1, 0.05, 0.1]))[can], np.log(np.array([0.3, 0.3, 0.01, 0.5]))[can]]
    bounds = [(np.log(_LEAST), 10.0)] * int(can.sum())
    options = {"ftol": 1e-11, "gtol": 1e-6}
    best = min((minimize(cost, start, method="L-BFGS-B", bounds=bounds, options=options) for start in starts), key=lambda o: o.fun)
    found, covariance = np.full(4, np.nan), np.full((4, 4), np.nan)
    found[can] = np.where(np.exp(best.x) > 10 * _LEAST, np.exp(best.x), 0.0) * scale
    inner = found[can] > 0
    curved = _curvature(cost, best.x)[np.ix_(inner, inner)]
    at = np.flatnonzero(can)[inner]
    covariance[np.ix_(can, can)] = 0.0
    covariance[np.ix_(at, at)] = np.linalg.pinv(curved / 2, hermitian=True)
    return found, covariance


def _curvature(cost: Callable[[np.ndarray], float], x: np.ndarray, step: float = 0.05) -> np.ndarray:
    """Return the second derivatives by differences."""
    E = np.eye(len(x)) * step

    def bent(a: np.ndarray, b: np.ndarray) -> float:
        return (cost(x + a + b) - cost(x + a - b) - cost(x - a + b) + cost(x - a - b)) / (4 * step**2)

    return np.array([[bent(a, b) for b in E] for a in E])


# Repeatability and reproducibility of a lot's sessions, in the terms of measurement-system analysis: %GRR, ndc.
#
# The parts are units, the trials are sessions, the appraisers are the operators, or stations where only these are named. EV equipment
# variation (repeatability), AV appraiser variation (reproducibility, including the interaction), GRR both together, PV part variation, TV
# total variation; all one sigma. ndc = 1.41 PV / GRR.

#: factor of PV / GRR for the number of distinct categories, AIAG
NDC = 1.41
#: sigmas of a study's width and of a tolerance's, AIAG's fourth edition
WIDTH = 6.0
#: confidence level of an interval
CONFIDENCE = 0.95
#: most sessions in the likelihood; those of units with several come first
MOST_SESSIONS = 4000
#: AIAG's limits: below the first acceptable, from the second on not acceptable
ACCEPTABLE, MARGINAL = 10.0, 30.0
_DRAWS = 4000


@dataclass(frozen=True, eq=False)
class Gauge:
    """Study of one number.

    ev, av, interaction (part of av), grr, pv, tv: one sigma each in the number's unit, NaN where undetermined; percent_grr of tv and
    percent_tolerance, of the distance between limits, %; ndc, not cut to a whole number; ``*_interval``: from, to, at 95 %.  method:
    ``anova`` or ``likelihood``; table: the analysis of variance; appraisers: what they are, or empty; parts, sessions: how many; why:
    undetermined quantities, with the reason.
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
        """Return AIAG's verdict for %GRR."""
        if not np.isfinite(self.percent_grr):
            return "not told"
        return "acceptable" if self.percent_grr < ACCEPTABLE else "marginal" if self.percent_grr <= MARGINAL else "not acceptable"


def gauge(
    y: np.ndarray, part: np.ndarray, appraiser: np.ndarray | None, tolerance: float = NAN, what: str = "operator", seed: int = 0
) -> Gauge:
    """Study sessions y (S,), with numbers of their units (S,), and of their appraisers (S,) or None; tolerance: upper less lower limit, or
    NaN."""
    fine = np.isfinite(y)
    y, part = y[fine], part[fine]
    who = np.zeros(len(y), dtype=int) if appraiser is None else appraiser[fine]
    several = len(np.unique(who)) > 1
    why = "" if several else "one operator or none is named: reproducibility is unknown, and GRR is repeatability alone"
    study = _crossed(y, part, who)
    names, of = np.unique(part, return_inverse=True)
    if len(names) < 2 or (np.bincount(of) < 2).all():
        why = "no unit has two sessions: repeatability is unknown"
        return Gauge(NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, (NAN, NAN), (NAN, NAN), "none", None, "", len(names), len(y), why)
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
    part_sigma, who_sigma, both, again = np.sqrt(np.nan_to_num(found))
    grr, pv = float(np.sqrt(who_sigma**2 + both**2 + again**2)), float(part_sigma)
    tv = float(np.hypot(grr, pv))
    spread, all_of_it = np.sum(draws[:, 1:], axis=1), np.sum(draws, axis=1)
    shares = np.divide(spread, all_of_it, out=np.full(len(draws), NAN), where=all_of_it > 0)  # of no variation at all there is no share
    times = np.sqrt(draws[:, 0]) / np.sqrt(np.maximum(spread, 1e-300))  # large where every measurement repeats itself exactly
    return Gauge(
        ev=float(again),
        av=float(np.hypot(who_sigma, both)) if several else NAN,
        interaction=float(both) if several else NAN,
        grr=grr,
        pv=pv,
        tv=tv,
        percent_grr=100 * grr / tv if tv else NAN,
        percent_tolerance=100 * WIDTH * grr / tolerance if np.isfinite(tolerance) else NAN,
        ndc=NDC * pv / grr if grr else float("inf"),
        percent_grr_interval=_ends(100 * np.sqrt(shares)),
        ndc_interval=_ends(NDC * times),
        method=method,
        table=table,
        appraisers=what if several else "",
        parts=len(names),
        sessions=len(y),
        why=why,
    )


def _crossed(y: np.ndarray, part: np.ndarray, who: np.ndarray) -> np.ndarray | None:
    """Return (parts, appraisers, trials) where every appraiser has measured every part equally often, else None."""
    parts, p = np.unique(part, return_inverse=True)
    people, w = np.unique(who, return_inverse=True)
    cell = p * len(people) + w
    count = np.bincount(cell, minlength=len(parts) * len(people))
    if count.min() != count.max() or count.max() == 0:
        return None
    return y[np.argsort(cell, kind="stable")].reshape(len(parts), len(people), count.max())


def _looked_at(of: np.ndarray, seed: int) -> np.ndarray:
    """Return the sessions used, whole units at a time, those with several sessions first."""
    count = np.bincount(of)
    rank = np.random.default_rng(seed).permutation(len(count)) + np.where(count > 1, 0, len(count))
    order = np.argsort(rank)
    enough = order[np.cumsum(count[order]) <= MOST_SESSIONS]
    return np.flatnonzero(np.isin(of, enough))


def _ends(draws: np.ndarray) -> tuple[float, float]:
    low, high = np.percentile(draws, [50 * (1 - CONFIDENCE), 50 * (1 + CONFIDENCE)])
    return float(low), float(high)
