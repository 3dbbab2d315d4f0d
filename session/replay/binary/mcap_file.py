"""MCAP (https://mcap.dev/spec), by the records of the mcap package: messages of ROS 2 and ROS 1 by the definitions in the file.

The file is read from its beginning, chunk by chunk, so one without its summary gives what it holds up to where it is cut.
"""

from __future__ import annotations

import contextlib
import io
import struct
import zlib
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from session.base.budget import RECORD, amount, current
from session.base.errors import FormatError
from session.replay.binary.ros import Bag, Topic, layout_of
from session.replay.binary.source import Cut, DamagedChunks, Messages, Source, Stream, begins, library, one_line, reason

PACKAGE = "mcap"
MAGIC = b"\x89MCAP0\r\n"
#: codes of records that are used, and what the mcap package calls them
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, STATISTICS, DATA_END = 2, 3, 4, 5, 6, 11, 15
USED = {FOOTER: "", SCHEMA: "Schema", CHANNEL: "Channel", MESSAGE: "", CHUNK: "Chunk", STATISTICS: "Statistics", DATA_END: ""}
#: what stands before a record's body, code and length, and before a message's data in it: channel, number, two times
HEAD, MESSAGE_HEAD = struct.Struct("<BQ"), struct.Struct("<HIQQ")
#: packed bytes that are unpacked at once
AT_ONCE = 1 << 16
#: where in a chunk's record its compression's name begins, behind lengths, times and checksum
CHUNK_HEAD = 1 + 8 + 8 + 8 + 8 + 4 + 4
#: encodings of messages that are read
ENCODINGS = ("cdr", "ros1")


def _read(path: Path, names: Sequence[str]) -> list[Stream]:
    """The streams of these topics; of all that hold an IMU for no name."""
    bag = Bag(path, names)
    walk(bag)
    return bag.streams(path, "an MCAP file")


def walk(bag: Bag) -> None:
    """Read the messages of a file into their topics."""
    path, notes = bag.path, bag.notes
    reader = library(path, "an MCAP file", "mcap.stream_reader", PACKAGE)
    damaged = DamagedChunks()
    with one_line(path, "an MCAP file"), Source(path) as source:
        channels = _Channels(bag, reader)
        at, ended = len(MAGIC), False
        try:
            source.seek(at)
            for code, body in _records(source):
                ended |= code == DATA_END
                if code == FOOTER:
                    break
                if code == CHUNK:
                    _chunk(channels.parsed(code, body), channels, at, damaged)
                else:
                    channels.take(code, body)
                at = source.tell()
        except FormatError:
            raise
        except Exception as error:
            if ended:
                notes.append(f"the summary at the file's end is damaged (byte {at}); all messages stand before it")
            elif isinstance(error, Cut):
                notes.append(f"the file is cut in the record at byte {at}")
                _cut_chunk(source, at, channels)
            else:
                notes.append(f"the file is damaged at byte {at} and is read up to there ({reason(error)})")
    notes += damaged.notes


def _records(source: Source) -> Iterator[tuple[int, bytes]]:
    """Code and body of each record of a file, no body of one that is not used.  Cut where one is cut."""
    while source.tell() < source.size:
        code, length = HEAD.unpack(source.read(HEAD.size))
        if code not in USED:
            source.seek(length, 1)
        yield code, source.read(length) if code in USED else b""


def _within(path: Path, data: bytes) -> Iterator[tuple[int, bytes]]:
    """Those of a chunk.  ValueError or struct.error where one is cut."""
    at, budget = 0, current()
    while at < len(data):
        code, length = HEAD.unpack_from(data, at)
        at, begin = at + HEAD.size + length, at + HEAD.size
        budget.unpack(path, RECORD)
        if at > len(data):
            raise ValueError("a record is cut")
        if code in USED:
            yield code, data[begin:at]


def _chunk(chunk: Any, channels: _Channels, at: int, damaged: DamagedChunks) -> None:
    """The records of a chunk; of one whose checksum is another, none."""
    try:
        data = unpacked(channels.path, chunk.compression, chunk.data, chunk.uncompressed_size)
        if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
            raise ValueError("its checksum is another")
        for code, body in _within(channels.path, data):
            channels.take(code, body)
    except FormatError:
        raise
    except Exception as error:
        damaged.add(at, error)
        channels.take_summary()


def _cut_chunk(source: Source, at: int, channels: _Channels) -> None:
    """The records of the chunk there, as far as the file goes: a recorder that was killed leaves its last chunk behind so."""
    source.seek(at)
    data = source.read(min(source.size - at, current().piece))
    try:
        (named,) = struct.unpack_from("<I", data, CHUNK_HEAD - 4)
        compression = data[CHUNK_HEAD : CHUNK_HEAD + named].decode()
        if data[0] != CHUNK:
            return
        begun = data[CHUNK_HEAD + named + 8 :]
        begun = _begun(source.path, compression, begun)
        for code, body in _within(source.path, begun):
            channels.take(code, body)
    except FormatError:
        raise
    except Exception:  # up to where the file ends
        return


def _begun(path: Path, compression: str, packed: bytes) -> bytes:
    """What the beginning of packed bytes unpacks to."""
    if compression != "zstd":
        return unpacked(path, compression, packed)
    unpack = library(path, "an MCAP file", "zstandard", "zstandard").ZstdDecompressor().decompressobj()
    whole = bytearray()
    for begin in range(0, len(packed), AT_ONCE):
        whole += unpack.decompress(packed[begin : begin + AT_ONCE])
        current().need(path, 3 * len(whole))
    return bytes(whole)


def unpacked(path: Path, compression: str, data: bytes, most: int | None = None) -> bytes:
    """Bytes that were packed as zstd or lz4, or not; most: what they state that they unpack to.

    ValueError for another compression, and for more than that or than one chunk may have; FormatError beyond the budget.
    """
    if compression == "":
        return data
    budget = current()
    most = budget.piece if most is None else most
    if most > budget.piece:
        raise ValueError(f"unpacks to more than {amount(budget.piece)}, the memory that is left")
    if compression == "lz4":
        import lz4.frame

        unpack: Callable[[bytes, int], bytes] = lz4.frame.LZ4FrameDecompressor().decompress
        whole = unpack(data, most + 1)
    elif compression == "zstd":
        import zstandard

        size = zstandard.get_frame_parameters(data).content_size
        if size not in (zstandard.CONTENTSIZE_UNKNOWN, zstandard.CONTENTSIZE_ERROR) and size > most:
            raise ValueError(f"unpacks to more than {most} bytes")
        whole = zstandard.ZstdDecompressor().decompress(data, max_output_size=most + 1)
    else:
        raise ValueError(f"compression {compression!r} is not known")
    if len(whole) > most:
        raise ValueError(f"unpacks to more than {most} bytes")
    budget.unpack(path, len(whole))
    return whole


class _Channels:
    """Schemas and channels as they come, and the topic of each channel: None where it holds no IMU or is not wanted."""

    def __init__(self, bag: Bag, reader: Any) -> None:
        self.path, self._bag, self._reader = bag.path, bag, reader
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._topics: dict[int, Topic | None] = {}
        self._messages = 0
        self._summarized = self._counted = False

    def parsed(self, code: int, body: bytes) -> Any:
        """A record of the mcap package."""
        return getattr(self._reader, USED[code]).read(self._reader.ReadDataStream(io.BytesIO(body)))

    def take(self, code: int, body: bytes) -> None:
        """One record: a schema, a channel, a message, statistics; others are passed over."""
        if code == MESSAGE:
            number, _, logged_ns, _ = MESSAGE_HEAD.unpack_from(body)
            self._messages += 1
            data = body[MESSAGE_HEAD.size :]
            if number not in self._topics:
                self._topics[number] = self._topic(number)
            if (topic := self._topics[number]) is not None:
                topic.add(logged_ns, data)
        elif code in (SCHEMA, CHANNEL):
            there = self._schemas if code == SCHEMA else self._channels
            if int.from_bytes(body[:2], "little") not in there:
                current().take(self.path, 3 * len(body))
                self._describe(self.parsed(code, body))
        elif code == STATISTICS and not self._counted:
            self._counted = True
            self._describe(self.parsed(code, body))

    def _describe(self, record: Any) -> None:
        kind = type(record).__name__
        if kind == "Statistics" and record.message_count > self._messages:
            self._bag.notes.append(f"{self._messages} of {record.message_count} messages, which the file counts itself, were read")
        elif kind == "Schema":
            self._schemas.setdefault(record.id, record)
        elif kind == "Channel" and record.id not in self._channels:
            schema = self._schemas.get(record.schema_id)
            self._channels[record.id] = record
            self._bag.seen.add(f"{record.topic} ({schema.name if schema else record.message_encoding}, {record.message_encoding})")

    def take_summary(self) -> None:
        """Schemas and channels as the file's summary repeats them, where it can be read: a damaged chunk may have held them."""
        if self._summarized:
            return
        self._summarized = True
        with contextlib.suppress(Exception), Source(self.path) as source:
            summary = library(self.path, "an MCAP file", "mcap.reader", PACKAGE).make_reader(source).get_summary()
            for record in (*summary.schemas.values(), *summary.channels.values()):
                self._describe(record)

    def _topic(self, number: int) -> Topic | None:
        channel = self._channels.get(number)
        if channel is None or channel.message_encoding not in ENCODINGS:
            return None
        schema = self._schemas.get(channel.schema_id)
        kind, text, idl = ("", b"", False) if schema is None else (schema.name, schema.data, schema.encoding == "ros2idl")
        kind = kind if "/msg/" in kind else kind.replace("/", "/msg/", 1)
        ros1 = channel.message_encoding == "ros1"
        return self._bag.topic(channel.topic, kind, lambda: layout_of(self.path, kind, text.decode(), idl, ros1))


FORMAT = Messages(
    "MCAP",
    "an MCAP file",
    PACKAGE,
    "logs",
    "MIT",
    "ros2 bag record --storage mcap /imu/data_raw: rosbag2_2026_11_26-10_15_02_0.mcap",
    begins(MAGIC),
    _read,
)
