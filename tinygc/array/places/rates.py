"""What a unit's gyroscope read, log by log, on its own clock, without what stands at the register's end."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from session.common.units import DEG, NS
from session.detect.clipping import register_end_dps
from session.log.folder import Session
from session.log.logfile import Log
from session.log.samples import Samples

#: samples on either side of a clipped one that a spline through it would bend
BESIDE = 3
#: of the usual period: a longer step is a gap, over which nothing is interpolated
GAP_PERIODS = 1.6
#: s of one and the same reading on all axes, from which on it is no measurement: a sensor has noise (as in the vote of the fused output)
STUCK_S = 0.5


@dataclass(frozen=True, eq=False)
class Rates:
    """One log of one unit: t_s (N,) s of its own clock, rate (N, 3) rad/s in its gyroscope's axes, good (N,) bool: neither clipped nor
    stuck, nor beside such a one or a gap; period_s of its stamps."""

    t_s: np.ndarray
    rate: np.ndarray
    good: np.ndarray
    period_s: float

    def __len__(self) -> int:
        return len(self.t_s)

    def shifted(self, t_s: np.ndarray) -> Rates:
        """The same readings at other moments (N,) s."""
        return replace(self, t_s=t_s)

    def between_good(self) -> Rates:
        """From the first good reading to the last: without the end of a log whose sensor had died."""
        good = np.flatnonzero(self.good)
        if len(good) < 2:
            return self
        part = slice(good[0], good[-1] + 1)
        return replace(self, t_s=self.t_s[part], rate=self.rate[part], good=self.good[part])

    def spline(self) -> CubicSpline:
        """The rate as a smooth function of the unit's time."""
        return CubicSpline(self.t_s, self.rate)

    def covers(self, t_s: np.ndarray) -> np.ndarray:
        """(M,) bool: which moments lie between two good readings that are neighbours."""
        after = np.searchsorted(self.t_s, t_s)
        inside = (after > 0) & (after < len(self))
        after = np.clip(after, 1, len(self) - 1)
        return np.asarray(inside & self.good[after] & self.good[after - 1])


def rates_of(samples: Samples, end_dps: float) -> Rates:
    """Of one log; end_dps: from which rate on a reading is no measurement (``register_end_dps``)."""
    t_s, rate = samples.t_ns * NS, np.asarray(samples.gyro)
    bad = (np.abs(rate) >= end_dps * DEG).any(axis=1)
    step, period_s = np.diff(t_s), samples.period_s
    bad |= _stuck(rate, max(round(STUCK_S / period_s), 4))
    gaps = step > GAP_PERIODS * period_s
    bad[:-1] |= gaps
    bad[1:] |= gaps
    near = np.convolve(bad, np.ones(2 * BESIDE + 1), mode="same") > 0.5 if len(bad) > 2 * BESIDE else np.full(len(bad), bad.any())
    return Rates(t_s, rate, ~near, period_s)


def _stuck(rate: np.ndarray, length: int) -> np.ndarray:
    """(N,) bool: readings in runs of one and the same value on all axes, as long as that or longer."""
    begins = np.flatnonzero(np.append(True, (rate[1:] != rate[:-1]).any(axis=1)))
    count = np.diff(np.append(begins, len(rate)))
    return np.repeat(count >= length, count)


def session_rates(session: Session) -> tuple[Rates, ...]:
    """Of every log, then every closure run, of a unit."""
    return tuple(map(lambda log: log_rates(session, log), (*session.logs, *session.closures)))


def log_rates(session: Session, log: Log) -> Rates:
    """Of one of its logs."""
    samples = log.samples
    return rates_of(samples, register_end_dps(session.config.sensor, np.asarray(samples.gyro)))
