"""ROS 1 bags of version 2.0 (http://wiki.ros.org/Bags/Format/2.0), by the records of rosbags.

rosbags' own reader goes by the index at the end, and refuses a bag that a crash has left without one.  Here its records are read one after
the other, chunk by chunk, so a bag gives what it holds up to where it is cut.
"""

from __future__ import annotations

import bz2
import contextlib
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from session.base.budget import RECORD, amount, current
from session.base.errors import CalibrationError
from session.base.units import NS_PER_S
from session.replay.binary.ros import Bag, Topic, layout_of
from session.replay.binary.source import Cut, DamagedChunks, Messages, Source, Stream, begins, library, one_line, reason

PACKAGE = "rosbags"
MAGIC = b"#ROSBAG V2.0\n"
MESSAGE, CHUNK, CONNECTION = 2, 5, 7
#: next to these the bag's head, and parts of its index
KNOWN = (MESSAGE, 3, 4, CHUNK, 6, CONNECTION)
#: after so many notes on damage the rest is left out
MOST_NOTES = 20


def _read(path: Path, names: Sequence[str]) -> list[Stream]:
    """The streams of these topics; of all that hold an IMU for no name.  FormatError where none does."""
    bag = _Bag(path, names)
    with one_line(path, "a ROS 1 bag"), Source(path) as source:
        try:
            bag.walk(source)
        except CalibrationError:
            raise
        except Cut as error:
            bag.notes.append(f"the bag is cut in the record at byte {bag.at} ({error})")
        except Exception as error:
            bag.notes.append(f"the bag is damaged at byte {bag.at} and is read up to there ({reason(error)})")
    bag.notes = [*bag.damaged.notes, *bag.notes]
    return bag.streams(path, "a ROS 1 bag")


class _Bag(Bag):
    """With the topic of each connection, None where it holds no IMU or is not wanted; at: byte of a record."""

    def __init__(self, path: Path, names: Sequence[str]) -> None:
        super().__init__(path, names)
        self._reader = library(path, "a ROS 1 bag", "rosbags.rosbag1.reader", PACKAGE)
        self._connections: dict[int, Topic | None] = {}
        self.damaged = DamagedChunks()
        self._indexed = False
        self.at = 0

    def walk(self, source: Source) -> None:
        """Read every record.  Cut where the file ends within one."""
        source.seek(len(MAGIC))
        while source.tell() < source.size:
            self.at = source.tell()
            current().unpack(self.path, RECORD)
            header = self._reader.Header.read(source)
            size = self._reader.read_uint32(source)
            kind = header.get_uint8("op")
            if kind == CHUNK:
                left = source.size - source.tell()
                self._chunk(header, source.read(min(size, left)))
                if size > left:
                    raise Cut(f"the file ends {size - left} bytes too early")
            elif kind in (CONNECTION, MESSAGE):
                self._record(kind, header, source.read(size))
            else:
                if kind not in KNOWN and len(self.notes) < MOST_NOTES:
                    self.notes.append(f"the bag is damaged at byte {self.at}: a record of an unknown kind ({kind}) is passed over")
                source.seek(size, 1)

    def _chunk(self, header: Any, data: bytes) -> None:
        """The records of a chunk; of one that is damaged or cut those before the damage."""
        try:
            records, ends = _unpacked(self.path, header.get_string("compression"), data)
            inner = io.BytesIO(records)
            length = len(inner.getbuffer())
            while inner.tell() < length:
                current().unpack(self.path, RECORD)
                record = self._reader.Header.read(inner)
                body = self._reader.read_bytes(inner, self._reader.read_uint32(inner))
                self._record(record.get_uint8("op"), record, body)
            if not ends:
                raise ValueError("its packed bytes do not end")
        except CalibrationError:
            raise
        except Exception as error:
            self.damaged.add(self.at, error)
            if self._indexed:
                return
            self._indexed = True
            # The connections as the index repeats them, where it can be read: a damaged chunk may have held them
            with contextlib.suppress(Exception), Source(self.path) as source:
                source.seek(len(MAGIC))
                head = self._reader.Header.read(source)
                source.seek(head.get_uint64("index_pos"))
                for _ in range(head.get_uint32("conn_count")):
                    record = self._reader.Header.read(source)
                    self._record(record.get_uint8("op"), record, source.read(self._reader.read_uint32(source)))

    def _record(self, kind: int, header: Any, body: bytes) -> None:
        if kind == CONNECTION:
            self._connect(header.get_uint32("conn"), header.get_string("topic"), body)
        elif kind == MESSAGE:
            topic = self._connections.get(header.get_uint32("conn"))
            if topic is not None:
                stamp = header["time"]
                topic.add(int.from_bytes(stamp[:4], "little") * NS_PER_S + int.from_bytes(stamp[4:8], "little"), body)

    def _connect(self, number: int, name: str, body: bytes) -> None:
        """A connection: which topic, of which type; two publishers of one topic go into one stream."""
        if number in self._connections:
            return
        current().take(self.path, 3 * len(body))
        header = self._reader.Header.read(io.BytesIO(len(body).to_bytes(4, "little") + body))
        kind = self._reader.normalize_msgtype(header.get_string("type"))
        self.seen.add(f"{name} ({header.get_string('type')})")
        self._connections[number] = self.topic(
            name, kind, lambda: layout_of(self.path, kind, header.get_string("message_definition"), ros1=True)
        )


def _unpacked(path: Path, compression: str, data: bytes) -> tuple[bytes, bool]:
    """A chunk's records, and whether they are all of them.

    ValueError for a compression that is not known, and for a chunk that unpacks to more than one may; FormatError beyond the budget.
    """
    if compression == "none":
        return data, True
    if compression == "bz2":
        unpack: Any = bz2.BZ2Decompressor()
    elif compression == "lz4":
        import lz4.frame

        unpack = lz4.frame.LZ4FrameDecompressor()
    else:
        raise ValueError(f"compression {compression!r} is not known")
    budget = current()
    whole = unpack.decompress(data, budget.piece)
    budget.unpack(path, len(whole))
    if len(whole) >= budget.piece:
        raise ValueError(f"unpacks to more than {amount(budget.piece)}, the memory that is left")
    return whole, unpack.eof


FORMAT = Messages(
    "ROS 1 bag",
    "a ROS 1 bag",
    PACKAGE,
    "logs",
    "Apache-2.0",
    "rosbag record /imu/data_raw: 2026-11-26-10-15-02.bag, with topics of sensor_msgs/Imu",
    begins(MAGIC),
    _read,
)
