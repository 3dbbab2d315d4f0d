"""Clocks: the host's, which paces a conversation; the board's against it, by the arrivals of its samples."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from session.base.units import NS
from session.log.config import HOST_CLOCK


class Clock:
    """The clock that paces a conversation: the host's; tests have one of their own."""

    def now_s(self) -> float:
        """Seconds since an arbitrary begin."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for a time."""
        time.sleep(seconds)


# Bytes arrive late by a random delay, never early.  So of each stretch of host time only the arrival with the least delay counts, and of
# some stretches together the least of these: the slope of a line through 10 such moments is the clock's rate.  Its sigma is that by their
# own scatter, the largest of the lines through 5, 10 and 20: a delay that wanders slowly shows in the few.
#
# A port that is polled in every frame of USB delivers up to a frame late, and where frames and samples keep step, this wanders once in
# minutes: no scatter shows it.  An adapter that hands over x samples at a time, by a timer of its own, leaves the last one n x steps of a
# sample's period old: what these leave open of the period may wander likewise.  A delay that changes by anything up to such a grain turns
# the line by grain / sqrt(3) / duration.

STRETCH_NS = 500_000_000  #: at first
BLOCKS = (5, 10, 20)
FEWEST = max(BLOCKS)  #: stretches, 10 s, before there is a result
MOST = 1024  #: stretches; beyond them they become twice as long, so that a day takes no more memory than an hour
FRAME_S = 1e-3  #: of USB at full speed
OFF = 0.001  #: the two clocks' relative difference that is reported at once; a host's is good to 0.0001
OFF_MOST = 0.25  #: beyond it the board is a virtual one that runs faster than real time
LEAST = 1e-6  #: sigma of a comparison: three digits of a file hold no less next to the host's own error
ONE_BY_ONE = 1.05  #: samples an arrival: up to so many, nothing holds them back


@dataclass(frozen=True)
class ClockRatio:
    """Seconds of the device's clock in one of the host's; sigma, relative, of the comparison alone; over_s, host's, that it took."""

    ratio: float
    sigma: float
    over_s: float

    @property
    def sigma_ppm(self) -> float:
        """By true seconds: the host's own error, the same in all comparisons, is in it."""
        return float(np.hypot(self.sigma, HOST_CLOCK)) * 1e6

    @classmethod
    def written(cls, ratio: float, sigma_ppm: float) -> ClockRatio:
        """As a file has it, whose sigma is ``sigma_ppm``."""
        return cls(ratio, float(np.sqrt(max((sigma_ppm * 1e-6) ** 2 - HOST_CLOCK**2, LEAST**2))), 0.0)

    @property
    def is_informative(self) -> bool:
        """Whether it shows more than that nothing was seen, of a board in real time."""
        return 3 * self.sigma < max(OFF, abs(self.ratio - 1)) < OFF_MOST

    @classmethod
    def of(cls, found: Sequence[ClockRatio]) -> ClockRatio | None:
        """The mean of several, whose sigma is wider where they differ by more than theirs; None of none."""
        if len(found) < 2:
            return found[0] if found else None
        ratio, sigma, over_s = np.array([(each.ratio, each.sigma, each.over_s) for each in found]).T
        mean = float(np.average(ratio, weights=sigma**-2.0))
        spread = float(np.sum(((ratio - mean) / sigma) ** 2)) / (len(found) - 1)
        return cls(mean, float(np.sqrt(max(spread, 1.0) / np.sum(sigma**-2.0))), float(over_s.sum()))


class ClockComparison:
    """``add`` arrivals, ``restart`` where device time restarts."""

    def __init__(self) -> None:
        self._before: list[ClockRatio] = []  # of device times that have ended
        self._begin()

    def restart(self) -> None:
        """Device time begins again; the rate before stays."""
        if (found := self._line()) is not None:
            self._before.append(found)
        self._begin()

    def _begin(self) -> None:
        self._stretch_ns = STRETCH_NS
        self._earliest: list[tuple[int, int]] = []  # host_ns, t_us of the least delay in each stretch
        self._found: tuple[int, ClockRatio | None] = (0, None)  # of so many stretches
        self._arrivals = self._samples = 0

    def add(self, host_ns: int, t_us: int, samples: int = 1) -> None:
        """The sample of device time t_us had arrived at host_ns, the last of so many."""
        self._arrivals, self._samples = self._arrivals + 1, self._samples + samples
        self._take(host_ns, t_us)
        if len(self._earliest) > MOST:
            before, self._earliest = self._earliest, []
            self._stretch_ns *= 2
            for arrival in before:
                self._take(*arrival)

    def _take(self, host_ns: int, t_us: int) -> None:
        if not self._earliest or host_ns // self._stretch_ns != self._earliest[-1][0] // self._stretch_ns:
            self._earliest.append((host_ns, t_us))
        elif host_ns - 1000 * t_us < self._earliest[-1][0] - 1000 * self._earliest[-1][1]:
            self._earliest[-1] = host_ns, t_us

    @property
    def measured(self) -> ClockRatio | None:
        """What is known of the device's clock; None for too few arrivals."""
        if self._found[0] != len(self._earliest):
            self._found = len(self._earliest), self._line()
        return ClockRatio.of([*self._before, *([self._found[1]] if self._found[1] is not None else [])])

    def _line(self) -> ClockRatio | None:
        if len(self._earliest) < FEWEST:
            return None
        since = np.array(self._earliest, np.int64) - self._earliest[0]
        host_s, device_s = since[:, 0] * NS, since[:, 1] * 1e-6
        rate = float(np.polyfit(host_s, device_s, 1)[0])
        if not 1 - OFF_MOST < rate < 1 / (1 - OFF_MOST):
            return None  # no clock
        for _ in range(2):  # which arrivals are the least late depends a little on the rate
            late_s, sigmas = host_s - device_s / rate, []
            for count in BLOCKS:
                rows = np.array([part[np.argmin(late_s[part])] for part in np.array_split(np.arange(len(since)), count)])
                (slope, _), (squares,), *_ = np.polyfit(host_s[rows], late_s[rows], 1, full=True)
                sigmas.append(float(np.sqrt(squares / (count - 2) / np.sum((host_s[rows] - host_s[rows].mean()) ** 2))))
                if count == BLOCKS[1]:
                    fresh = rate * (1 - float(slope))
            rate = fresh
        return ClockRatio(rate, float(np.hypot(max(sigmas), self._grain_s(device_s[-1]) / np.sqrt(3) / host_s[-1])), float(host_s[-1]))

    def _grain_s(self, device_s: float) -> float:
        """Within what the least delay may wander unseen."""
        at_once = self._samples / self._arrivals
        if at_once <= ONE_BY_ONE:
            return FRAME_S
        error = np.array([-1.0, 0.0, 1.0])[:, None] / self._arrivals
        ages = np.sort((at_once + error) * np.arange(min(self._arrivals // BLOCKS[1], MOST)) % 1.0)  # in a block, in periods
        left_open = float(np.diff(ages, append=1.0 + ages[:, :1]).max())
        return max(FRAME_S, left_open * device_s / self._samples)
