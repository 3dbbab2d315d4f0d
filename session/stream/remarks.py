"""How much a board may say beside its samples: a few words now and then, not a flood of them."""

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
