"""Where the truth's clock stands, roughly: where its speed of turning goes along best with the gyro's.

The speed, |rate|, knows nothing of frames: it is the same in any axes, for the inverse attitude, and for a quaternion in another order.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from session.alignment.spans import Carried, Spans, vector

#: a clock that differs by more from what is known of it is another clock: the correlation of two different movements would be trusted
REACH_S = 2.0
#: of the search; the speed of a hand or a vehicle hardly changes within
STEP_S = 0.01
#: a speed that goes along with another's has a coefficient near 1; unrelated movements of 100 spans have 0.1 (tests/test_alignment.py)
ALIKE = 0.7
#: what is left of likeness may be by half more than at the best; a peak is the best of so many steps on either side
AS_GOOD, NEAR = 1.5, 5


def rough_offset(gyro: Sequence[Carried], truth: Sequence[tuple[Spans, np.ndarray]], around_s: float = 0.0) -> float | None:
    """Seconds to add to the truth's stamps, or None where the speeds are not alike at any; truth: of each log, spans and the quaternions
    (K, 4) that they turn by; around_s: the middle of what is searched, an offset that is known beforehand."""
    steps = STEP_S * np.arange(-round(REACH_S / STEP_S), round(REACH_S / STEP_S) + 1)
    offsets = around_s + steps
    speeds = [np.linalg.norm(vector(q), axis=1) / (s.end_s - s.begin_s) for s, q in truth]
    sums = [_summed(log) for log in gyro]
    likeness = np.array([_likeness(gyro, sums, truth, speeds, offset) for offset in offsets])
    # Movements that repeat are alike at many offsets: the nearest to the middle of those that are as good.
    likeness = np.nan_to_num(likeness, nan=-1.0)
    best = float(likeness.max())
    if best < ALIKE:
        return None
    good = np.flatnonzero(1 - likeness <= AS_GOOD * (1 - best))
    peaks = [i for i in good if likeness[i] >= likeness[max(i - NEAR, 0) : i + NEAR + 1].max()]
    return float(offsets[min(peaks, key=lambda i: abs(steps[i]))])


def _summed(log: Carried) -> np.ndarray:
    """(3, N) rad: the rate, summed in the body's own axes; each axis lies together, as it is read at hundreds of offsets."""
    steps = (log.rate[1:] + log.rate[:-1]) / 2 * np.diff(log.t_s)[:, None]
    return np.ascontiguousarray(np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)]).T)


def _likeness(
    gyro: Sequence[Carried], sums: list[np.ndarray], truth: Sequence[tuple[Spans, np.ndarray]], speeds: list[np.ndarray], offset_s: float
) -> float:
    """Correlation coefficient of the speeds, over all spans that lie whole within their logs; nan for fewer than half of them."""
    ours, theirs = [], []
    for log, summed, (spans, _), speed in zip(gyro, sums, truth, speeds, strict=True):
        begin, end = spans.begin_s + offset_s, spans.end_s + offset_s
        kept = log.whole(begin, end)
        turned = [np.interp(end[kept], log.t_s, axis) - np.interp(begin[kept], log.t_s, axis) for axis in summed]
        ours.append(np.sqrt(sum(np.square(each) for each in turned)) / (end - begin)[kept])
        theirs.append(speed[kept])
    x, y = np.concatenate(ours), np.concatenate(theirs)
    if len(x) < sum(map(len, speeds)) / 2 or len(x) < 3 or not x.std() > 0 or not y.std() > 0:
        return float("nan")
    return float(np.corrcoef(x, y)[0, 1])
