"""The five verbs of a table: home, turn to an angle, turn at a rate, where are you, stop.

A make implements ``Table``.  A verb that moves starts the motion and returns; ``where`` states when it has ended.  Nothing here moves
without ``Guarded.require_move``: limits are checked before each move, whatever the machine itself would do.
"""

from __future__ import annotations

import contextlib
import threading
from dataclasses import dataclass
from typing import Any

import numpy as np

from session.base.errors import CalibrationError, DeviceError
from session.bench.clocks import Clock
from session.bench.port import BUSY, LIST_PORTS, UNPLUGGED, open_serial, reason
from tinygc.features.tables.machines.description import Description


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


class Table:
    """A machine that is connected.  All verbs raise TableFault where it does not answer, and for a fault that it reports.

    has_rate_mode: whether it turns at a rate by itself; angles_lost: it has restarted, and was not homed since; warning: what whoever lets
    it move must know.
    """

    description: Description
    has_rate_mode = angles_lost = False
    warning = ""

    def home(self) -> None:
        """Begin to search the reference marks of all axes."""
        raise NotImplementedError

    def turn_to(self, axis: int, angle_rad: float, rate_rps: float) -> None:
        """Begin to turn one axis to an angle, at most that fast (above 0)."""
        raise NotImplementedError

    def turn_at(self, axis: int, rate_rps: float) -> None:
        """Begin to turn one axis at a rate with its sign, until another verb; 0 brings it to rest.

        Makes without ``has_rate_mode`` are sent turns to an angle instead.
        """
        raise NotImplementedError

    def where(self) -> Where:
        """Ask for angles and state."""
        raise NotImplementedError

    def stop(self) -> None:
        """Bring all axes to rest at once.  It may be called at any time and from any thread."""
        raise NotImplementedError

    def close(self) -> None:
        """Let go of the port; the table is at rest before."""
        raise NotImplementedError

    # What not every machine has.

    @property
    def begins(self) -> str:
        """What ``begin`` will send, as text; empty where there is nothing, or it was sent."""
        return ""

    def begin(self) -> None:
        """Send what it wants before its first motion, such as to switch its motors on; nothing the second time."""

    def look(self) -> np.ndarray:
        """Angles (K,) rad, whatever else it reports: to see whether it rests."""
        return self.where().angles

    def clear(self) -> None:
        """Clear an alarm, where a program can: only when a person has confirmed it.  TableFault where it stays."""
        raise TableFault(f"{self.description.name}: an alarm of a {self.description.make} is cleared at the machine")

    def forget_alarm(self) -> None:
        """A person has dealt with an alarm at the machine: ask it, and do not repeat what it stated before."""

    def set_zero(self) -> None:
        """A person confirms that every axis stands at its zero."""

    def require_rate(self, axis: int, rate_rps: float) -> None:
        """TableLimit for a rate (either sign) that its requests cannot state."""

    def require_travel(self) -> None:
        """TableLimit where the controller's own settings do not fit the description; TableFault where it does not report them."""


# The line to a table: bytes out, bytes in.  A serial port, or an instrument through VISA.

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


class VisaLink:
    """An instrument by its VISA name (``ASRL/dev/ttyUSB0::INSTR``, ``TCPIP::192.168.0.7::INSTR``); library: as of PyVISA, ``@py``."""

    def __init__(self, name: str, baud: int, library: str):
        try:
            import pyvisa
        except ImportError:
            raise TableFault(f"{name}: a VISA name needs PyVISA; python -m pip install pyvisa pyvisa-py") from None
        self._name, self._lock = name, threading.Lock()
        self._errors: tuple[Any, ...] = (pyvisa.errors.Error, OSError, ValueError)
        self._timeout = pyvisa.constants.StatusCode.error_timeout
        try:
            self._manager = pyvisa.ResourceManager(library)
            self._resource: Any = self._manager.open_resource(name)
            if hasattr(self._resource, "baud_rate"):
                self._resource.baud_rate = baud
        except self._errors as error:
            raise TableFault(f"{name}: VISA cannot open it ({error}); `pyvisa-shell` lists what there is") from None

    def write(self, data: bytes) -> None:
        """Send bytes."""
        with self._lock:
            try:
                self._resource.write_raw(data)
            except self._errors as error:
                raise TableFault(f"{self._name}: the line to the table is lost ({error}); {PRESS}") from None

    def read(self, longest_s: float) -> bytes:
        """What has come, up to its end of line."""
        with self._lock:
            try:
                self._resource.timeout = max(longest_s * 1e3, 1.0)
                return bytes(self._resource.read_raw())
            except self._errors as error:
                if getattr(error, "error_code", None) == self._timeout:
                    return b""
                raise TableFault(f"{self._name}: the line to the table is lost ({error}); {PRESS}") from None

    def close(self) -> None:
        """Close the instrument."""
        with contextlib.suppress(*self._errors):
            self._resource.close()
            self._manager.close()


#: bytes in both directions
Link = SerialLink | VisaLink
