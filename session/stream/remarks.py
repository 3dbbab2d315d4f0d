"""How much a board may do beside sending samples: a few words now and then, and a few changes between text and frames, not a flood."""

from __future__ import annotations

#: comments, headers and info frames that may come in a row
MOST = 256
#: readings after which there may be one more
EACH = 8


class Remarks:
    """``spend`` one for each remark, ``earn`` with each reading.  What is beyond it is passed over; the raw bytes hold it."""

    def __init__(self) -> None:
        self._credit = MOST * EACH

    def earn(self, readings: int) -> None:
        """So many readings have come."""
        self._credit = min(MOST * EACH, self._credit + readings)

    def spend(self) -> bool:
        """Whether there may be one more."""
        if self._credit < EACH:
            return False
        self._credit -= EACH
        return True


#: changes of mode that may follow each other at once, and bytes after which there may be one more
CHANGES, CHANGE_BYTES = 16, 8192


class Changes:
    """Of mode, between text and frames: from ``earliest`` on, a place in the stream, there may be another."""

    def __init__(self) -> None:
        self._paid = 0

    @property
    def earliest(self) -> int:
        """Bytes from the beginning of the connection."""
        return self._paid - (CHANGES - 1) * CHANGE_BYTES

    def change(self, place: int) -> None:
        """There was one."""
        self._paid = max(self._paid, place) + CHANGE_BYTES
