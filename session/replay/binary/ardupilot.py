"""ArduPilot's dataflash logs (``.BIN``), which describe themselves, by a small reader of our own.

pymavlink reads them, too.  It is LGPL-3.0, brings lxml, and holds a Python object for each message; the format is short enough to be read
here.  Each message is ``A3 95``, its type, and numbers; ``FMT`` messages give each type's length, letters for the numbers and their
names, and ``FMTU``, ``UNIT`` and ``MULT`` the units (https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from session.base.budget import current
from session.base.errors import FormatError
from session.base.units import parse_unit
from session.replay.binary.source import Messages, Part, Source, Stream, begins, microseconds, one_line

MARK = b"\xa3\x95"
FMT = 0x80
FMT_LENGTH = 89
#: letters of FMT -> NumPy's type and a factor
LETTERS: dict[str, tuple[str, float]] = {
    **{"b": ("i1", 1), "B": ("u1", 1), "M": ("u1", 1), "h": ("<i2", 1), "H": ("<u2", 1), "i": ("<i4", 1), "I": ("<u4", 1), "L": ("<i4", 1)},
    **{
        "q": ("<i8", 1),
        "Q": ("<u8", 1),
        "f": ("<f4", 1),
        "d": ("<f8", 1),
        "g": ("<f2", 1),
        "n": ("S4", 1),
        "N": ("S16", 1),
        "Z": ("S64", 1),
    },
    **{"a": ("(32,)<i2", 1), "c": ("<i2", 0.01), "C": ("<u2", 0.01), "e": ("<i4", 0.01), "E": ("<u4", 0.01)},
}
#: messages that are read: a log of before 2020 numbers its sensors in the name
IMU = ("IMU", "IMU2", "IMU3", "GYR", "GYR1", "GYR2", "GYR3", "ACC", "ACC1", "ACC2", "ACC3")
#: of UNIT, in the words of ``session.base.units``
UNITS = {"rad/s": "rad/s", "deg/s": "dps", "m/s/s": "m/s2", "m/s^2": "m/s2", "degC": "degc", "deg C": "degc"}
#: columns of each quantity, and its unit where a log has no UNIT messages (before 2018)
QUANTITIES = {"gyro": (("GyrX", "GyrY", "GyrZ"), "rad/s"), "accel": (("AccX", "AccY", "AccZ"), "m/s2"), "temp": (("T",), "degc")}
BLOCK = 1 << 22


@dataclass
class _Type:
    """A type of message: its length with the head, letters, columns; units and multipliers of FMTU; the bytes of its messages."""

    name: str
    length: int
    letters: str
    columns: tuple[str, ...]
    units: str = ""
    multipliers: str = ""
    data: bytearray = field(default_factory=bytearray)

    @property
    def dtype(self) -> np.dtype:
        """Of a message without its head.  ValueError for letters that do not make its length."""
        if len(self.letters) != len(self.columns) or len(set(self.columns)) != len(self.columns):
            raise ValueError(f"{self.name} has {len(self.letters)} letters for {len(self.columns)} columns")
        made = np.dtype([(name, LETTERS[letter][0]) for name, letter in zip(self.columns, self.letters, strict=True)])
        if made.itemsize != self.length - 3:
            raise ValueError(f"{self.name} has {self.length} bytes, and letters for {made.itemsize + 3}")
        return made

    def rows(self) -> np.ndarray:
        """(N,) of its messages."""
        dtype = self.dtype
        return np.frombuffer(self.data, dtype, len(self.data) // dtype.itemsize)


def _read(path: Path, names: Sequence[str]) -> list[Stream]:
    """The streams of these messages and sensors, ``IMU[0]``; all for no name or where none of them is there."""
    wanted = {name.partition("[")[0] for name in names} & set(IMU) or set(IMU)
    with one_line(path, "a dataflash log"), Source(path) as source:
        log = _Log(path, wanted)
        log.walk(source)
        held: list[Stream] = []
        for kind in log.types.values():
            if kind.name in wanted and kind.data:
                held += _streams(kind, log, names)
                kind.data = bytearray()
    if not held and names:
        return _read(path, ())  # for the complaint, which lists what is there
    if not held:
        there = ", ".join(sorted({kind.name for kind in log.types.values()}))[:200]
        why = f" ({'; '.join(log.notes)})" if log.notes else ""
        raise FormatError(f"{path}: a dataflash log without IMU, GYR or ACC messages{why}; it describes {there or 'nothing'}")
    return sorted(held, key=lambda stream: (not stream.name.startswith("IMU"), stream.name))


class _Log:
    """The messages of a file by type, with the bytes of those that are wanted.  notes: what was passed over."""

    def __init__(self, path: Path, wanted: set[str]) -> None:
        self.path, self._wanted = path, wanted
        self.types: dict[int, _Type] = {FMT: _Type("FMT", FMT_LENGTH, "BBnNZ", ("Type", "Length", "Name", "Format", "Columns"))}
        self.units: dict[str, str] = {}
        self.multipliers: dict[str, float] = {}
        self.notes: list[str] = []
        self._skipped, self._first_skipped = 0, 0

    def walk(self, source: Source) -> None:
        """Read every message; where no message stands, go on to the next two that stand one behind the other."""
        start, rest = 0, b""
        while block := source.read(min(BLOCK, source.size - source.tell())):
            rest += block
            used = self._block(rest, start, source.tell() >= source.size)
            start, rest = start + used, rest[used:]
        if rest and not rest.startswith(b"\xff") and rest.strip(b"\0"):
            self.notes.append(f"the log is cut: it ends at byte {start + len(rest)} within a message")
        if self._skipped:
            self.notes.append(
                f"the log is damaged at byte {self._first_skipped}: {self._skipped} bytes that hold no message are passed over"
            )

    def _block(self, data: bytes, start: int, last: bool) -> int:
        """Read the whole messages of some bytes, which stand at ``start``; how many bytes were used up."""
        place, size, types = 0, len(data), self.types
        keep = {number: kind.data for number, kind in types.items() if kind.name in self._wanted}
        while place + 3 <= size:
            kind = types.get(data[place + 2]) if data[place : place + 2] == MARK else None
            if kind is None:
                behind = self._next(data, place + 1, last)
                if behind < 0:
                    return place
                self._first_skipped = self._first_skipped if self._skipped else start + place
                self._skipped += behind - place
                place = behind
                continue
            end = place + kind.length
            if end > size:
                return place
            number = data[place + 2]
            if number in keep:
                keep[number] += data[place + 3 : end]
            elif kind.name in ("FMT", "FMTU", "UNIT", "MULT"):
                self._describe(kind, data[place + 3 : end])
                keep = {number: kind.data for number, kind in types.items() if kind.name in self._wanted}
            place = end
        return place

    def _next(self, data: bytes, place: int, last: bool) -> int:
        """Where the next message stands that another one follows, or the file's end; -1 where more bytes are needed."""
        while (place := data.find(MARK, place)) >= 0 and place + 3 <= len(data):
            kind = self.types.get(data[place + 2])
            if kind is not None:
                end = place + kind.length
                if end + 2 > len(data):
                    return place if end == len(data) or not last else len(data)
                if data[end : end + 2] == MARK:
                    return place
            place += 1
        return len(data) if last else max(len(data) - 2, 0) or -1

    def _describe(self, kind: _Type, body: bytes) -> None:
        """A message that describes others: damaged ones change nothing."""
        try:
            row = np.frombuffer(body, kind.dtype, 1)[0]
            cells = {name: row[name] for name in kind.columns}
            text = {name: bytes(value).split(b"\0")[0].decode("ascii") for name, value in cells.items() if isinstance(value, bytes)}
            if kind.name == "FMT":
                made = _Type(text["Name"], int(cells["Length"]), text["Format"], tuple(filter(None, text["Columns"].split(","))))
                number = int(cells["Type"])
                if number != FMT and made.length > 3 and (number not in self.types or self.types[number].name == made.name):
                    made.data = self.types[number].data if number in self.types else made.data
                    self.types[number] = made
            elif kind.name == "FMTU":
                of = self.types[int(cells["FmtType"])]
                of.units, of.multipliers = text["UnitIds"], text["MultIds"]
            elif kind.name == "UNIT":
                self.units[chr(int(cells["Id"]))] = text["Label"]
            else:
                self.multipliers[chr(int(cells["Id"]))] = float(cells["Mult"])
        except (ValueError, KeyError, TypeError, IndexError):
            return


def _streams(kind: _Type, log: _Log, names: Sequence[str]) -> Iterator[Stream]:
    """One of each sensor that a type of message holds; of these names where one of them is of this type."""
    rows = kind.rows()
    sensors = rows["I"] if "I" in kind.columns else np.zeros(len(rows), int)
    for number in np.unique(sensors):
        name = f"{kind.name}[{number}]" if "I" in kind.columns else kind.name
        if any(wanted.partition("[")[0] == kind.name for wanted in names) and name not in names:
            continue
        own = rows[sensors == number]
        current().numbers(log.path, 8 * len(own))
        if len(own) == 1 and len(rows) > 2:
            continue  # a sensor of a single row is a damaged number
        notes = list(log.notes)
        t_ns, kept = microseconds(own["SampleUS" if "SampleUS" in kind.columns else "TimeUS"], notes)
        own = own[kept]
        parts = {what: part for what in QUANTITIES if (part := _part(what, kind, log, own, notes)) is not None}
        if {"gyro", "accel"} & set(parts) and len(own):
            yield Stream(name, t_ns, parts, frame="forward, right, down", notes=tuple(notes), columns=kind.columns)


def _part(what: str, kind: _Type, log: _Log, rows: np.ndarray, notes: list[str]) -> Part | None:
    """As written, in the unit that FMTU and UNIT state, else as ArduPilot documents it; None where its columns are not there."""
    names, unit = QUANTITIES[what]
    if not set(names) <= set(kind.columns):
        return None
    places = [kind.columns.index(name) for name in names]
    values = np.column_stack(
        [rows[name].astype(float) * LETTERS[kind.letters[place]][1] for name, place in zip(names, places, strict=True)]
    )
    place = places[0]
    label = log.units.get(kind.units[place], "") if place < len(kind.units) else ""
    multiplier = log.multipliers.get(kind.multipliers[place], 1.0) if place < len(kind.multipliers) else 1.0
    if word := UNITS.get(label, ""):
        scaled = f"{multiplier:g}{word}"
        unit = word if multiplier in (0.0, 1.0) or parse_unit(what, scaled) is None else scaled
    elif what != "temp":
        notes.append(f"the unit of {names[0]} is taken as ArduPilot documents it")
    return Part(values[:, 0], unit) if what == "temp" else Part(values, unit, names)


FORMAT = Messages(
    "ArduPilot dataflash",
    "a dataflash log",
    "",
    "",
    "",
    "ArduPilot's APM/LOGS/00000042.BIN, with IMU, or with GYR and ACC (INS_RAW_LOG_OPT)",
    begins(MARK + bytes([FMT])),
    _read,
)
