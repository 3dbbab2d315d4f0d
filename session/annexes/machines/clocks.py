"""Clocks that pace a conversation: the host's, and one that a test turns on by itself."""

from __future__ import annotations

import threading
import time
from typing import Protocol


class Clock(Protocol):
    """Seconds since an arbitrary begin, and a wait."""

    def now_s(self) -> float:
        """The present."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait for a time."""


class HostClock:
    """Clock of the host."""

    def now_s(self) -> float:
        """Seconds since an arbitrary begin."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for a time."""
        time.sleep(seconds)


class SimulatedClock:
    """Time that passes only where somebody waits: hours of a virtual table within a second."""

    def __init__(self, now_s: float = 0.0):
        self._now_s = now_s
        self._lock = threading.Lock()

    def now_s(self) -> float:
        """Seconds so far."""
        return self._now_s

    def sleep(self, seconds: float) -> None:
        """Let a time pass at once."""
        with self._lock:
            self._now_s += max(seconds, 0.0)
