"""What a board is paced by."""

from __future__ import annotations

import time


class Clock:
    """The host's."""

    def now_s(self) -> float:
        """Seconds since any moment."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Let so much time pass."""
        time.sleep(seconds)
