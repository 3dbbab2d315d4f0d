"""The times of a log whose samples came in bursts, and the gaps in it.

A telephone hands its samples on several at a time: 0.1 ms apart, then 10 ms later.  The sensor took them evenly.  A stamp is then the
sample's time and a delay, which is never negative and does not last: what came late is caught up.  A gap that is never caught up is samples
that are lost.

Stamps that are closer than half a period may also be right: where many samples are lost, their mean distance is no period.  Stamps alone do
not separate the two where few of both happen; which reading makes turns repeat does (``tinygc/features/turns/angles.py``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.base.units import NS
from session.log.stamps import COARSE, WINDOW, lasting_gaps

#: samples over which the period is measured, where there are four times as many: bursts are short against them
LAG = 512
#: of a period: stamps that are closer were not taken so
CLOSE = 0.5
#: of a period: an interval that is longer is a gap.  Stamps in steps of a display's 60 Hz make up to twice a period of 50 Hz
GAP = 3.0


@dataclass(frozen=True, eq=False)
class SampleTimes:
    """t_s (N,) s since the first sample, never decreasing; period_s of a sample; gap_rows (G,): the last row before each gap, and
    lost_s (G,): how much longer than a period it is; bursts: whether stamps were evened."""

    t_s: np.ndarray
    period_s: float
    gap_rows: np.ndarray
    lost_s: np.ndarray
    bursts: bool

    def lost_between(self, start: int, stop: int) -> float:
        """s that gaps between rows start and stop have lost."""
        return float(self.lost_s[(self.gap_rows >= start) & (self.gap_rows < stop)].sum())


def sample_times(t_ns: np.ndarray) -> SampleTimes:
    """The times (N,) of samples with increasing stamps (N,) ns: as stamped, or even between gaps where the stamps came in bursts."""
    t_s = (t_ns - t_ns[0]) * NS
    steps = np.diff(t_s)
    if len(t_s) <= 2 * WINDOW:
        return as_stamped(t_ns)
    lag = min(LAG, len(t_s) // 4)
    period_s = float(np.median(t_s[lag:] - t_s[:-lag])) / lag
    if np.mean(steps < CLOSE * period_s) <= COARSE:
        return SampleTimes(t_s, period_s, *_gaps(steps, period_s), bursts=False)
    rows, lost_s = lasting_gaps(t_ns, period_s)
    even = t_s.copy()
    for start, stop in zip([0, *(rows + 1)], [*(rows + 1), len(t_s)], strict=True):
        if stop - start > WINDOW:
            count = np.arange(stop - start)
            slope, begin = np.polyfit(count, t_s[start:stop] - t_s[start], 1)
            even[start:stop] = t_s[start] + begin + slope * count
    even = np.maximum.accumulate(even)
    long = lost_s > (GAP - 1) * period_s
    return SampleTimes(even - even[0], period_s, rows[long], lost_s[long], bursts=True)


def as_stamped(t_ns: np.ndarray) -> SampleTimes:
    """The times (N,) of samples whose stamps (N,) ns are right, however many are lost between."""
    t_s = (t_ns - t_ns[0]) * NS
    steps = np.diff(t_s)
    period_s = float(np.median(steps))
    return SampleTimes(t_s, period_s, *_gaps(steps, period_s), bursts=False)


def _gaps(steps: np.ndarray, period_s: float) -> tuple[np.ndarray, np.ndarray]:
    rows = np.flatnonzero(steps > GAP * period_s)
    return rows, steps[rows] - period_s
