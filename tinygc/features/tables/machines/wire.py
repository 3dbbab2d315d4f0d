"""The line to a table: bytes out, bytes in.  A serial port, or an instrument through VISA."""

from __future__ import annotations

import contextlib
import threading
from typing import Any

from session.bench.clocks import Clock
from session.bench.port import BUSY, LIST_PORTS, UNPLUGGED, open_serial, reason
from tinygc.features.tables.machines.verbs import TableFault

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
