"""Events of a stream: samples, info, comments, faults, board messages; the format of its columns; the order of events."""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from session.base.texts import SENSOR_NAME, STANDIN_NAME
from session.base.units import BEYOND, DEG, WORDS, G

# Columns of a text stream: a sensor's registers, or physical units, as its header states (docs/formats.md).

COLUMNS = ("t_us", "gx", "gy", "gz", "ax", "ay", "az", "temp")
HEADER = ",".join(COLUMNS)
#: us per unit of a time column
TIME_US = {"t_us": 1.0, "t_s": 1e6, "t_ns": 1e-3}
#: limit of a plausible step in one sample period near damage (``StepFilter``): 0.8 % of ±2000 dps, 1.6 % of ±16 g, degC
BARS = {"dps": 16.0, "rps": 16.0 * DEG, "g": 0.25, "mps2": 0.25 * G, "c": 0.25}
#: the same of registers, LSB: gyro 0.8 % of full scale, accelerometer 1.6 %, temperature 0.25 degC of an ASM330LHH
REGISTER_BARS = np.array([256, 256, 256, 512, 512, 512, 64], np.int64)


@dataclass(frozen=True)
class StreamFormat:
    """Names of the log's columns as in the header: time, rates, forces, and the temperature where there is one."""

    names: tuple[str, ...] = COLUMNS

    @property
    def physical(self) -> bool:
        """Whether the numbers are in physical units instead of registers."""
        return self.names != COLUMNS

    @property
    def units(self) -> tuple[str, str]:
        """Units of rates and forces, as the names end: ``dps`` or ``rps``, ``g`` or ``mps2``; empty for registers."""
        return self.names[1].partition("_")[2], self.names[4].partition("_")[2]

    @property
    def has_temperature(self) -> bool:
        """Whether the last column is a temperature."""
        return len(self.names) == len(COLUMNS)

    @property
    def time_us(self) -> float:
        """us per unit of the time column."""
        return TIME_US[self.names[0]]

    @property
    def bars(self) -> np.ndarray:
        """(6 or 7,) limits of a plausible step in each column but the time."""
        if not self.physical:
            return REGISTER_BARS
        return np.array([BARS[unit] for _, unit in self._quantities])

    @cached_property
    def limits(self) -> tuple[float, ...]:
        """Limits of each physical column but the time: no sensor measures a value beyond them."""
        return tuple(BEYOND[kind] / WORDS[kind][unit] for kind, unit in self._quantities)

    @property
    def _quantities(self) -> list[tuple[str, str]]:
        gyro, accel = self.units
        return [("gyro", gyro)] * 3 + [("accel", accel)] * 3 + [("temp", "c")] * self.has_temperature


REGISTERS = StreamFormat()


def parse_header(line: bytes) -> tuple[int, tuple[int, ...], StreamFormat] | None:
    """The number of columns that a header line announces, the indices of the log's columns, and their format; None for another line."""
    names = [name.strip() for name in line.decode("latin-1").split(",")]
    form = REGISTERS
    if not set(COLUMNS) <= set(names):
        times = [name for name in names if name in TIME_US]
        gyro, accel = _triad(names, "g", ("dps", "rps")), _triad(names, "a", ("g", "mps2"))
        if len(times) != 1 or gyro is None or accel is None:
            return None
        form = StreamFormat((times[0], *gyro, *accel, *(["temp_c"] if "temp_c" in names else [])))
    return len(names), tuple(map(names.index, form.names)), form


def _triad(names: list[str], letter: str, units: tuple[str, ...]) -> tuple[str, ...] | None:
    found = [triad for unit in units if set(triad := tuple(f"{letter}{axis}_{unit}" for axis in "xyz")) <= set(names)]
    return found[0] if len(found) == 1 else None


# Messages of a board about itself: frames 0x05 to 0x08 (docs/firmware.md).

BOARD_TYPE, FAULTS_TYPE, DONE_TYPE, TESTED_TYPE = 0x05, 0x06, 0x07, 0x08
STANDIN, SENSOR = 0, 1
#: WHO_AM_I -> the chip that the firmware runs it as; siblings have the same registers and the same identity
CHIPS = {0x6B: "ASM330LHH", 0x6C: "LSM6DSO"}
#: counts of a faults frame, in its order
FAULTS = (
    *("overrun", "order", "parity", "tag", "hang", "zeros", "ones", "reset"),
    *("changed", "identity", "silent", "stamp", "incomplete", "starts", "lost", "crowded_out", "rate"),
)
FIRST_FAULTS_BYTES = 64  #: of firmware 1.0, which counted all but "rate"
_HEAD = struct.Struct("<BH")
_CONTENT = {
    BOARD_TYPE: struct.Struct("<BBBBBBb10sIf"),
    FAULTS_TYPE: struct.Struct("<17I"),
    DONE_TYPE: struct.Struct("<BB"),
    TESTED_TYPE: struct.Struct("<H6f"),
}


@dataclass(frozen=True)
class BoardStatus:
    """The source of the samples, and its settings."""

    source: int  #: STANDIN or SENSOR; another number is of a newer firmware
    streams: bool
    runs: bool
    firmware: str
    who_am_i: int
    freq_fine: int
    registers: bytes  #: CTRL1_XL to CTRL10_C as read back
    baud: int  #: of the host's port
    odr_hz: float  #: nominal
    settles: bool = False  #: the sensor runs, but its filters have not settled: no samples yet
    by_watchdog: bool = False  #: whether the board's last reset since power-up was its watchdog's
    by_fault: bool = False  #: whether it was behind a fault of its core

    @property
    def source_name(self) -> str:
        """The source in a word."""
        return {STANDIN: STANDIN_NAME, SENSOR: SENSOR_NAME}.get(self.source, str(self.source))

    @property
    def reset(self) -> str:
        """What the board's last reset since power-up came of: ``fault``, ``watchdog``, or empty where somebody wanted it."""
        return "fault" if self.by_fault else "watchdog" if self.by_watchdog else ""

    @property
    def text(self) -> str:
        """As a log's comment, without the ``#``."""
        words = f"board source={self.source_name} firmware={self.firmware}"
        if self.source != STANDIN:  # which has no registers
            words += f" who_am_i=0x{self.who_am_i:02X} freq_fine={self.freq_fine} registers={self.registers.hex()}"
        return words + (f" reset={self.reset}" if self.reset else "")


@dataclass(frozen=True)
class FaultCounts:
    """How often each of ``FAULTS`` has been counted since power-up."""

    counts: tuple[int, ...]

    @property
    def text(self) -> str:
        """As a log's comment, without the ``#``: the counts above zero."""
        return " ".join(["faults", *(f"{name}={count}" for name, count in zip(FAULTS, self.counts, strict=True) if count)])

    def since(self, before: FaultCounts | None) -> dict[str, int]:
        """The counts that have risen, and by how much.  Where a count fell, the board was switched on again: it counts from zero."""
        old = before.counts if before is not None else (0,) * len(FAULTS)
        if any(now < then for now, then in zip(self.counts, old, strict=True)):
            old = (0,) * len(FAULTS)
        return {name: now - then for name, now, then in zip(FAULTS, self.counts, old, strict=True) if now > then}


@dataclass(frozen=True)
class CommandResult:
    """The answer to a command: its sequence number, its type, and 0 or why it was refused."""

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
    """Decode a frame's body without its CRC; None where its type or its length is none of the four."""
    if len(body) < _HEAD.size or body[0] not in _CONTENT:
        return None
    if body[0] == FAULTS_TYPE and len(body) == _HEAD.size + FIRST_FAULTS_BYTES:
        body += bytes(_CONTENT[FAULTS_TYPE].size - FIRST_FAULTS_BYTES)
    if len(body) != _HEAD.size + _CONTENT[body[0]].size:
        return None
    kind, sequence = _HEAD.unpack_from(body)
    values = _CONTENT[kind].unpack_from(body, _HEAD.size)
    if kind == BOARD_TYPE:
        source, state, major, minor, patch, who, fine, registers, baud, odr_hz = values
        firmware, states = f"{major}.{minor}.{patch}", [bool(state >> bit & 1) for bit in range(5)]
        return BoardStatus(source, states[0], states[1], firmware, who, fine, registers, baud, odr_hz, *states[2:])
    if kind == FAULTS_TYPE:
        return FaultCounts(values)
    if kind == DONE_TYPE:
        return CommandResult(sequence, *values)
    return SelfTestResult(values[0], values[1:4], values[4:7])


class BoardMessageFilter:
    """Drops repetitions: a board sends its status and its fault counts each second."""

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
            if (message := decode_message(body)) is not None:
                self._last[body[0]] = content
                found[row] = message
        return found


# Limits of what a board may send besides samples: a few remarks, and a few changes between text and frames, but no flood.

#: comments, headers and info frames that may come in a row
MOST = 256
#: readings after which there may be one more
EACH = 8


class RemarkBudget:
    """``spend`` one for each remark, ``earn`` with each reading.  Remarks beyond the budget are skipped; the raw bytes hold them."""

    def __init__(self) -> None:
        self._credit = MOST * EACH

    def earn(self, readings: int) -> None:
        """So many readings have come."""
        self._credit = min(MOST * EACH, self._credit + readings)

    def spend(self) -> bool:
        """Whether there may be one more remark."""
        if self._credit < EACH:
            return False
        self._credit -= EACH
        return True


#: changes of mode that may follow each other at once, and bytes after which there may be one more
CHANGES, CHANGE_BYTES = 16, 8192


class ModeChangeBudget:
    """Limits the changes between text and frames: the next is allowed from ``earliest`` on, a position in the stream."""

    def __init__(self) -> None:
        self._paid = 0

    @property
    def earliest(self) -> int:
        """Bytes from the beginning of the connection."""
        return self._paid - (CHANGES - 1) * CHANGE_BYTES

    def change(self, place: int) -> None:
        """The mode has changed at this position."""
        self._paid = max(self._paid, place) + CHANGE_BYTES


@dataclass(frozen=True, eq=False)
class SampleChunk:
    """Consecutive samples.  t_us (n,) int64, device time, increasing, its 32 bits unrolled; registers (n, 7) int16,
    gx gy gz ax ay az temp, or, of a format in physical units, numbers (n, 6 or 7) float64."""

    t_us: np.ndarray
    registers: np.ndarray
    form: StreamFormat = REGISTERS

    def __len__(self) -> int:
        return len(self.t_us)


def joined_chunk(chunks: Sequence[SampleChunk]) -> SampleChunk:
    """One chunk of neighbouring ones of the same format."""
    if len(chunks) == 1:
        return chunks[0]
    return SampleChunk(
        np.concatenate([chunk.t_us for chunk in chunks]), np.concatenate([chunk.registers for chunk in chunks]), chunks[0].form
    )


@dataclass(frozen=True)
class Info:
    """The board's ranges and identity.  odr_hz is the true rate; serial is text, in frames a decimal number; sensor: model, or empty."""

    gyro_fs_dps: float
    accel_fs_g: float
    odr_hz: float
    serial: str
    sensor: str = ""

    @property
    def text(self) -> str:
        """As a log's comment, without the ``#``."""
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
    reset        restarts of the device time: a new log
    reconnect    openings of the port after the first: a new log
    """

    kind: str
    count: int = 1
    t_us: int | None = None

    def merges_with(self, other: Trouble) -> bool:
        """Whether both are left-out samples at the same place."""
        return self.kind == other.kind == "implausible" and self.t_us == other.t_us


Event = SampleChunk | Info | Comment | Trouble | BoardStatus | FaultCounts | CommandResult | SelfTestResult


def starts_log(event: object) -> bool:
    """Whether an event begins a new log: device time has restarted, or the port was opened again."""
    return isinstance(event, Trouble) and event.kind in ("reset", "reconnect")


@dataclass(frozen=True, eq=False)
class ReceivedSamples:
    """Readings before their continuity is checked: sequence (n,) int64, or None in text; t_us (n,) int64, as sent; registers (n, 7)
    int16; damaged (n,) bool, whether something unreadable came just before."""

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
        """All four, in this order."""
        return self.t_us, self.registers, self.damaged, self.periods


class EventCollector:
    """The events of one decoder call, in order and merged: between two events with a place, one chunk, and one count of each trouble."""

    _COUNTED = ("lost", "crc", "garbage")

    def __init__(self) -> None:
        self._done: list[Event] = []
        self._chunks: list[SampleChunk] = []
        self._counts: dict[str, Trouble] = {}

    def add(self, event: Event) -> None:
        """Append or merge an event."""
        if isinstance(event, SampleChunk):
            self._chunks.append(event)
        elif isinstance(event, Trouble) and event.kind in self._COUNTED:
            before = self._counts.get(event.kind, Trouble(event.kind, 0, event.t_us))
            self._counts[event.kind] = Trouble(event.kind, before.count + event.count, before.t_us)
        else:
            self._close()
            last = self._done[-1] if self._done else None
            if isinstance(event, Trouble) and isinstance(last, Trouble) and last.merges_with(event):
                self._done[-1] = Trouble(event.kind, last.count + event.count, event.t_us)
            else:
                self._done.append(event)

    def events(self) -> list[Event]:
        """All so far."""
        self._close()
        return self._done

    def _close(self) -> None:
        if self._chunks:
            self._done.append(joined_chunk(self._chunks))
        self._done += self._counts.values()
        self._chunks, self._counts = [], {}
