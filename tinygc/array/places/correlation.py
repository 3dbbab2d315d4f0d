"""Where a unit's clock stands, roughly: where its speed of turning goes along best with the first unit's.

The speed, ``|rate|``, is the same in any axes, so no mounting need be known.  A clock that runs by up to 1 % fast or slow smears the
correlation of a long recording, so rates are tried on a grid that is as fine as the recording is long.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from tinygc.array.places.rates import Rates

#: how far a clock's rate may be from the first unit's: an RC oscillator's trimming, and half as much again
MOST_RATE = 0.015
#: s; a hand's turn has its speed's bends over some tenths of a second
STEP_S = 0.05
#: times as long steps, in which all rates are tried first
COARSER = 4
#: of the shorter log, that has to lie within the longer one
LEAST_OVERLAP = 0.5
#: a speed is looked at on this many grid points at most
MOST_POINTS = 400_000


@dataclass(frozen=True)
class RoughClock:
    """Of one log: ``t_array = t_unit + offset_s + rate (t_unit - about_s)``; likeness: the correlation of the speeds there."""

    offset_s: float
    rate: float
    about_s: float
    likeness: float


def rough_clock(first: Rates, unit: Rates) -> RoughClock:
    """The clock of one log of a unit against the first unit's log of the same time."""
    first, unit = first.between_good(), unit.between_good()
    length_s = max(float(rates.t_s[-1] - rates.t_s[0]) for rates in (first, unit))
    fine_s = max(STEP_S, first.period_s, unit.period_s, length_s / MOST_POINTS)
    best, around, reach = None, 0.0, MOST_RATE
    for step_s in (COARSER * fine_s, fine_s):
        # With a step of the grid at the ends of the recording, the smear takes little from the peak.
        rate_step = min(MOST_RATE, 2 * step_s / max(float(unit.t_s[-1] - unit.t_s[0]), step_s))
        count = int(np.ceil(reach / rate_step))
        best = _search(first, unit, step_s, np.clip(around + rate_step * np.arange(-count, count + 1), -MOST_RATE, MOST_RATE))
        around, reach = best.rate, 2 * rate_step
    assert best is not None
    return best


def _search(first: Rates, unit: Rates, step_s: float, rates: np.ndarray) -> RoughClock:
    """The best of these rates (R,), at any offset; speeds are meaned over steps of so many s."""
    grid = first.t_s[0] + step_s * np.arange(int((first.t_s[-1] - first.t_s[0]) / step_s) + 1)
    about_s = float(unit.t_s[0] + unit.t_s[-1]) / 2
    count = int((unit.t_s[-1] - unit.t_s[0]) * (1 + MOST_RATE) / step_s) + 2
    front = _Front(_speed(first, first.t_s, grid), next_fast_len(len(grid) + count, real=True))
    best = RoughClock(0.0, 0.0, about_s, -2.0)
    for rate in rates:
        moved = about_s + (1 + rate) * (unit.t_s - about_s)
        theirs = _speed(unit, moved, moved[0] + step_s * np.arange(int((moved[-1] - moved[0]) / step_s) + 1))
        likeness, lag = front.best(theirs)
        if likeness > best.likeness:
            best = RoughClock(float(grid[0] + lag * step_s - moved[0]), float(rate), about_s, likeness)
    return best


def _speed(rates: Rates, t_s: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """|rate| without the zero-rate offset, meaned over the steps of a grid that lies within the log."""
    speed = np.linalg.norm(rates.rate - np.median(rates.rate, axis=0), axis=1)
    turned = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2 * np.diff(t_s))])
    edges = np.append(grid, grid[-1] + (grid[-1] - grid[-2] if len(grid) > 1 else 1.0))
    return np.diff(np.interp(edges, t_s, turned))


class _Front:
    """The first unit's speeds (N,), against which others are laid at every lag."""

    def __init__(self, ours: np.ndarray, size: int):
        self.count, self.size = len(ours), size
        ours = ours - ours.mean()
        self.one, self.value, self.square = (rfft(each, size) for each in (np.ones(self.count), ours, ours**2))

    def best(self, theirs: np.ndarray) -> tuple[float, int]:
        """Largest correlation coefficient over all lags that overlap by enough, and its lag: theirs[0] beside ours[lag]."""
        theirs = theirs - theirs.mean()
        one, value, square = (np.conj(rfft(each, self.size)) for each in (np.ones(len(theirs)), theirs, theirs**2))

        def summed(a: np.ndarray, b: np.ndarray) -> np.ndarray:
            return np.asarray(irfft(a * b, self.size))

        count = np.round(summed(self.one, one))
        x, y = summed(self.value, one), summed(self.one, value)
        xx, yy, xy = summed(self.square, one), summed(self.one, square), summed(self.value, value)
        enough = count >= max(2, LEAST_OVERLAP * min(self.count, len(theirs)))
        with np.errstate(divide="ignore", invalid="ignore"):
            spread = (xx - x * x / count) * (yy - y * y / count)
            likeness = np.where(enough & (spread > 0), (xy - x * y / count) / np.sqrt(spread), -1.0)
        lag = int(np.argmax(likeness))
        return float(likeness[lag]), lag - self.size if lag >= self.count else lag
