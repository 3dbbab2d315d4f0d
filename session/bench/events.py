"""What a stream says: the form of its columns, what the board says of itself, and events in order."""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from session.io.texts import SENSOR_NAME, STANDIN_NAME
from session.io.units import BEYOND, DEG, G

# What the columns of a text stream are: a sensor's registers, or numbers in physical units, as its header says (docs/formats.md).

COLUMNS = ("t_us", "gx", "gy", "gz", "ax", "ay", "az", "temp")
HEADER = ",".join(COLUMNS)
#: us per unit of a time column
TIME_US = {"t_us": 1.0, "t_s": 1e6, "t_ns": 1e-3}
#: of a step that is doubted beside damage (``steps``), one sample period long: 0.8 % of ±2000 dps, 1.6 % of ±16 g, degC
BARS = {"dps": 16.0, "rps": 16.0 * DEG, "g": 0.25, "mps2": 0.25 * G, "c": 0.25}
#: SI per unit
SI = {"dps": DEG, "rps": 1.0, "g": G, "mps2": 1.0, "c": 1.0}
#: the same of registers, LSB: gyro 0.8 % of full scale, accelerometer 1.6 %, temperature 0.25 degC of an ASM330LHH
REGISTER_BARS = np.array([256, 256, 256, 512, 512, 512, 64], np.int64)


@dataclass(frozen=True)
class StreamFormat:
    """names of the log's columns as the header has them: time, rates, forces, and the temperature where there is one."""

    names: tuple[str, ...] = COLUMNS

    @property
    def physical(self) -> bool:
        """Whether the numbers are in physical units, and not registers."""
        return self.names != COLUMNS

    @property
    def units(self) -> tuple[str, str]:
        """Of rates and forces, as the names end: ``dps`` or ``rps``, ``g`` or ``mps2``; empty of registers."""
        return self.names[1].partition("_")[2], self.names[4].partition("_")[2]

    @property
    def has_temperature(self) -> bool:
        """Whether the last column is one."""
        return len(self.names) == len(COLUMNS)

    @property
    def time_us(self) -> float:
        """us per unit of the time column."""
        return TIME_US[self.names[0]]

    @property
    def log_header(self) -> str:
        """Of the log that is made of it, whose time is in us."""
        return ",".join(("t_us", *self.names[1:]))

    @property
    def bars(self) -> np.ndarray:
        """(6 or 7,) of each column's steps."""
        if not self.physical:
            return REGISTER_BARS
        gyro, accel = self.units
        return np.array([BARS[gyro]] * 3 + [BARS[accel]] * 3 + [BARS["c"]] * self.has_temperature)

    @cached_property
    def limits(self) -> tuple[float, ...]:
        """Of each column but the time, in physical units: what no sensor measures is beyond it, and what holds it is no line."""
        gyro, accel = self.units
        kinds = [("gyro", gyro)] * 3 + [("accel", accel)] * 3 + [("temp", "c")] * self.has_temperature
        return tuple(BEYOND[kind] / SI[unit] for kind, unit in kinds)


REGISTERS = StreamFormat()


def parse_header(line: bytes) -> tuple[int, tuple[int, ...], StreamFormat] | None:
    """A header line: how many columns it announces, where the log's are, and what they are; None where it is none."""
    names = [name.strip() for name in line.decode("latin-1").split(",")]
    form = REGISTERS if set(COLUMNS) <= set(names) else _physical(names)
    return None if form is None else (len(names), tuple(map(names.index, form.names)), form)


def _physical(names: list[str]) -> StreamFormat | None:
    times = [name for name in names if name in TIME_US]
    gyro = _triad(names, "g", ("dps", "rps"))
    accel = _triad(names, "a", ("g", "mps2"))
    if len(times) != 1 or gyro is None or accel is None:
        return None
    return StreamFormat((times[0], *gyro, *accel, *(["temp_c"] if "temp_c" in names else [])))


def _triad(names: list[str], letter: str, units: tuple[str, ...]) -> tuple[str, ...] | None:
    found = [triad for unit in units if set(triad := tuple(f"{letter}{axis}_{unit}" for axis in "xyz")) <= set(names)]
    return found[0] if len(found) == 1 else None


# What a board says of itself beside its samples: frames 0x05 to 0x08 (docs/firmware.md).  The same said again is no event.

BOARD_TYPE, FAULTS_TYPE, DONE_TYPE, TESTED_TYPE = 0x05, 0x06, 0x07, 0x08
STANDIN, SENSOR = 0, 1
#: counts of a faults frame, in its order
FAULTS = (
    "overrun",
    "order",
    "parity",
    "tag",
    "hang",
    "zeros",
    "ones",
    "reset",
    "changed",
    "identity",
    "silent",
    "stamp",
    "incomplete",
    "starts",
    "lost",
    "crowded_out",
)
_HEAD = struct.Struct("<BH")
_BOARD = struct.Struct("<BBBBBBb10sIf")
_FAULTS = struct.Struct("<16I")
_DONE = struct.Struct("<BB")
_TESTED = struct.Struct("<H6f")
_LENGTHS = {
    BOARD_TYPE: _HEAD.size + _BOARD.size,
    FAULTS_TYPE: _HEAD.size + _FAULTS.size,
    DONE_TYPE: _HEAD.size + _DONE.size,
    TESTED_TYPE: _HEAD.size + _TESTED.size,
}


@dataclass(frozen=True)
class BoardStatus:
    """Who gives the samples, and how it is set.  source: STANDIN or SENSOR (a number beyond them is a newer firmware's); registers:
    CTRL1_XL to CTRL10_C as read back; baud of the host's port; odr_hz: nominal."""

    source: int
    streams: bool
    runs: bool
    firmware: str
    who_am_i: int
    freq_fine: int
    registers: bytes
    baud: int
    odr_hz: float

    @property
    def source_name(self) -> str:
        """In a word."""
        return {STANDIN: STANDIN_NAME, SENSOR: SENSOR_NAME}.get(self.source, str(self.source))

    @property
    def text(self) -> str:
        """As a log's comment says it, without the ``#``."""
        said = f"board source={self.source_name} firmware={self.firmware}"
        if self.source == STANDIN:  # which has no registers
            return said
        return f"{said} who_am_i=0x{self.who_am_i:02X} freq_fine={self.freq_fine} registers={self.registers.hex()}"


@dataclass(frozen=True)
class FaultCounts:
    """How often each of ``FAULTS`` has been counted since power-up."""

    counts: tuple[int, ...]

    @property
    def text(self) -> str:
        """As a log's comment says it, without the ``#``: those that there are."""
        return " ".join(["faults", *(f"{name}={count}" for name, count in zip(FAULTS, self.counts, strict=True) if count)])

    def since(self, before: FaultCounts | None) -> dict[str, int]:
        """What has risen, by how much.  A count that fell is a board that was switched on again: it counts from nothing."""
        old = before.counts if before is not None else (0,) * len(FAULTS)
        if any(now < then for now, then in zip(self.counts, old, strict=True)):
            old = (0,) * len(FAULTS)
        return {name: now - then for name, now, then in zip(FAULTS, self.counts, old, strict=True) if now > then}


@dataclass(frozen=True)
class CommandResult:
    """The answer to a command: its type, its sequence number, and 0 or why not."""

    sequence: int
    command: int
    result: int


@dataclass(frozen=True)
class SelfTestResult:
    """The sensor's self-test: failed, a bit for each axis; how far it moved the outputs, (3,) dps and (3,) mg."""

    failed: int
    gyro_dps: tuple[float, ...]
    accel_mg: tuple[float, ...]


BoardMessage = BoardStatus | FaultCounts | CommandResult | SelfTestResult


def decode_message(body: bytes) -> BoardMessage | None:
    """A frame's body without its CRC; None where it is none of the four, or not as long as it must be."""
    if len(body) < _HEAD.size or _LENGTHS.get(body[0]) != len(body):
        return None
    kind, sequence = _HEAD.unpack_from(body)
    rest = body[_HEAD.size :]
    if kind == BOARD_TYPE:
        source, state, major, minor, patch, who, fine, registers, baud, odr_hz = _BOARD.unpack(rest)
        return BoardStatus(source, bool(state & 1), bool(state & 2), f"{major}.{minor}.{patch}", who, fine, registers, baud, odr_hz)
    if kind == FAULTS_TYPE:
        return FaultCounts(_FAULTS.unpack(rest))
    if kind == DONE_TYPE:
        return CommandResult(sequence, *_DONE.unpack(rest))
    failed, *moved = _TESTED.unpack(rest)
    return SelfTestResult(failed, tuple(moved[:3]), tuple(moved[3:]))


class BoardMessageFilter:
    """Which frames say something new: a board and its faults are sent each second."""

    def __init__(self) -> None:
        self._last: dict[int, bytes] = {}

    def fresh(self, bodies: Mapping[int, np.ndarray]) -> dict[int, BoardMessage]:
        """Of bodies by block, in order, those that differ from the last of their type, and every answer."""
        found: dict[int, BoardMessage] = {}
        for row in sorted(bodies):
            body = bodies[row].tobytes()
            content = body[_HEAD.size :]
            if body[0] in (BOARD_TYPE, FAULTS_TYPE) and self._last.get(body[0]) == content:
                continue
            if (said := decode_message(body)) is not None:
                self._last[body[0]] = content
                found[row] = said
        return found


# How much a board may do beside sending samples: a few words now and then, and a few changes between text and frames, not a flood.

#: comments, headers and info frames that may come in a row
MOST = 256
#: readings after which there may be one more
EACH = 8


class RemarkBudget:
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


class ModeChangeBudget:
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


# What a stream says, in order.


@dataclass(frozen=True, eq=False)
class SampleChunk:
    """Consecutive samples.  t_us (n,) int64, device time, increasing, its 32 bits unrolled; registers (n, 7) int16,
    gx gy gz ax ay az temp, or, of a form in physical units, numbers (n, 6 or 7) float64."""

    t_us: np.ndarray
    registers: np.ndarray
    form: StreamFormat = REGISTERS

    def __len__(self) -> int:
        return len(self.t_us)


@dataclass(frozen=True)
class Info:
    """What the board says of itself.  odr_hz is the true rate; serial is text, in frames a decimal number; sensor: its model, or empty."""

    gyro_fs_dps: float
    accel_fs_g: float
    odr_hz: float
    serial: str
    sensor: str = ""

    @property
    def text(self) -> str:
        """As a log's comment says it, without the ``#``."""
        ranges = f"gyro_fs_dps={self.gyro_fs_dps:g} accel_fs_g={self.accel_fs_g:g} odr_hz={self.odr_hz:.4f} serial={self.serial}"
        return ranges + (f" sensor={self.sensor}" if self.sensor else "")


@dataclass(frozen=True)
class Comment:
    """A line of text that began with ``#``, without it."""

    text: str


@dataclass(frozen=True)
class Trouble:
    """What went wrong, and how often.  t_us: device time of the last good sample before it, or None.

    kind    count of
    lost         samples that the sequence, or in text the stamps, show to be missing, for whatever reason
    crc          frames that failed their check
    garbage      bytes that were neither frame nor line
    implausible  samples that were readable, but cannot follow those around them: left out
    reset        device time began anew: a new log
    reconnect    the port was opened again: a new log
    """

    kind: str
    count: int = 1
    t_us: int | None = None


Event = SampleChunk | Info | Comment | Trouble | BoardStatus | FaultCounts | CommandResult | SelfTestResult


# What frames or lines said, before and after it is known whether it counts.


@dataclass(frozen=True, eq=False)
class ReceivedSamples:
    """What frames or lines said: sequence (n,) int64, or None in text; t_us (n,) int64, as sent; registers (n, 7) int16;
    damaged (n,) bool, whether something unreadable came just before."""

    sequence: np.ndarray | None
    t_us: np.ndarray
    registers: np.ndarray
    damaged: np.ndarray

    def __len__(self) -> int:
        return len(self.t_us)

    def part(self, start: int, stop: int) -> ReceivedSamples:
        """Those from start up to stop."""
        sequence = None if self.sequence is None else self.sequence[start:stop]
        return ReceivedSamples(sequence, self.t_us[start:stop], self.registers[start:stop], self.damaged[start:stop])

    @property
    def numbers(self) -> list[int] | list[None]:
        """The sequence, one by one; None of each in text."""
        return [None] * len(self) if self.sequence is None else self.sequence.tolist()


@dataclass(frozen=True, eq=False)
class AcceptedSamples:
    """Readings that count.  t_us (n,) int64 unrolled; registers (n, 7); damaged (n,); periods (n,): sample periods since the one
    before, 1 without a loss."""

    t_us: np.ndarray
    registers: np.ndarray
    damaged: np.ndarray
    periods: np.ndarray

    @property
    def arrays(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """In this order."""
        return self.t_us, self.registers, self.damaged, self.periods


# What one call of the decoder gives: its events, gathered.


class Collector:
    """Events in order, with as few objects as possible: between two that have a place, one chunk, and one count of each trouble."""

    _COUNTED = ("lost", "crc", "garbage")

    def __init__(self) -> None:
        self._done: list[Event] = []
        self._chunks: list[SampleChunk] = []
        self._counts: dict[str, Trouble] = {}

    def add(self, event: Event) -> None:
        """One more."""
        if isinstance(event, SampleChunk):
            self._chunks.append(event)
        elif isinstance(event, Trouble) and event.kind in self._COUNTED:
            before = self._counts.get(event.kind)
            self._counts[event.kind] = event if before is None else Trouble(event.kind, before.count + event.count, before.t_us)
        else:
            self._close()
            last = self._done[-1] if self._done else None
            if (
                isinstance(event, Trouble)
                and isinstance(last, Trouble)
                and last.kind == event.kind == "implausible"
                and last.t_us == event.t_us
            ):
                self._done[-1] = Trouble(event.kind, last.count + event.count, event.t_us)
            else:
                self._done.append(event)

    def events(self) -> list[Event]:
        """All so far."""
        self._close()
        return self._done

    def _close(self) -> None:
        if len(self._chunks) > 1:
            t_us, registers = (np.concatenate([getattr(chunk, name) for chunk in self._chunks]) for name in ("t_us", "registers"))
            self._chunks = [SampleChunk(t_us, registers, self._chunks[0].form)]
        self._done += [*self._chunks, *self._counts.values()]
        self._chunks, self._counts = [], {}
