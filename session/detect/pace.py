"""The true time between two samples, where single samples are missing, and where stamps are coarse or jitter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.units import NS
from session.detect.segments import GAP_PERIODS

ROUNDS = 20  #: of counting, for a period that the counts confirm; two are usual
#: long steps come evenly where a clock is coarse, and by chance where samples are lost: variance of a window's span, in periods,
#: to the number of long steps in it
EVEN = 0.4
WINDOW_LONG_STEPS = 4  #: in one window, on average
LEAST_WINDOWS = 4
OFF = 0.45  #: of a period: a step that is off by more is counted; below the half, which steps of a coarse clock may hit
LOST_SIGMA = 5  #: by which long steps must outnumber the short ones that late stamps make as often


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
        return max(0, int((self.periods(steps_s) - 1).sum()))


def pace_of(t_ns: np.ndarray) -> Pace:
    """The pace of stamps (N,) ns that do not go backward; those that repeat are passed over.  At least one step is needed.

    Each step is counted in periods, and the period is their sum by their number: a missing sample does no harm, whether it is
    a gap or not.  A clock of 1 ms under 833 samples a second shows steps of 1 and 2 ms without a loss: there what is no gap is one period.
    """
    ticks = np.diff(t_ns)
    ticks = ticks[ticks > 0]
    steps_s = ticks * NS
    fine = _confirmed(steps_s)
    in_ticks = np.gcd.reduce(ticks) * NS >= fine / 2
    if not (_jittery(steps_s, fine) or (in_ticks and _even(steps_s, fine))):
        return Pace(fine)
    within = steps_s <= GAP_PERIODS * fine
    return Pace(float(steps_s[within].mean()), coarse=True)


def _confirmed(steps_s: np.ndarray) -> float:
    """The period, s, that steps of whole periods have; begun at the steps near the median, which lies on a tick of a coarse clock."""
    median = float(np.median(steps_s))
    near = steps_s[np.abs(steps_s - median) <= median / 2]
    # Of two steps or so, none may lie near the middle between them: then the shorter of the two beside it.
    period = float(near.mean()) if len(near) else float(np.quantile(steps_s, 0.5, method="lower"))
    for _ in range(ROUNDS):
        before, period = period, float(steps_s.sum() / np.rint(steps_s / period).sum())
        if abs(period / before - 1) < 1e-12:
            break
    return period


def _jittery(steps_s: np.ndarray, period_s: float) -> bool:
    """Whether stamps are off by so much that steps of two periods are as likely late stamps as lost samples."""
    short = np.count_nonzero(steps_s < (1 - OFF) * period_s)
    long = np.count_nonzero((steps_s > (1 + OFF) * period_s) & (steps_s <= GAP_PERIODS * period_s))
    return long - short < LOST_SIGMA * np.sqrt(2 * short)


def _even(steps_s: np.ndarray, period_s: float) -> bool:
    """Whether steps that count as more than one period come too evenly for samples lost by chance."""
    gap = steps_s > GAP_PERIODS * period_s
    long = (np.rint(steps_s / period_s) > 1) & ~gap
    windows = int(long.sum()) // WINDOW_LONG_STEPS
    if windows < LEAST_WINDOWS:
        return False
    size = len(steps_s) // windows
    # Of spans, not of long steps: one that only a late stamp has made has a short one near it.
    spans = np.where(gap, period_s, steps_s)[: size * windows].reshape(windows, size).sum(axis=1) / period_s
    return float(spans.var()) < EVEN * min(WINDOW_LONG_STEPS, size - WINDOW_LONG_STEPS)
