"""Messages of ROS, as bags and MCAP files hold them: where a message keeps its rates, forces and stamp, and the streams of its topics.

rosbags parses the definitions that a file holds, and knows those of ROS where a file holds none.  It would compile Python for them; here a
table of offsets is made instead, which reads the wanted numbers alone and executes nothing.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from session.base.budget import current
from session.base.errors import CalibrationError, FormatError
from session.base.units import NS_PER_S
from session.replay.binary.source import Part, Rows, Stream, library, reason
from session.replay.named import meaning, triads

#: scalars of a definition -> struct's letter; ROS 1's char is a number
LETTERS = {
    **{"bool": "?", "byte": "b", "char": "B", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I"},
    **{"int64": "q", "uint64": "Q", "float32": "f", "float64": "d"},
}
#: numbers of one message when its types are written out
MOST_FIELDS = 20_000
#: runs of numbers, texts and sequences that are stepped over in each message
MOST_PARTS = 64
#: letters of the path of one number
MOST_PATH = 300
#: letters of a type's definitions; parsing one of them, and finding out what a number is, are as much work as unpacking so many bytes
MOST_DEFINITION, PARSED, MEANT = 1 << 17, 512, 4096

# Layout of a message.


class Layout:
    """Reads the wanted numbers of one type of message out of its bytes.

    definitions: rosbags' parsed ones, type name -> (constants, fields).  wanted: paths such as ``angular_velocity.x``; cdr: aligned as in
    ROS 2, with four bytes before; else packed, as in ROS 1.
    """

    def __init__(self, path: Path, definitions: dict[str, Any], name: str, cdr: bool) -> None:
        self._path, self._cdr = path, cdr
        #: runs of (letter, path) of a fixed length, and between them ``""`` for a text or the letter of a sequence
        self._parts: list[list[tuple[str, str]] | str] = [[]]
        self._count = 0
        self._readable = True
        if name in definitions:  # else a type of somebody's own, in a recording that holds no definitions
            self._walk(definitions, name, "", ())
        self.paths = [path for part in self._parts if isinstance(part, list) for _, path in part]
        self._wanted: tuple[str, ...] = ()
        #: of a run, its place behind a multiple of eight bytes, and the order of bytes
        self._unpack: dict[tuple[int, int, str], struct.Struct] = {}
        self._order: tuple[int, ...] = ()

    def want(self, paths: Sequence[str]) -> None:
        """State which numbers ``__call__`` returns."""
        self._wanted, self._unpack = tuple(paths), {}
        last = max(number for number, part in enumerate(self._parts) if isinstance(part, list) and any(path in paths for _, path in part))
        self._parts = self._parts[: last + 1]
        if last > MOST_PARTS:
            raise ValueError(f"more than {MOST_PARTS // 2} texts and sequences stand before its numbers")
        there = [path for part in self._parts if isinstance(part, list) for _, path in part if path in self._wanted]
        self._order = tuple(there.index(path) for path in paths)

    def __call__(self, data: bytes) -> list[float]:
        """The wanted numbers, in their order.  struct.error or ValueError where the bytes are another message's."""
        order, start = "<", 0
        if self._cdr:
            if data[:2] not in (b"\0\0", b"\0\1"):
                raise ValueError("no plain CDR")
            order, start = "><"[data[1]], 4
        place = start
        values: list[float] = []
        for number, part in enumerate(self._parts):
            phase = (place - start) % 8 if self._cdr else 0
            if isinstance(part, list):
                if (number, phase, order) not in self._unpack:
                    self._unpack[number, phase, order] = self._struct(part, phase, order)
                unpack = self._unpack[number, phase, order]
                values += unpack.unpack_from(data, place)
                place += unpack.size
                continue
            place += -phase % 4 if self._cdr else 0
            (length,) = struct.unpack_from(f"{order}I", data, place)
            place += 4
            size = struct.calcsize(f"={part}") if part else 1
            if length and self._cdr:
                place += -(place - start) % size
            place += length * size
        return [values[place] for place in self._order]

    def _struct(self, part: list[tuple[str, str]], phase: int, order: str) -> struct.Struct:
        """Of a run that begins so many bytes behind a multiple of eight."""
        text, place = order, phase
        for letter, path in part:
            size = struct.calcsize(f"={letter}")
            pad = -place % size if self._cdr else 0
            text += f"{pad}x" * (pad > 0) + (letter if path in self._wanted else f"{size}x")
            place += pad + size
        return struct.Struct(text)

    def _walk(self, definitions: dict[str, Any], name: str, prefix: str, above: tuple[str, ...]) -> None:
        """Write out the fields of a type, as far as their places are known."""
        if name in above or name not in definitions:
            raise ValueError(f"{name} is not defined" if name not in above else f"{name} holds itself")
        for field, (node, value) in definitions[name][1]:
            if len(prefix) + len(field) > MOST_PATH:
                raise ValueError(f"the path of a number in {name} has more than {MOST_PATH} letters")
            kind, count = node.name, 1
            if kind in ("ARRAY", "SEQUENCE"):
                (inner, value), count = value
                kind = inner.name
                if node.name == "SEQUENCE":
                    self._one_more(name)
                    if kind == "BASE" and value[0] in LETTERS:
                        self._parts += [LETTERS[value[0]], []]
                    else:
                        self._readable = False  # its length is not known without reading each element
                    continue
            for i in range(count):
                path = f"{prefix}{field}" + (f"[{i}]" if node.name == "ARRAY" else "")
                if not self._readable:
                    return
                self._one_more(name)
                if kind == "NAME":
                    self._walk(definitions, value, f"{path}.", (*above, name))
                elif value[0] in ("string", "wstring"):
                    self._parts += ["", []]
                    self._readable &= value[0] == "string"
                elif value[0] in LETTERS:
                    run = self._parts[-1]
                    assert isinstance(run, list)
                    run.append((LETTERS[value[0]], path))
                else:
                    self._readable = False

    def _one_more(self, name: str) -> None:
        self._count += 1
        current().unpack(self._path, MEANT)
        if self._count > MOST_FIELDS:
            raise ValueError(f"{name} has more than {MOST_FIELDS} numbers")


def layout_of(path: Path, name: str, text: str, idl: bool = False, ros1: bool = False) -> Layout:
    """Of a message type by the definitions in the file's text, with those of ROS for what the text leaves out."""
    types = library(path, "a ROS recording", "rosbags.typesys", "rosbags")
    current().unpack(path, PARSED * (100 + len(text)))
    stores = types.Stores
    known = dict(types.get_typestore(stores.ROS1_NOETIC if ros1 else stores.LATEST).fielddefs)
    if len(text) > MOST_DEFINITION:
        raise ValueError(f"its definition has more than {MOST_DEFINITION} letters")
    if idl and text.strip():
        rule = "=" * 80 + "\n"
        parts = [part.partition("\n")[2] for part in text.split(rule)[1:]] if text.startswith(f"{rule}IDL: ") else [text]
        for part in parts:
            known |= types.get_types_from_idl(part)
    elif text.strip():
        known |= types.get_types_from_msg(text, name)
    return Layout(path, known, name, cdr=not ros1)


# What a type of message holds.


@dataclass(frozen=True)
class Fields:
    """parts: paths of a quantity's numbers, x, y, z of the gyroscope and of the accelerometer, and its unit; of the stamp, and its ns per
    unit; of a covariance's first number, -1 where a message states that it does not hold the quantity."""

    parts: Mapping[str, tuple[tuple[str, ...], str]]
    stamp: tuple[tuple[str, int], ...]
    absent: tuple[tuple[str, str], ...] = ()

    @property
    def width(self) -> int:
        """Numbers of all quantities."""
        return sum(len(names) for names, _ in self.parts.values())

    @property
    def paths(self) -> list[str]:
        """In the order of a row: rates, forces, temperature, absences, stamp."""
        numbers = [path for names, _ in self.parts.values() for path in names]
        return [*numbers, *(path for _, path in self.absent), *(path for path, _ in self.stamp)]


#: of sensor_msgs/Imu by its definition
IMU = "sensor_msgs/msg/Imu"
ABSENT = (("gyro", "angular_velocity_covariance[0]"), ("accel", "linear_acceleration_covariance[0]"))
#: types that hold rates or forces which no sensor measured: wanted, estimated or combined ones
NO_SENSOR = re.compile("Odometry|Setpoint|Target|Estimat|Trajectory|Control|Command|Reference|Wrench")
#: stamps of messages: pairs of seconds and nanoseconds, and single numbers
PAIRS: tuple[tuple[str, str], ...] = (
    ("header.stamp.sec", "header.stamp.nanosec"),
    ("header.stamp.sec", "header.stamp.nsec"),
    ("header.stamp.secs", "header.stamp.nsecs"),
    ("timestamp.sec", "timestamp.nsec"),
    ("stamp.sec", "stamp.nanosec"),
    ("stamp.sec", "stamp.nsec"),
)
#: types of these packages have stamps in us
MICROSECONDS = ("px4_msgs/",)


def fields_of(paths: Sequence[str], kind: str) -> Fields | None:
    """What a message of these numbers holds; kind: its type.  None where it holds neither a gyroscope nor an accelerometer.

    Of two gyroscopes in one message the first counts.
    """
    if NO_SENSOR.search(kind):
        return None
    found, meanings = triads(paths), {path: parsed for path in paths if (parsed := meaning(path)) is not None}
    first = {what: names for (what, _), names in reversed(found.items())}
    named: dict[str, tuple[str, ...]] = {what: first[what] for what in ("gyro", "accel") if what in first}
    if not named:
        return None
    if (temp := next((path for path, parsed in meanings.items() if parsed.kind == "temp"), None)) is not None:
        named["temp"] = (temp,)
    stamp: tuple[tuple[str, int], ...] = next((((sec, NS_PER_S), (nsec, 1)) for sec, nsec in PAIRS if sec in paths and nsec in paths), ())
    if not stamp:
        single = next((path for path in ("timestamp_sample", "timestamp") if path in paths), None)
        if single is not None and kind.startswith(MICROSECONDS):
            stamp = ((single, 1000),)
        else:
            scale = {"ns": 1, "us": 1000, "ms": 10**6, "s": NS_PER_S}
            times = [(path, of.unit) for path, of in meanings.items() if of.kind == "time" and of.unit in scale]
            stamp = ((times[0][0], scale[times[0][1]]),) if times else ()
    fixed, absent = ({"gyro": "rad/s", "accel": "m/s2"}, ABSENT) if kind == IMU else ({}, ())
    parts = {what: (names, fixed.get(what, meanings[names[0]].unit)) for what, names in named.items()}
    return Fields(parts, stamp, tuple(each for each in absent if each[1] in paths))


# Topics that grow while a file is read.

#: unpacks a message
Unpack = Callable[[bytes], bytes]


class Topic:
    """One topic: its rows so far, by the message's own stamp and by the recorder's."""

    def __init__(self, path: Path, name: str, kind: str, decode: Callable[[bytes], Sequence[float]], fields: Fields) -> None:
        self.name, self.kind, self.fields = name, kind, fields
        self._decode = decode
        self._width = fields.width
        self._logged, self._rows = Rows(path, 0), Rows(path, self._width)
        self._absent = np.zeros(len(fields.absent), dtype=np.int64)
        self.damaged = 0

    def add(self, logged_ns: int, data: bytes) -> None:
        """One message.  One that cannot be decoded is counted and left out."""
        try:
            values = self._decode(data)
            row, absent, stamp = (
                values[: self._width],
                values[self._width : -len(self.fields.stamp) or None],
                values[len(values) - len(self.fields.stamp) :],
            )
            own = sum(
                int(part) * unit if float(part).is_integer() else round(part * unit)
                for part, (_, unit) in zip(stamp, self.fields.stamp, strict=True)
            )
            if not (-(2**63) <= own < 2**63 and -(2**63) <= logged_ns < 2**63):
                raise ValueError("no stamp")
        except CalibrationError:
            raise
        except Exception:
            self.damaged += 1
            return
        self._rows.add(own, row)
        self._logged.add(logged_ns, ())
        for place, value in enumerate(absent[: len(self._absent)]):
            self._absent[place] += value == -1

    def __len__(self) -> int:
        """Messages that were read."""
        return len(self._rows)

    def stream(self, notes: Sequence[str]) -> Stream | None:
        """What was read; a quantity that no message has, or holds as zeros, is none.  None where nothing is left."""
        remarks = list(notes)
        if self.damaged:
            remarks.append(f"{self.damaged} damaged messages are left out, {len(self)} were read")
        values, fields = self._rows.values, self.fields
        absent = {what for (what, _), count in zip(fields.absent, self._absent, strict=True) if count == len(self)}
        parts, first = {}, 0
        for what, (names, unit) in fields.parts.items():
            part = values[:, first : first + len(names)]
            first += len(names)
            if what == "temp":
                parts[what] = Part(part[:, 0], unit)
            elif what not in absent and part.any():
                parts[what] = Part(part, unit, names)
        if not {"gyro", "accel"} & set(parts):
            return None
        t_ns, note = _stamps(self._rows.t_ns, self._logged.t_ns, bool(fields.stamp))
        remarks += [note] if note else []
        frame = "the frame of its header's frame_id" if self.kind == IMU else ""
        return Stream(self.name, t_ns, parts, frame=frame, notes=tuple(remarks), columns=tuple(fields.paths))


def _stamps(own: np.ndarray, logged: np.ndarray, stamped: bool) -> tuple[np.ndarray, str]:
    """The message's own stamps unless the recorder's go forward more often; and a note where it is the recorder's."""
    if not stamped:
        return (
            logged,
            "its messages have no stamp of a known unit: the time is the recorder's, which is late by what the message was on its way",
        )
    back, back_logged = (int(np.count_nonzero(np.diff(t) <= 0)) for t in (own, logged))
    if back > back_logged:
        return logged, f"the messages' own stamps do not go forward {back} times: the time is the recorder's"
    return own, ""


class Bag:
    """What is read of a recording, file by file: path of the file; names of the wanted topics, none for all that hold an IMU; topics that
    are read; seen: all topics in words; notes on damage."""

    def __init__(self, path: Path, names: Sequence[str]) -> None:
        self.path, self.names = path, names
        self.topics: dict[str, Topic] = {}
        self.seen: set[str] = set()
        self.notes: list[str] = []

    def topic(self, name: str, kind: str, layout: Callable[[], Layout], unpack: Unpack = bytes) -> Topic | None:
        """A topic of messages of this type, which ``unpack`` may have to unpack first; None where it is not wanted or holds no IMU, and
        with a note where its layout is not known."""
        if self.names and name not in self.names:
            return None
        if name not in self.topics:
            try:
                read = layout()
                if (fields := fields_of(read.paths, kind)) is None:
                    return None
                read.want(fields.paths)
            except CalibrationError:
                raise
            except Exception as error:
                self.notes.append(f"the messages of {name} cannot be read ({reason(error)})")
                return None
            self.topics[name] = Topic(self.path, name, kind, lambda data: read(unpack(data)), fields)
        return self.topics[name]

    def streams(self, path: Path, what: str) -> list[Stream]:
        """The streams of the topics.  FormatError for a recording where none can be read; path: all of it; what it is, in words."""
        held = [stream for topic in self.topics.values() if (stream := topic.stream(self.notes)) is not None]
        if not held:
            there = f"; its topics are {', '.join(sorted(self.seen)[:20])[:200]}" if self.seen else ""
            why = f" ({'; '.join(self.notes[:20])[:300]})" if self.notes else ""
            missing = f"the topic {self.names[0]}" if self.names else f"a topic of {IMU.replace('/msg', '')} or the like"
            raise FormatError(f"{path}: {what} without {missing} that can be read{why}{there}")
        return held
