"""Serial ports: list them, read one in its own thread, and apply the requested settings to the board behind it."""

from __future__ import annotations

import contextlib
import errno
import os
import queue
import tempfile
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import serial
from serial.tools import list_ports

from session.base.errors import CalibrationError, DeviceError
from session.base.texts import command_line
from session.bench import frames
from session.bench.decoder import StreamDecoder
from session.bench.events import STANDIN, BoardStatus, Event, Info
from session.bench.rawfile import is_locked

if TYPE_CHECKING:
    from serial.tools.list_ports_common import ListPortInfo


ST_VENDOR = 0x0483
#: ST's USB product ids and their names, from usb.ids
ST_PRODUCTS = {
    0x3744: "ST-LINK/V1",
    0x3748: "ST-LINK/V2",
    0x374A: "ST-LINK/V2-1",
    0x374B: "ST-LINK/V2-1",
    0x374D: "ST-LINK/V3 loader",
    0x374E: "ST-LINK/V3",
    0x374F: "ST-LINK/V3",
    0x3752: "ST-LINK/V2-1",
    0x3753: "ST-LINK/V3",
    0x3754: "ST-LINK/V3",
    0x5740: "STM32 virtual COM port",
    0xDF11: "STM32 in its boot loader: no stream comes from it",
}
#: the command that lists the ports
LIST_PORTS = command_line("record", "--port", "list")
#: links of this project's virtual boards, in the temporary folder
VIRTUAL_STEM = "tinygc-board"


@dataclass(frozen=True)
class KnownPort:
    """A serial port of this computer."""

    name: str  #: for ``--port``
    what: str
    is_candidate: bool  #: whether a board may be behind it
    usb: tuple[int, int] | None = None  #: vendor, product
    serial_number: str | None = None


def known_ports() -> list[KnownPort]:
    """Ports of this computer, candidates first, ST's boards before others."""
    ports = [_known(port) for port in list_ports.comports()]
    ports += [KnownPort(str(path), "virtual board (calibrate.py board)", True) for path in virtual_boards()]
    return sorted(ports, key=lambda port: (not port.is_candidate, port.usb is None or port.usb[0] != ST_VENDOR, port.name))


def virtual_boards() -> list[Path]:
    """Links of the virtual boards that run on this computer (``calibrate.py board``)."""
    return sorted(path for path in Path(tempfile.gettempdir()).glob(f"{VIRTUAL_STEM}*") if path.is_symlink() and is_locked(lock_of(path)))


def lock_of(link: Path) -> Path:
    """The file that a running virtual board locks: the link of a killed one may lead to another program's terminal by now."""
    return link.with_name(link.name + ".lock")


def is_virtual(name: str) -> bool:
    """Whether a running virtual board, whose clock need not be real time, is behind a port's name."""
    link = Path(name)
    return link.is_symlink() and lock_of(link).exists() and is_locked(lock_of(link))


def is_left_behind(name: str) -> bool:
    """Whether a port's name is the link of a virtual board that no longer runs.  Links of other programs (``socat``) have no lock."""
    link = Path(name)
    if not link.is_symlink():
        return False
    usual = link.name.startswith(VIRTUAL_STEM) and link.parent.resolve() == Path(tempfile.gettempdir()).resolve()
    return (usual or lock_of(link).exists()) and not is_locked(lock_of(link))


def only_candidate() -> KnownPort:
    """The only port with a board; DeviceError where there is none, or more than one."""
    candidates = [port for port in known_ports() if port.is_candidate]
    if not candidates:
        virtual = command_line("board")
        raise DeviceError(f"no serial port with a board; plug it in, give --port (list: all), or start a virtual one: {virtual}")
    boards = [port for port in candidates if port.usb and port.usb[0] == ST_VENDOR] or candidates
    if len(boards) > 1:
        raise DeviceError(f"more than one port may be the board: {', '.join(port.name for port in candidates)}; choose with --port")
    return boards[0]


def _known(port: ListPortInfo) -> KnownPort:
    if port.vid is None:
        what = port.description if port.description not in (None, "n/a") else "no USB device"
        return KnownPort(port.device, what, False)
    what = " ".join(filter(None, (port.manufacturer, port.product))) or port.description
    if port.vid == ST_VENDOR:
        what = f"ST board: {ST_PRODUCTS.get(port.pid, what or 'unknown product')}"
    is_candidate = (port.vid, port.pid) != (ST_VENDOR, 0xDF11)
    return KnownPort(port.device, what, is_candidate, (port.vid, port.pid), port.serial_number)


try:
    from termios import error as TerminalError
except ImportError:  # Windows, where pyserial raises nothing of the kind

    class TerminalError(Exception):  # type: ignore[no-redef]  # there is no other on Windows
        """The error of a POSIX terminal."""


#: errors of a port whose cable is pulled: SerialException is an OSError, a terminal's own error is not
UNPLUGGED: tuple[type[Exception], ...] = (OSError, serial.SerialException, TerminalError)
#: of a port that another program has opened
BUSY = (errno.EAGAIN, errno.EBUSY)
HINTS = {
    errno.EACCES: ": your user may not use it; join the group that owns it, usually dialout",
    **dict.fromkeys(BUSY, ": another program has it open"),
}
LEFT_BEHIND = "the virtual board that made this link runs no more; start it again, or remove the link"
SWITCHED_ON = "the board was switched on again, or has reset itself: it is set again"
READ_S = 0.2
RETRY_S = 0.25


#: host_ns (monotonic clock), and the bytes that arrived then, or an event: ``open`` with the port's name, ``close`` with why (the thread
#: tries to open it again); or the error that ended it all
Arrival = tuple[int, Any]


def open_serial(name: str, baudrate: int) -> serial.Serial:
    """Open a port for this process alone.  Raises one of ``UNPLUGGED``."""
    if is_left_behind(name):  # not followed: opening a terminal already changes it
        raise serial.SerialException(LEFT_BEHIND)
    return serial.Serial(name, baudrate, timeout=READ_S, exclusive=True)


class Port:
    """Reads from construction to ``close``; ``items`` is a queue of arrivals.

    keep(item) is called in the reader thread before the item is queued, to store the bytes first.  setup, if given, is called with the port
    each time that it has been opened, and returns the first bytes of the connection; ``setup.forgotten`` finds where the board has
    restarted, which begins another connection.  DeviceError where the port cannot be opened at the start.
    """

    def __init__(self, name: str, baudrate: int = 921600, keep: Callable[[Arrival], None] | None = None, setup: BoardSetup | None = None):
        self.name, self.baudrate, self._keep, self._setup = name, baudrate, keep, setup
        self._first = b""
        # Vendor, product and serial number of a USB device, which it keeps under another name; None without a serial number.
        port = next((port for port in list_ports.comports() if port.device == name), None)
        self._identity, self._made = (port.vid, port.pid, port.serial_number) if port and port.serial_number else None, _made(name)
        self.items: queue.SimpleQueue = queue.SimpleQueue()
        self._stop = threading.Event()
        try:
            self._serial = self._open()
        except UNPLUGGED as error:
            raise DeviceError(f"{name}: {reason(error)}; see record --port list") from None
        self._thread = threading.Thread(target=self._read, name="port-reader", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop reading; received bytes stay in ``items``."""
        self._stop.set()
        self._thread.join()

    def _open(self) -> serial.Serial:
        port = open_serial(self.name, self.baudrate)
        try:
            self._first = self._setup(port) if self._setup else b""
        except BaseException:
            _close(port)
            raise
        return port

    def _opened(self) -> None:
        self._hand_over(Event("open", text=self.name))
        first, self._first = self._first, b""
        if first:
            self._hand_over(first)

    def _closed(self, why: str) -> None:
        self._hand_over(Event("close", text=why))

    def _hand_over(self, what: bytes | Event) -> None:
        item = time.monotonic_ns(), what
        if self._keep is not None:
            self._keep(item)
        self.items.put(item)

    def _read(self) -> None:
        try:
            self._opened()
            while not self._stop.is_set():
                try:
                    self._read_once()
                except UNPLUGGED as error:
                    self._closed(reason(error))
                    self._reopen()
        except CalibrationError as error:
            self.items.put((time.monotonic_ns(), error))
        finally:
            _close(self._serial)

    def _read_once(self) -> None:
        data = self._serial.read(max(1, self._serial.in_waiting))
        place = self._setup.forgotten(data) if data and self._setup else None
        if data := data[:place]:
            self._hand_over(data)
        if place is not None and self._setup:
            self._closed(SWITCHED_ON)
            self._first = self._setup(self._serial)
            self._opened()

    def _reopen(self) -> None:
        _close(self._serial)
        while not self._stop.wait(RETRY_S):
            if self._made is not None and _made(self.name) != self._made:
                continue
            try:
                self._serial = self._open()
            except UNPLUGGED:
                # The board may return as another device: ttyACM1 for ttyACM0.
                ports = list_ports.comports() if self._identity is not None else ()
                mine = (port.device for port in ports if (port.vid, port.pid, port.serial_number) == self._identity)
                self.name = next(mine, self.name)
                continue
            self._opened()
            return


def _made(name: str) -> int | None:
    """Creation time of a pseudo-terminal, which distinguishes it from the next of its number; None for anything else.

    The system gives that number to another program at once.  A name that links to a pseudo-terminal may return with another one.
    """
    path = Path(name)
    with contextlib.suppress(OSError):
        return path.stat().st_ctime_ns if path.is_relative_to("/dev/pts") and not path.is_symlink() else None
    return 0


def _close(port: serial.Serial) -> None:
    with contextlib.suppress(*UNPLUGGED):
        port.close()


def reason(error: Exception) -> str:
    """The system's message, and what to do where that is known."""
    for each in (error, error.__context__):  # of a terminal's error the library repeats the text alone
        number = each.args[0] if isinstance(each, TerminalError) else getattr(each, "errno", None)
        if isinstance(number, int):
            return os.strerror(number) + HINTS.get(number, "")
    return str(error)


# A board that takes commands gets the requested settings each time that its port is opened; one that takes none is only listened to.

#: a board with commands sends its status each second
SPEAKS_S = 2.5
#: to wait for an answer: a start takes 0.03 s, a self-test 1.3; a lost command is sent again
ANSWER_S, TRIES = 3.5, 2
#: both divide the STM32F405's 84 MHz exactly
FASTER = (2_000_000, 3_000_000)
#: relative: the board accepts a nominal rate that is so near; a true rate is within 19 % of its nominal one, the next is half or double
RATE_WITHIN, TRUE_RATE_WITHIN = 0.05, 0.25
#: a board that differs sooner than this after it was set has refused the setting
MEANS_IT_S = 5.0
FINE_STEP = 0.0015  #: of the data rate, for each step of INTERNAL_FREQ_FINE
RATES = "12.5, 26, 52, 104, 208, 417, 833, 1667, 3333, 6667 Hz"


class BoardSetup:
    """Applies the requested settings (``odr_hz``, ``gyro_fs_dps``, ``accel_fs_g``; None: as it is) to the board of an open port.

    Called with the port, it returns the bytes that belong to the recording: all where the board takes no commands, else none of those
    before it was set.  CalibrationError where the board refuses, DeviceError where it does not answer.  ``forgotten`` checks the later
    bytes: a board that was switched on again while its port was open has its default settings.
    """

    def __init__(self, wanted: Mapping[str, float | None]):
        self._wanted = {name: value for name, value in wanted.items() if value is not None}
        self.applied: list[str] = []  #: what was set, in words
        self._set_s: float | None = None  # when a board was set
        self._cut = b""  # possibly the beginning of a frame

    @property
    def speaks(self) -> bool:
        """Whether the board was set, and so sends its status each second."""
        return self._set_s is not None

    def forgotten(self, data: bytes) -> int | None:
        """Where in the next bytes the board reports other settings; None: nowhere."""
        if self._set_s is None:
            return None
        whole, before, place = self._cut + data, len(self._cut), 0
        *blocks, self._cut = whole.split(b"\0")
        self._cut = self._cut[-frames.INFO_BYTES :]
        for block in blocks:
            if len(block) == frames.INFO_BYTES and self._differs(block):
                if time.monotonic() - self._set_s < MEANS_IT_S:
                    self._set_s = None
                    return None
                self._cut = b""
                return max(0, place - before)
            place += len(block) + 1
        return None

    def _differs(self, block: bytes) -> bool:
        bodies, good = frames.decode_blocks(np.frombuffer(block, np.uint8)[None])
        info = frames.decode_info(bodies[0].tobytes()) if good.all() and bodies[0, 0] == frames.INFO_TYPE else None
        if info is None:
            return False
        wanted = vars(info) | self._wanted
        if abs(info.odr_hz / wanted["odr_hz"] - 1) > TRUE_RATE_WITHIN:
            return True
        return (wanted["gyro_fs_dps"], wanted["accel_fs_g"]) != (info.gyro_fs_dps, info.accel_fs_g)

    def __call__(self, port: serial.Serial) -> bytes:
        """Takes at most some seconds for each step."""
        if not self._wanted:
            return b""
        self.applied, self._set_s, self._cut = [], None, b""
        talk = _Dialogue(port)
        talk.listen(lambda: talk.board is not None or talk.is_mute, SPEAKS_S)
        own_baud = port.baudrate
        for baud in FASTER:  # an earlier recording may have set one
            if talk.decoder.taken and talk.decoder.mode is None and not talk.decoder.samples:
                port.baudrate = baud
                talk.listen(lambda: talk.board is not None or talk.is_mute, SPEAKS_S)
        if talk.board is None:
            port.baudrate = own_baud
            return bytes(talk.heard)
        self._set(talk)
        self._set_s = time.monotonic()
        return b""

    def _set(self, talk: _Dialogue) -> None:
        wanted, board = self._wanted, talk.board
        assert board is not None
        odr_hz = wanted.get("odr_hz")
        if odr_hz is not None and (board.source == STANDIN or abs(odr_hz / board.odr_hz - 1) > RATE_WITHIN):
            needed = frames.least_baud(odr_hz * (1 + FINE_STEP * board.freq_fine))
            if board.baud < needed:
                self._raise_baud(talk, next((baud for baud in FASTER if baud >= needed), FASTER[-1]))
            talk.command(frames.DATA_RATE, f"--odr {odr_hz:g}", odr_hz, hint=f"the data rates are {RATES}")
            self.applied.append(f"data rate {odr_hz:g} Hz")
        talk.listen(lambda: talk.info is not None, ANSWER_S)
        if (info := talk.info) is None:
            raise DeviceError("the board does not send its ranges; switch it off and on")
        gyro_fs, accel_fs = wanted.get("gyro_fs_dps", info.gyro_fs_dps), wanted.get("accel_fs_g", info.accel_fs_g)
        if board.source == STANDIN or (gyro_fs, accel_fs) != (info.gyro_fs_dps, info.accel_fs_g):
            what = f"--gyro-fs {gyro_fs:g} --accel-fs {accel_fs:g}"
            hint = "the ranges are 125, 250, 500, 1000, 2000, 4000 dps and 2, 4, 8, 16 g"
            if gyro_fs % 1 or accel_fs % 1 or max(gyro_fs, accel_fs) > 0xFFFF:
                raise CalibrationError(f"{what}: {frames.REFUSALS[frames.IMPOSSIBLE]}; {hint}")
            talk.command(frames.RANGES, what, int(gyro_fs), int(accel_fs), hint=hint)
            self.applied.append(f"ranges {gyro_fs:g} dps, {accel_fs:g} g")

    def _raise_baud(self, talk: _Dialogue, baud: int) -> None:
        talk.command(frames.BAUD, f"{baud} baud", baud)
        talk.port.baudrate = baud
        try:
            talk.command(frames.IDENTIFY, f"{baud} baud")
        except DeviceError:
            raise DeviceError(
                f"nothing is heard at the {baud} baud that this data rate needs: the port or its adapter does not do them; a lower --odr"
            ) from None
        self.applied.append(f"{baud} baud")


class _Dialogue:
    """A dialogue with the board.  heard: all bytes so far; board, info: the last of each; is_mute: whether the board takes no commands."""

    def __init__(self, port: serial.Serial):
        self.port, self.decoder, self.heard = port, StreamDecoder(), bytearray()
        self.board: BoardStatus | None = None
        self.info: Info | None = None
        self._infos = self._sequence = 0
        self._sent: tuple[int, int] | None = None  # sequence and command
        self._answer: int | None = None  # to it

    @property
    def is_mute(self) -> bool:
        return (self.decoder.mode == "text" and self.decoder.samples > 0) or (self.board is None and self._infos > 1)

    def listen(self, enough: Callable[[], bool], seconds: float) -> bool:
        """Read until enough has come, at most so long; returns whether it has."""
        until_s = time.monotonic() + seconds
        while not enough() and time.monotonic() < until_s:
            data = self.port.read(max(1, self.port.in_waiting))
            self.heard += data
            for event in self.decoder.feed(data):
                if isinstance(event, BoardStatus):
                    self.board = event
                elif isinstance(event, Info):
                    self.info, self._infos = event, self._infos + 1
                elif isinstance(event, Event) and event.kind == "done" and event.numbers[:2] == self._sent:
                    self._answer = int(event.numbers[2])
        return enough()

    def command(self, kind: int, what: str, *values: float, hint: str = "") -> None:
        """Send a command and wait for its answer."""
        for _ in range(TRIES):
            self._sequence += 1
            self._answer, self._sent = None, (self._sequence, kind)
            self.port.write(frames.encode_command(kind, self._sequence, *values))
            self.listen(lambda: self._answer is not None, ANSWER_S)
            if self._answer == frames.DONE:
                return
            if self._answer is not None:
                why = frames.REFUSALS.get(self._answer, f"result {self._answer}")
                more = f"; {hint}" if hint and self._answer == frames.IMPOSSIBLE else ""
                raise CalibrationError(f"the board refuses {what}: {why}{more}")
        raise DeviceError(f"the board does not answer ({what}); is its receive line (PA10) connected? else switch it off and on")
