"""The true time between two samples, where single samples are missing, and where stamps are coarse or jitter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.base.numeric import running_sum
from session.base.units import NS

#: data rates of session.toml: any sensor's, with room
SLOWEST_HZ, FASTEST_HZ = 0.1, 50_000.0
GAP_PERIODS = 2.5  #: a longer step between two stamps is a gap
ROUNDS = 20  #: of counting, for a period that the counts confirm; two are usual
#: long steps come evenly where a clock is coarse, and by chance where samples are lost: variance of a window's span, in periods,
#: to the number of long steps in it
EVEN = 0.4
WINDOW_LONG_STEPS = 4  #: in one window, on average
LEAST_WINDOWS = 4
OFF = 0.45  #: of a period: a step that is off by more is counted; below the half, which steps of a coarse clock may hit
#: samples on either side of a step, of which the least delayed counts: a burst of a telephone is over after 5 to 20
WINDOW = 32
LOST = 0.75  #: of a period: a step that lasts and is larger has lost a sample
LAG = 512  #: samples over which late stamps tell the period, where there are four times as many
LOST_SIGMA = 5  #: by which long steps must outnumber the short ones that late stamps make as often
#: steps that are counted at once
TOGETHER = 1 << 17


@dataclass(frozen=True)
class Pace:
    """period_s: the true time between two samples; coarse: stamps too coarse, or off by too much, to show that one sample is missing."""

    period_s: float
    coarse: bool = False

    @property
    def rate_hz(self) -> float:
        """The true data rate, Hz."""
        return 1 / self.period_s

    def periods(self, steps_s: np.ndarray) -> np.ndarray:
        """How many periods each of consecutive steps (N,) s holds, whole numbers: one, or more where samples are missing."""
        counts = np.rint(steps_s / self.period_s)
        return np.where(steps_s <= GAP_PERIODS * self.period_s, 1.0, counts) if self.coarse else counts

    def missing(self, steps_s: np.ndarray) -> int:
        """Samples that are missing in consecutive steps (N,) s."""
        parts = (steps_s[start : start + TOGETHER] for start in range(0, len(steps_s), TOGETHER))
        return max(0, int(sum((self.periods(part) - 1).sum() for part in parts)))


def pace_of(t_ns: np.ndarray) -> Pace:
    """The pace of stamps (N,) ns that do not go backward; those that repeat are passed over, and stamps that do not go on have none.

    Each step is counted in periods, and the period is their sum by their number: a missing sample does no harm, whether it is
    a gap or not.  A clock of 1 ms under 833 samples a second shows steps of 1 and 2 ms without a loss: there what is no gap is one period.
    """
    steps = np.diff(t_ns)
    if not (fresh := steps > 0).all():
        steps = steps[fresh]
    del fresh  # a day has as many of them as of samples
    if not len(steps):
        return Pace(np.nan)
    fine = _confirmed(steps)
    usual = _of_many(steps) if len(steps) >= 4 * WINDOW and steps.min() < (1 - OFF) * fine else fine
    # Where stamps are late by half a period, some steps count as none and the period comes out too short: then many samples tell it.
    late = _late(steps, fine) or (float(steps.min()) < usual / 2 and _late(steps, usual))
    if not (late or (_even(steps, fine) and np.gcd.reduce(steps) >= fine / 2)):
        return Pace(fine * NS)
    rows = np.flatnonzero(steps > GAP_PERIODS * usual)
    if len(steps) >= 4 * WINDOW:
        rows = rows[not_caught_up(running_sum(steps), rows, usual * NS)]
    within = float(steps.sum() - steps[rows].sum()) / max(len(steps) - len(rows), 1)
    return Pace(float(steps.sum()) / (len(steps) - len(rows) + float(np.rint(steps[rows] / within).sum())) * NS, coarse=True)


def _of_many(steps: np.ndarray) -> float:
    t, lag = np.cumsum(steps), min(LAG, len(steps) // 4)
    return float(np.median(t[lag:] - t[:-lag])) / lag


def not_caught_up(t_ns: np.ndarray, rows: np.ndarray, period_s: float) -> np.ndarray:
    """(K,) bool: whether the long steps behind these rows (K,) of stamps (N,) ns last: the least late behind them are later than those
    before."""
    around = np.arange(WINDOW)
    before = np.maximum(rows[:, None] - around, 0)
    behind = np.minimum(rows[:, None] + 1 + around, len(t_ns) - 1)
    least = [((t_ns[some] - t_ns[0]) * NS - period_s * some).min(axis=1) for some in (before, behind)]
    return np.asarray(least[1] - least[0] > LOST * period_s)


def _late(steps: np.ndarray, period: float) -> bool:
    """Whether steps of two periods are as likely late stamps as lost samples."""
    short = np.count_nonzero(steps < (1 - OFF) * period)
    long = np.count_nonzero((steps > (1 + OFF) * period) & (steps <= GAP_PERIODS * period))
    return bool(long - short < LOST_SIGMA * np.sqrt(2 * short))


def _confirmed(steps: np.ndarray) -> float:
    """The period, ns, that steps (N,) of whole periods have; begun at those near the median, which lies on a tick of a coarse clock."""
    median = float(np.median(steps))
    near = steps[np.abs(steps - median) <= median / 2]
    # Of two steps or so, none may lie near the middle between them: then the shorter of its two neighbours.
    period = float(near.mean()) if len(near) else float(np.quantile(steps, 0.5, method="lower"))
    del near
    whole = float(steps.sum())
    for _ in range(ROUNDS):
        counts = steps / period
        before, period = period, whole / float(np.rint(counts, out=counts).sum())
        if abs(period / before - 1) < 1e-12:
            break
    return period


def _even(steps: np.ndarray, period: float) -> bool:
    """Whether steps that count as more than one period come too evenly for samples lost by chance."""
    gap = steps > GAP_PERIODS * period
    long = (np.rint(steps / period) > 1) & ~gap
    windows = int(long.sum()) // WINDOW_LONG_STEPS
    if windows < LEAST_WINDOWS:
        return False
    size = len(steps) // windows
    # Of spans, not of long steps: one that only a late stamp has made has a short one near it.
    spans = np.where(gap, period, steps)[: size * windows].reshape(windows, size).sum(axis=1) / period
    return float(spans.var()) < EVEN * min(WINDOW_LONG_STEPS, size - WINDOW_LONG_STEPS)
