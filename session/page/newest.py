"""What one browser has yet to be sent: of each kind of event the newest alone, so that a slow one costs nothing."""

from __future__ import annotations

import threading


class Newest:
    """Filled by the recording, which never waits for it; emptied by the thread of one browser."""

    def __init__(self) -> None:
        self._there = threading.Condition()
        self._waiting: dict[str, bytes] = {}
        self._closed = False

    def put(self, event: str, data: bytes) -> None:
        """What is older of the same kind is not sent any more."""
        with self._there:
            self._waiting[event] = data
            self._there.notify()

    def close(self) -> None:
        """Nothing comes any more; what waits is still sent."""
        with self._there:
            self._closed = True
            self._there.notify()

    def take(self, timeout_s: float) -> dict[str, bytes] | None:
        """All that waits; empty after so long without any; None at the end."""
        with self._there:
            if not self._waiting and not self._closed:
                self._there.wait(timeout_s)
            taken, self._waiting = self._waiting, {}
            return None if self._closed and not taken else taken
