"""The clock that paces a conversation; tests have one of their own."""

from __future__ import annotations

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
