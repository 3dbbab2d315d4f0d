"""A serial port and its one reader thread."""

from __future__ import annotations

import contextlib
import errno
import os
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import serial

from session.common.errors import CalibrationError, DeviceError
from session.recording.ports import identity_of, is_left_behind, name_of

try:
    from termios import error as TerminalError
except ImportError:  # Windows, where pyserial raises nothing of the kind

    class TerminalError(Exception):  # type: ignore[no-redef]  # there is no other on Windows
        """What a POSIX terminal raises."""


#: what pyserial raises when a cable is pulled: SerialException is an OSError, a terminal's own error is none
UNPLUGGED: tuple[type[Exception], ...] = (OSError, serial.SerialException, TerminalError)
HINTS = {
    errno.EACCES: ": your user may not use it; join the group that owns it, usually dialout",
    errno.EAGAIN: ": another program has it open",
    errno.EBUSY: ": another program has it open",
}
LEFT_BEHIND = "the virtual board that made this link runs no more; start it again, or remove the link"
SWITCHED_ON = "the board was switched on again, or has reset itself: it is set again"
READ_S = 0.2
RETRY_S = 0.25


@dataclass(frozen=True)
class Received:
    """Bytes that arrived at host_ns (monotonic clock)."""

    host_ns: int
    data: bytes


@dataclass(frozen=True)
class Opened:
    """The port is open, for the first time or again."""

    host_ns: int
    name: str


@dataclass(frozen=True)
class Closed:
    """The port is gone, and why; the thread tries to open it again."""

    host_ns: int
    why: str


class Port:
    """Reads from construction to ``close``; ``items`` is a queue of Received, Opened, Closed, or of the error that ended it.

    prepare(port) is called each time that the port has been opened; it gives the first bytes of the connection, or raises what ends it.
    forgotten(data) says from where on in what has come the board has to be prepared again, or None: that is another connection.
    keep(item) is called in the reader thread before the item is queued: to store the bytes first.
    DeviceError where the port cannot be opened at the start.
    """

    def __init__(
        self,
        name: str,
        baudrate: int = 921600,
        keep: Callable[[object], None] = lambda item: None,
        prepare: Callable[[serial.Serial], bytes] = lambda port: b"",
        forgotten: Callable[[bytes], int | None] = lambda data: None,
    ):
        self.name, self.baudrate, self._keep, self._prepare, self._forgotten = name, baudrate, keep, prepare, forgotten
        self._first = b""
        self._identity, self._made = identity_of(name), _made(name)
        self.items: queue.SimpleQueue = queue.SimpleQueue()
        self._stop = threading.Event()
        try:
            self._serial = self._open()
        except UNPLUGGED as error:
            raise DeviceError(f"{name}: cannot be opened ({_reason(error)}); see calibrate.py ports") from None
        self._thread = threading.Thread(target=self._read, name="port-reader", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop reading; what was received stays in ``items``."""
        self._stop.set()
        self._thread.join()

    def _open(self) -> serial.Serial:
        if is_left_behind(self.name):  # before it is followed: opening a terminal already changes it
            raise serial.SerialException(LEFT_BEHIND)
        port = serial.Serial(self.name, self.baudrate, timeout=READ_S, exclusive=True)
        try:
            self._first = self._prepare(port)
        except BaseException:
            _close(port)
            raise
        return port

    def _opened(self) -> None:
        self._hand_over(Opened(time.monotonic_ns(), self.name))
        first, self._first = self._first, b""
        if first:
            self._hand_over(Received(time.monotonic_ns(), first))

    def _hand_over(self, item: object) -> None:
        self._keep(item)
        self.items.put(item)

    def _read(self) -> None:
        try:
            self._opened()
            while not self._stop.is_set():
                try:
                    data = self._serial.read(max(1, self._serial.in_waiting))
                except UNPLUGGED as error:
                    self._hand_over(Closed(time.monotonic_ns(), _reason(error)))
                    self._reopen()
                    continue
                place = self._forgotten(data) if data else None
                if data := data[:place]:
                    self._hand_over(Received(time.monotonic_ns(), data))
                if place is not None:
                    self._hand_over(Closed(time.monotonic_ns(), SWITCHED_ON))
                    self._again()
        except CalibrationError as error:
            self.items.put(error)
        finally:
            _close(self._serial)

    def _again(self) -> None:
        """Prepare a board that was switched on again, its port open all the time; a cable may be pulled meanwhile."""
        try:
            self._first = self._prepare(self._serial)
        except UNPLUGGED as error:
            self._hand_over(Closed(time.monotonic_ns(), _reason(error)))
            self._reopen()
            return
        self._opened()

    def _reopen(self) -> None:
        _close(self._serial)
        while not self._stop.wait(RETRY_S):
            if self._made is not None and _made(self.name) != self._made:
                continue
            try:
                self._serial = self._open()
            except UNPLUGGED:
                # A board that comes back may come back as another device: ttyACM1 for ttyACM0.
                self.name = name_of(self._identity) or self.name
                continue
            self._opened()
            return


def _made(name: str) -> int | None:
    """When a pseudo-terminal was made, which tells it from the next of its number; None for anything else.

    That number is given again at once, to any program or person on this computer.  A name that links to one may come back with another.
    """
    path = Path(name)
    with contextlib.suppress(OSError):
        return path.stat().st_ctime_ns if path.is_relative_to("/dev/pts") and not path.is_symlink() else None
    return 0


def _close(port: serial.Serial) -> None:
    with contextlib.suppress(*UNPLUGGED):
        port.close()


def _reason(error: Exception) -> str:
    """What happened, in the system's words, and what to do where that is known."""
    number = error.args[0] if isinstance(error, TerminalError) else getattr(error, "errno", None)
    if not isinstance(number, int):
        return str(error)
    return os.strerror(number) + HINTS.get(number, "")
