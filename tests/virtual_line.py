"""The line to a virtual table in this process, and a clock that turns on by itself."""

from __future__ import annotations

import threading
from typing import Protocol

from session.annexes.machines.clocks import Clock
from session.annexes.machines.wire import PRESS, LineLost

#: s between two looks for bytes
POLL_S = 0.01


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


class Device(Protocol):
    """A virtual device, such as a ``VirtualTable``."""

    @property
    def is_connected(self) -> bool:
        """Whether the cable is in."""
        ...

    def feed(self, data: bytes = b"") -> bytes:
        """Take what was sent; what is received by now."""
        ...


class VirtualLink:
    """A virtual device in this process: what is sent is answered at once, and waiting turns its clock on."""

    def __init__(self, device: Device, clock: Clock):
        self.device, self._clock = device, clock
        self._lock, self._received = threading.Lock(), b""
        #: everything that was sent, for tests
        self.sent = b""

    def write(self, data: bytes) -> None:
        """Send bytes."""
        self._feed(data)

    def read(self, longest_s: float) -> bytes:
        """What has come."""
        end_s = self._clock.now_s() + longest_s
        while True:
            self._feed(b"")
            with self._lock:
                data, self._received = self._received, b""
            if data or self._clock.now_s() >= end_s:
                return data
            self._clock.sleep(POLL_S)

    def close(self) -> None:
        """Nothing is held."""

    def _feed(self, data: bytes) -> None:
        with self._lock:
            self.sent += data
            self._received += self.device.feed(data)
        if not self.device.is_connected:
            raise LineLost(f"the line to the table is lost (virtual cable); is the cable in? {PRESS}")
