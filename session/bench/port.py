"""Serial ports: which there are, the one that is read by its own thread, and the settings of the board behind it."""

from __future__ import annotations

import contextlib
import errno
import os
import queue
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import serial
from serial.tools import list_ports

from session.bench import frames
from session.bench import frames as commands
from session.bench.decoder import StreamDecoder
from session.bench.events import STANDIN, BoardStatus, CommandResult, Event, Info
from session.bench.rawfile import is_locked
from session.io.errors import CalibrationError, DeviceError

if TYPE_CHECKING:
    from serial.tools.list_ports_common import ListPortInfo


# Serial ports of this machine, and what is known of each.

ST_VENDOR = 0x0483
#: USB ids -> what they are; ST's product ids from its usb.ids entries
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
#: links of this project's virtual boards, in the temporary folder
VIRTUAL_STEM = "tinygc-board"


@dataclass(frozen=True)
class KnownPort:
    """name: what ``--port`` takes; is_candidate: whether a board may be behind it; usb: (vendor, product), serial number: or None."""

    name: str
    what: str
    is_candidate: bool
    usb: tuple[int, int] | None = None
    serial_number: str | None = None


def known_ports() -> list[KnownPort]:
    """Ports of this machine, candidates first, ST's boards before others."""
    ports = [_known(port) for port in list_ports.comports()] + [_virtual(path) for path in virtual_boards()]
    return sorted(ports, key=lambda port: (not port.is_candidate, port.usb is None or port.usb[0] != ST_VENDOR, port.name))


def virtual_boards() -> list[Path]:
    """Links of the virtual boards that run on this machine (``calibrate.py board``); none where the system has no such thing."""
    return sorted(path for path in Path(tempfile.gettempdir()).glob(f"{VIRTUAL_STEM}*") if path.is_symlink() and is_locked(lock_of(path)))


def lock_of(link: Path) -> Path:
    """The file that a running board holds locked: a link that a killed one left may lead to somebody's terminal by now."""
    return link.with_name(link.name + ".lock")


def is_virtual(name: str) -> bool:
    """Whether a virtual board that runs now is behind a port's name: its time is its own."""
    link = Path(name)
    return link.is_symlink() and lock_of(link).exists() and is_locked(lock_of(link))


def is_left_behind(name: str) -> bool:
    """Whether a port's name is the link of a virtual board that does not run any more.

    Links of other programs (``socat``) have no lock, and are what they are.
    """
    link = Path(name)
    if not link.is_symlink():
        return False
    usual = link.name.startswith(VIRTUAL_STEM) and link.parent.resolve() == Path(tempfile.gettempdir()).resolve()
    return (usual or lock_of(link).exists()) and not is_locked(lock_of(link))


def only_candidate() -> KnownPort:
    """The one port that a board may be behind; DeviceError lists the candidates where there is none or more than one."""
    candidates = [port for port in known_ports() if port.is_candidate]
    if not candidates:
        raise DeviceError("no serial port with a board; plug it in (calibrate.py ports lists what there is), or give --port")
    boards = [port for port in candidates if port.usb and port.usb[0] == ST_VENDOR] or candidates
    if len(boards) > 1:
        raise DeviceError(f"more than one port may be the board: {', '.join(port.name for port in candidates)}; choose with --port")
    return boards[0]


def identity_of(name: str) -> tuple | None:
    """What a USB device keeps when it comes back under another name: vendor, product, serial number; None where it has none."""
    port = next((port for port in list_ports.comports() if port.device == name), None)
    return (port.vid, port.pid, port.serial_number) if port and port.serial_number else None


def name_of(identity: tuple | None) -> str | None:
    """The port that a USB device has now, or None."""
    if identity is None:
        return None
    return next((port.device for port in list_ports.comports() if (port.vid, port.pid, port.serial_number) == identity), None)


def _known(port: ListPortInfo) -> KnownPort:
    if port.vid is None:
        what = port.description if port.description not in (None, "n/a") else "no USB device"
        return KnownPort(port.device, what, False)
    said = " ".join(filter(None, (port.manufacturer, port.product))) or port.description
    what = f"ST board: {ST_PRODUCTS.get(port.pid, said or 'unknown product')}" if port.vid == ST_VENDOR else said
    is_candidate = (port.vid, port.pid) != (ST_VENDOR, 0xDF11)
    return KnownPort(port.device, what, is_candidate, (port.vid, port.pid), port.serial_number)


def _virtual(path: Path) -> KnownPort:
    return KnownPort(str(path), "virtual board (calibrate.py board)", True)


# A serial port and its one reader thread.

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


# A board that takes commands is set as the user wants it, each time that its port is opened; one that takes none is only listened to.

#: a board that speaks says so each second
SPEAKS_S = 2.5
#: for an answer: the slowest filters settle in 2.1 s; a command that was lost is sent again
ANSWER_S, TRIES = 3.5, 2
#: both divide the STM32F405's 84 MHz exactly
FASTER = (2_000_000, 3_000_000)
#: the board takes the nominal rate that is so near; a true rate is within 19 % of its nominal one, the next is half or double
RATE_WITHIN, TRUE_RATE_WITHIN = 0.05, 0.25
#: a board that says otherwise sooner than this after it was set means it
MEANS_IT_S = 5.0
FINE_STEP = 0.0015  #: of the data rate, for each step of INTERNAL_FREQ_FINE
RATES = "12.5, 26, 52, 104, 208, 417, 833, 1667, 3333, 6667 Hz"


@dataclass(frozen=True)
class RequestedSettings:
    """What the user wants of the board; None: as it is."""

    odr_hz: float | None = None
    gyro_fs_dps: float | None = None
    accel_fs_g: float | None = None

    @property
    def anything(self) -> bool:
        """Whether there is something to be set."""
        return any(value is not None for value in (self.odr_hz, self.gyro_fs_dps, self.accel_fs_g))


class BoardSetup:
    """Called with an open port; gives the bytes that belong to the recording: all where the board takes no commands, else none of those
    before it was set.  said: what was done, in words.  CalibrationError where the board refuses, DeviceError where it does not answer.

    ``forgotten`` hears what the board sends: one that was switched on again meanwhile, its port open all the time, is as it was made."""

    def __init__(self, wanted: RequestedSettings):
        self._wanted = wanted
        self.said: list[str] = []
        self._set_s: float | None = None  # when a board was set
        self._cut = b""  # what may be the beginning of a frame

    @property
    def speaks(self) -> bool:
        """Whether the board was set: such a one says what it is each second."""
        return self._set_s is not None

    def forgotten(self, data: bytes) -> int | None:
        """Where in these bytes, the next that came, the board says that it is not set as it was; None: nowhere."""
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
        wanted = self._wanted
        rate = wanted.odr_hz is not None and abs(info.odr_hz / wanted.odr_hz - 1) > TRUE_RATE_WITHIN
        ranges = ((wanted.gyro_fs_dps, info.gyro_fs_dps), (wanted.accel_fs_g, info.accel_fs_g))
        return rate or any(asked is not None and asked != said for asked, said in ranges)

    def __call__(self, port: serial.Serial) -> bytes:
        """Bounded: some seconds for each step."""
        if not self._wanted.anything:
            return b""
        self.said, self._set_s, self._cut = [], None, b""
        talk = _Dialogue(port)
        talk.listen(lambda: talk.board is not None or talk.is_mute, SPEAKS_S)
        own_baud = port.baudrate
        for baud in FASTER:  # as an earlier recording has left it
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
        if wanted.odr_hz is not None and (board.source == STANDIN or abs(wanted.odr_hz / board.odr_hz - 1) > RATE_WITHIN):
            needed = commands.least_baud(wanted.odr_hz * (1 + FINE_STEP * board.freq_fine))
            if board.baud < needed:
                self._raise_baud(talk, next((baud for baud in FASTER if baud >= needed), FASTER[-1]))
            talk.ask(commands.DATA_RATE, f"--odr {wanted.odr_hz:g}", wanted.odr_hz, hint=f"the data rates are {RATES}")
            self.said.append(f"data rate {wanted.odr_hz:g} Hz")
        talk.listen(lambda: talk.info is not None, ANSWER_S)
        if (info := talk.info) is None:
            raise DeviceError("the board does not say its ranges; switch it off and on")
        gyro_fs, accel_fs = wanted.gyro_fs_dps or info.gyro_fs_dps, wanted.accel_fs_g or info.accel_fs_g
        if board.source == STANDIN or (gyro_fs, accel_fs) != (info.gyro_fs_dps, info.accel_fs_g):
            what = f"--gyro-fs {gyro_fs:g} --accel-fs {accel_fs:g}"
            hint = "the ranges are 125, 250, 500, 1000, 2000, 4000 dps and 2, 4, 8, 16 g"
            if gyro_fs % 1 or accel_fs % 1 or max(gyro_fs, accel_fs) > 0xFFFF:
                raise CalibrationError(f"{what}: {commands.REFUSALS[commands.IMPOSSIBLE]}; {hint}")
            talk.ask(commands.RANGES, what, int(gyro_fs), int(accel_fs), hint=hint)
            self.said.append(f"ranges {gyro_fs:g} dps, {accel_fs:g} g")

    def _raise_baud(self, talk: _Dialogue, baud: int) -> None:
        talk.ask(commands.BAUD, f"{baud} baud", baud)
        talk.port.baudrate = baud
        try:
            talk.ask(commands.IDENTIFY, f"{baud} baud")
        except DeviceError:
            raise DeviceError(
                f"nothing is heard at the {baud} baud that this data rate needs: the port or its adapter does not do them; a lower --odr"
            ) from None
        self.said.append(f"{baud} baud")


class _Dialogue:
    """heard: all bytes so far; board, info: the last of each; is_mute: whether it is plain by now that the board takes no commands."""

    def __init__(self, port: serial.Serial):
        self.port, self.decoder, self.heard = port, StreamDecoder(), bytearray()
        self.board: BoardStatus | None = None
        self.info: Info | None = None
        self._infos = self._sequence = 0
        self._asked: tuple[int, int] | None = None  # sequence and command
        self._answer: int | None = None  # to it

    @property
    def is_mute(self) -> bool:
        return (self.decoder.mode == "text" and self.decoder.samples > 0) or (self.board is None and self._infos > 1)

    def listen(self, enough: Callable[[], bool], seconds: float) -> bool:
        """Until enough has come, at most so long; whether it has."""
        until_s = time.monotonic() + seconds
        while not enough() and time.monotonic() < until_s:
            data = self.port.read(max(1, self.port.in_waiting))
            self.heard += data
            for event in self.decoder.feed(data):
                self._take(event)
        return enough()

    def ask(self, command: int, what: str, *values: float, hint: str = "") -> None:
        """Send a command and wait for its answer."""
        for _ in range(TRIES):
            self._sequence += 1
            self._answer, self._asked = None, (self._sequence, command)
            self.port.write(commands.encode_command(command, self._sequence, *values))
            self.listen(lambda: self._answer is not None, ANSWER_S)
            if self._answer == commands.DONE:
                return
            if self._answer is not None:
                why = commands.REFUSALS.get(self._answer, f"result {self._answer}")
                more = f"; {hint}" if hint and self._answer == commands.IMPOSSIBLE else ""
                raise CalibrationError(f"the board refuses {what}: {why}{more}")
        raise DeviceError(f"the board does not answer ({what}); is its receive line (PA10) connected? else switch it off and on")

    def _take(self, event: Event) -> None:
        if isinstance(event, BoardStatus):
            self.board = event
        elif isinstance(event, Info):
            self.info, self._infos = event, self._infos + 1
        elif isinstance(event, CommandResult) and (event.sequence, event.command) == self._asked:
            self._answer = event.result
