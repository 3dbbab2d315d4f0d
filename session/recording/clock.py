"""The device's clock against the host's: does a second of its stamps last a second?

Bytes arrive late, never early, and by chance.  So of each stretch of host time only the arrival with the least delay counts, and the
clock's rate is the slope of a line through these.
"""

from __future__ import annotations

import numpy as np

from session.common.units import NS

STRETCH_NS = 500_000_000
FEWEST = 6  #: stretches, 3 s, before anything is said


class ComparisonOfClocks:
    """``add`` arrivals, ``restart`` where device time begins anew."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget what was before."""
        self._stretch = -1
        self._earliest: list[tuple[int, int]] = []  # host_ns, t_us of the least delay in each stretch

    def add(self, host_ns: int, t_us: int) -> None:
        """At host_ns the sample of device time t_us was there."""
        stretch = host_ns // STRETCH_NS
        if stretch != self._stretch:
            self._stretch = stretch
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
