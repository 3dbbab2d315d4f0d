"""Events of a recording: samples, what the board reports of itself, and everything else as one record; the columns of a stream; limits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from session.base.texts import SENSOR_NAME, STANDIN_NAME
from session.base.units import BEYOND, DEG, STAMP_NS, WORDS, G

if TYPE_CHECKING:
    from session.log.registers import RegisterUnits

# Columns of a text stream: a sensor's registers, or physical units, as its header states (docs/formats.md).

COLUMNS = ("t_us", "gx", "gy", "gz", "ax", "ay", "az", "temp")
HEADER = ",".join(COLUMNS)
#: limit of a plausible step in one sample period near damage (``StepFilter``), SI: 0.8 % of ±2000 dps, 1.6 % of ±16 g, degC
BARS = {"gyro": 16.0 * DEG, "accel": 0.25 * G, "temp": 0.25}
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
        return STAMP_NS[self.names[0]] / 1000

    @property
    def bars(self) -> np.ndarray:
        """(6 or 7,) limits of a plausible step in each column but the time."""
        if not self.physical:
            return REGISTER_BARS
        return np.array(self._in_units(BARS))

    @cached_property
    def limits(self) -> tuple[float, ...]:
        """Limits of each physical column but the time: no sensor measures a value beyond them."""
        return tuple(self._in_units(BEYOND))

    def _in_units(self, si: Mapping[str, float]) -> list[float]:
        gyro, accel = self.units
        columns = [("gyro", gyro)] * 3 + [("accel", accel)] * 3 + [("temp", "c")] * self.has_temperature
        return [si[kind] / WORDS[kind][unit] for kind, unit in columns]


REGISTERS = StreamFormat()


def parse_header(line: bytes) -> tuple[int, tuple[int, ...], StreamFormat] | None:
    """The number of columns that a header line announces, the indices of the log's columns, and their format; None for another line."""
    names = [name.strip() for name in line.decode("latin-1").split(",")]
    form = REGISTERS
    if not set(COLUMNS) <= set(names):
        times = [name for name in names if name in STAMP_NS]
        gyro, accel = _triad(names, "g", ("dps", "rps")), _triad(names, "a", ("g", "mps2"))
        if len(times) != 1 or gyro is None or accel is None:
            return None
        form = StreamFormat((times[0], *gyro, *accel, *(["temp_c"] if "temp_c" in names else [])))
    return len(names), tuple(map(names.index, form.names)), form


def _triad(names: list[str], letter: str, units: tuple[str, ...]) -> tuple[str, ...] | None:
    found = [triad for unit in units if set(triad := tuple(f"{letter}{axis}_{unit}" for axis in "xyz")) <= set(names)]
    return found[0] if len(found) == 1 else None


# Events, in the order of the stream.  Each has a ``kind``.


@dataclass(frozen=True, eq=False)
class SampleChunk:
    """Consecutive samples.  t_us (n,) int64, device time, increasing, its 32 bits unrolled; registers (n, 7) int16,
    gx gy gz ax ay az temp, or, of a format in physical units, numbers (n, 6 or 7) float64.

    Within the decoder also damaged (n,) bool, whether something unreadable came just before; and, of frames, before their continuity is
    checked, sequence (n,) int64; behind that check periods (n,), sample periods since the one before, 1 without a loss.
    """

    kind = "samples"
    t_us: np.ndarray
    registers: np.ndarray
    form: StreamFormat = REGISTERS
    damaged: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    sequence: np.ndarray | None = None
    periods: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))

    def __len__(self) -> int:
        return len(self.t_us)

    def part(self, start: int, stop: int | None = None) -> SampleChunk:
        """Those from start up to stop."""
        rows = slice(start, stop)
        sequence = None if self.sequence is None else self.sequence[rows]
        return SampleChunk(self.t_us[rows], self.registers[rows], self.form, self.damaged[rows], sequence, self.periods[rows])

    def in_si(self, units: Callable[[], RegisterUnits]) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
        """Rates and forces (n, 3), and temperatures (n,) where they are known; units: of registers, requested where there are some."""
        values = self.registers.astype(float)
        if self.form.physical:
            gyro, accel = (WORDS[kind][word] for kind, word in zip(("gyro", "accel"), self.form.units, strict=True))
            temp_c = values[:, 6] if self.form.has_temperature else None
        else:
            meant = units()
            gyro, accel, temp_c = meant.gyro_rps, meant.accel_mps2, meant.temperature_c(values[:, 6])
        return values[:, 0:3] * gyro, values[:, 3:6] * accel, temp_c


def joined_chunk(chunks: Sequence[SampleChunk]) -> SampleChunk:
    """One chunk of neighbouring ones of the same format, without their sequence."""
    if len(chunks) == 1:
        return chunks[0]
    t_us, registers, damaged, periods = (
        np.concatenate([getattr(chunk, name) for chunk in chunks]) for name in ("t_us", "registers", "damaged", "periods")
    )
    return SampleChunk(t_us, registers, chunks[0].form, damaged, None, periods)


@dataclass(frozen=True)
class Info:
    """The board's ranges and identity.  odr_hz is the true rate; serial is text, in frames a decimal number; sensor: model, or empty.

    latitude_deg: of a board that knows where it is.
    """

    kind = "info"
    gyro_fs_dps: float
    accel_fs_g: float
    odr_hz: float
    serial: str
    sensor: str = ""
    latitude_deg: float | None = None

    @property
    def text(self) -> str:
        """As a log's comment, without the ``#``."""
        ranges = f"gyro_fs_dps={self.gyro_fs_dps:g} accel_fs_g={self.accel_fs_g:g} odr_hz={self.odr_hz:.4f} serial={self.serial}"
        place = "" if self.latitude_deg is None else f" latitude_deg={self.latitude_deg:g}"
        return ranges + (f" sensor={self.sensor}" if self.sensor else "") + place


STANDIN, SENSOR = 0, 1
#: WHO_AM_I -> the chip that the firmware runs it as; siblings have the same registers and the same identity
CHIPS = {0x6B: "ASM330LHH", 0x6C: "LSM6DSO"}


@dataclass(frozen=True)
class BoardStatus:
    """The source of the samples, and its settings."""

    kind = "board"
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
class Event:
    """What happened (kind), and how often, at which moment, in which words or numbers.  t_us: device time of the last good sample before
    it, or None.

    kind         what it is
    lost         count of samples that the sequence, or in text the stamps, show to be missing, for whatever reason
    crc          count of frames that failed their check
    garbage      count of bytes that were neither frame nor line
    implausible  count of samples that were readable, but cannot follow those around them: left out
    reset        the device time has restarted: a new log
    reconnect    the port was opened, not for the first time: a new log
    comment      text of a line that began with ``#``, without it
    faults       numbers: how often the board has counted each of ``FAULTS`` since power-up
    done         numbers: the sequence number of a command that the board answers, its type, and 0 or why it was refused
    tested       numbers of the sensor's self-test: failed, a bit for each axis; how far it moved the outputs, 3 dps and 3 mg
    open, close  text: the port that was opened; why it was closed
    begin, pause, keep, drop, finish, note: decisions at the table (``session.bench.rawfile``), with their text
    """

    kind: str
    count: int = 1
    t_us: int | None = None
    text: str = ""
    numbers: tuple[float, ...] = ()

    def merges_with(self, other: Event) -> bool:
        """Whether both are left-out samples at the same place."""
        return self.kind == other.kind == "implausible" and self.t_us == other.t_us


TROUBLES = ("lost", "crc", "garbage", "implausible", "reset", "reconnect")
AnyEvent = Event | SampleChunk | Info | BoardStatus


def starts_log(event: AnyEvent) -> bool:
    """Whether an event begins a new log: device time has restarted, or the port was opened again."""
    return event.kind in ("reset", "reconnect")


#: counts of a board's faults, in the order of its frame
FAULTS = (
    *("overrun", "order", "parity", "tag", "hang", "zeros", "ones", "reset"),
    *("changed", "identity", "silent", "stamp", "incomplete", "starts", "lost", "crowded_out", "rate"),
)


def faults_text(counts: Sequence[float]) -> str:
    """Counts of ``FAULTS`` as a log's comment, without the ``#``: those above zero."""
    return " ".join(["faults", *(f"{name}={count}" for name, count in zip(FAULTS, counts, strict=True) if count)])


# Limits of what a board may send in addition to samples: a few remarks, and a few changes between text and frames, but no flood.


class Allowance:
    """Allows so many (most) at once, and one more after every ``each``: bytes of the connection, or readings.

    at: where the stream is; earliest: where there may be one more.  What is beyond is skipped; the raw bytes hold it.
    """

    def __init__(self, most: int, each: int) -> None:
        self._most, self._each = most, each
        self._paid = self.at = 0

    @property
    def earliest(self) -> int:
        """Where the next is allowed."""
        return self._paid - (self._most - 1) * self._each

    def spend(self, at: int | None = None) -> bool:
        """Whether there may be one more here, which is then spent."""
        self.at = self.at if at is None else at
        allowed = self.at >= self.earliest
        if allowed:
            self._paid = max(self._paid, self.at) + self._each
        return allowed


#: comments, headers and info frames that may come in a row, and readings after which there may be one more
REMARKS = 256, 8
#: changes of mode that may follow each other at once, and bytes after which there may be one more
CHANGES = 16, 8192


class EventCollector:
    """The events of one decoder call, in order and merged: between two events with a place, one chunk, and one count of each trouble."""

    _COUNTED = ("lost", "crc", "garbage")

    def __init__(self) -> None:
        self._done: list[AnyEvent] = []
        self._chunks: list[SampleChunk] = []
        self._counts: dict[str, Event] = {}

    def add(self, event: AnyEvent) -> None:
        """Append or merge an event."""
        if isinstance(event, SampleChunk):
            self._chunks.append(event)
        elif isinstance(event, Event) and event.kind in self._COUNTED:
            before = self._counts.get(event.kind)
            self._counts[event.kind] = event if before is None else replace(before, count=before.count + event.count)
        else:
            self._close()
            last = self._done[-1] if self._done else None
            if isinstance(event, Event) and isinstance(last, Event) and last.merges_with(event):
                self._done.pop()
                event = replace(event, count=last.count + event.count)
            self._done.append(event)

    def events(self) -> list[AnyEvent]:
        """All so far."""
        self._close()
        return self._done

    def _close(self) -> None:
        if self._chunks:
            self._done.append(joined_chunk(self._chunks))
        self._done += self._counts.values()
        self._chunks, self._counts = [], {}
