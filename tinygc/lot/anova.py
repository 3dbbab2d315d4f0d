"""The crossed study of measurement-system analysis by analysis of variance: every appraiser measures every part as often.

    y = mean + part + appraiser + part x appraiser + repeat

Source: AIAG, Measurement Systems Analysis, 4th edition, chapter III section B and appendix A; intervals by generalised pivotal quantities,
R. K. Burdick, C. M. Borror, D. C. Montgomery, Design and Analysis of Gauge R&R Studies, SIAM 2005.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

#: the interaction is pooled with repeatability where chance gives as much as often as this (AIAG's choice: 0.25 guards the more)
POOL_P = 0.25
DRAWS = 20_000


@dataclass(frozen=True)
class Anova:
    """Sums of squares, degrees of freedom, of parts, appraisers, interaction and repeats (4,); interaction_f and interaction_p, NaN
    without repeats in a cell; pooled: whether the interaction counts as repeatability; parts, appraisers, trials: how many."""

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
        """(4,); NaN where there is no freedom."""
        return np.divide(self.squares, self.freedom, out=np.full(4, np.nan), where=self.freedom > 0)


def anova(y: np.ndarray, pool_p: float = POOL_P) -> Anova:
    """Of a crossed, balanced study y (parts, appraisers, trials); pool_p: from which p-value on the interaction is pooled."""
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
    f = p = float("nan")
    if freedom[2] > 0 and freedom[3] > 0 and squares[3] > 0:
        f = float(squares[2] / freedom[2] / (squares[3] / freedom[3]))
        p = float(stats.f.sf(f, freedom[2], freedom[3]))
    pooled = bool(freedom[2] == 0 or trials == 1 or p > pool_p)
    return Anova(squares, freedom, f, p, pooled, parts, appraisers, trials)


def components(table: Anova, mean_squares: np.ndarray | None = None) -> np.ndarray:
    """(…, 4): variances of parts, appraisers, their interaction and repeats, none below 0; mean_squares (…, 4): instead of the table's.

    Without repeats in a cell, or where it is pooled, what is left beside parts and appraisers is repeatability.
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
    """(draws, 4): components as the data leave them open, each mean square by its chi-square."""
    rng = np.random.default_rng(seed)
    chi = rng.chisquare(np.maximum(table.freedom, 1), size=(draws, 4))
    if table.pooled:  # one error, of the freedom of both
        both = table.freedom[2:].sum()
        error = np.sum(table.squares[2:]) / rng.chisquare(max(both, 1), size=draws)
        squares = np.column_stack([table.squares[:2] / chi[:, :2], error, error])
    else:
        squares = table.squares / chi
    return components(table, np.where(table.freedom > 0, squares, 0.0))
