"""Whether the board that speaks is the one that the recording is of: by its serial number, and by the rate that it states."""

from __future__ import annotations

from session.common.errors import OtherSensor
from session.stream.events import Info

#: 0 is what a firmware sends that knows none
NO_SERIAL = ("", "0")
#: by which the rate that one board states may differ from one connection to the next: three steps of INTERNAL_FREQ_FINE (0.15 % each);
#: two boards are some percent apart, and a board is set to another rate by a factor of two
RATE_WITHIN = 0.005
ANOTHER = "give another sensor another --out"


class SameSensor:
    """``require`` it of each info, in all of a recording, resumed or not: two sensors have two calibrations."""

    def __init__(self) -> None:
        self._serial: str | None = None
        self._connection = self._of = 0  # the present one, and that of the rate
        self._odr_hz: float | None = None

    def new_connection(self) -> None:
        """The port was opened again: whoever speaks may be another."""
        self._connection += 1

    def require(self, info: Info) -> None:
        """OtherSensor where it is another's.  Within a connection no board is swapped, and one that measures its rate may correct it."""
        named = info.serial not in NO_SERIAL
        if named and self._serial not in (None, info.serial):
            raise OtherSensor(f"the board says serial={info.serial}, this recording is of {self._serial}; {ANOTHER}")
        changed = self._odr_hz is not None and abs(info.odr_hz / self._odr_hz - 1) > RATE_WITHIN
        if changed and self._connection != self._of:
            who = "this is another board, or it was set otherwise" if named else "this is another board (it has no serial number)"
            raise OtherSensor(f"the board says odr_hz={info.odr_hz:g}, this recording's {self._odr_hz:g}: {who}; {ANOTHER}")
        self._serial = info.serial if named else self._serial
        self._odr_hz, self._of = info.odr_hz, self._connection
