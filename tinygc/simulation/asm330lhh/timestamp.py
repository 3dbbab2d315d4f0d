"""The counter of 25 us."""

from __future__ import annotations

import math


class Timestamp:
    """Stands at 0 until it is ``set``, and counts from then on at a rate that may change."""

    def __init__(self) -> None:
        self._ticks, self._since_s, self._hz = 0.0, 0.0, 0.0

    def exact(self, t_s: float) -> float:
        """Ticks at a time, with their fraction."""
        return self._ticks + (t_s - self._since_s) * self._hz

    def at(self, t_s: float) -> int:
        """The 32 bits at a time: a tick that is due then has come."""
        return math.floor(self.exact(t_s) + 1e-6) % 2**32

    def set(self, ticks: float, t_s: float, hz: float) -> None:
        """So many at a time, and so many more each second from then on."""
        self._ticks, self._since_s, self._hz = ticks, t_s, hz
