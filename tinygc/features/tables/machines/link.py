"""What a table may answer, how it fails, and the serial line to it."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

import numpy as np

from session.base.errors import CalibrationError, DeviceError
from session.bench.clocks import Clock
from session.bench.port import BUSY, LIST_PORTS, UNPLUGGED, open_serial, reason


class TableFault(DeviceError):
    """The table reports a fault, does not answer, or does not do what it was requested to.  Exit code 3."""


class TableLimit(CalibrationError):
    """A move beyond the table's limits: it is not sent."""


@dataclass(frozen=True, eq=False)
class Where:
    """What a table answers: angles (K,) rad; moving; table_s: its own clock, where it has one."""

    angles: np.ndarray
    moving: bool
    table_s: float | None = None


# The line to a table: bytes out, bytes in.

#: errors of a port that cannot be opened
UNOPENED: tuple[type[Exception], ...] = (*UNPLUGGED, ValueError)
#: at a port: an answer is stamped when it is seen
PORT_POLL_S = 0.001
#: s after which a port that takes no bytes counts as lost
WRITE_S = 1.0


class SerialLink:
    """A serial port, for this process alone.  One thread may write while another reads."""

    def __init__(self, name: str, baud: int, clock: Clock):
        self._name, self._clock = name, clock
        try:
            self._port = open_serial(name, baud)
            self._port.timeout, self._port.write_timeout = 0, WRITE_S
        except UNOPENED as error:
            if getattr(error, "errno", None) in BUSY:
                raise TableFault(f"{name}: another program holds the table's port: Ctrl-C there stops the table; {PRESS}") from None
            raise TableFault(f"{name}: the table's port cannot be opened ({reason(error)}); see {LIST_PORTS}") from None

    def write(self, data: bytes) -> None:
        """Send bytes."""
        try:
            self._port.write(data)  # within WRITE_S; flush would wait without an end for a device that takes nothing
        except UNPLUGGED as error:
            raise self._lost(error) from None

    def read(self, longest_s: float) -> bytes:
        """What has come; wait for the first of it at most that long."""
        end_s = self._clock.now_s() + longest_s
        while True:
            try:
                data = self._port.read(4096)
            except UNPLUGGED as error:
                raise self._lost(error) from None
            if data or self._clock.now_s() >= end_s:
                return bytes(data)
            self._clock.sleep(PORT_POLL_S)

    def close(self) -> None:
        """Close the port."""
        with contextlib.suppress(*UNPLUGGED):
            self._port.close()

    def _lost(self, error: Exception) -> TableFault:
        return TableFault(f"{self._name}: the line to the table is lost ({error}); is the cable in? {PRESS}")


#: what is left to do where nothing can be sent
PRESS = "if the table still moves, press its own emergency stop"
