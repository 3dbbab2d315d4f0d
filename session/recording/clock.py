"""The device's clock against the host's: does a second of its stamps last a second?

Bytes arrive late, never early, and by chance.  So of each stretch of host time only the arrival with the least delay counts, and the
clock's rate is the slope of a line through these.
"""

from __future__ import annotations

import numpy as np

from session.common.units import NS

STRETCH_NS = 500_000_000  #: at first
FEWEST = 6  #: stretches, 3 s, before anything is said
MOST = 1024  #: stretches; beyond them they become twice as long: a day is held in no more memory than an hour


class ComparisonOfClocks:
    """``add`` arrivals, ``restart`` where device time begins anew."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget what was before."""
        self._stretch_ns = STRETCH_NS
        self._earliest: list[tuple[int, int]] = []  # host_ns, t_us of the least delay in each stretch

    def add(self, host_ns: int, t_us: int) -> None:
        """At host_ns the sample of device time t_us was there."""
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
    def compared_s(self) -> float:
        """For how long, by the host's clock."""
        return (self._earliest[-1][0] - self._earliest[0][0]) * NS if self._earliest else 0.0

    @property
    def device_seconds_per_second(self) -> float | None:
        """Rate of the device's clock by the host's, about 1; None while too little is known."""
        if len(self._earliest) < FEWEST:
            return None
        since = np.array(self._earliest, np.int64) - self._earliest[0]
        return float(np.polyfit(since[:, 0] * NS, since[:, 1] * 1e-6, 1)[0])
