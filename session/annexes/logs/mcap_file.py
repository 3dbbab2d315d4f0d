"""MCAP (https://mcap.dev/spec), by the records of the mcap package: messages of ROS 2 and ROS 1 by the definitions in the file, and JSON.

The file is read from its beginning, chunk by chunk, so one without its summary gives what it holds up to where it is cut.
"""

from __future__ import annotations

import contextlib
import io
import struct
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from session.annexes.logs.ros import MOST_CHUNK, Layout, Topic, definitions_of, fields_of, json_decoder, refuse_empty
from session.annexes.logs.source import Cut, DamagedChunks, Source, as_topics, library, no_columns, one_line, picked, reason
from session.io import streams
from session.io.errors import FormatError
from session.io.streams import Stream

NAME = "MCAP"
PACKAGE, EXTRA, LICENCE = "mcap", "logs", "MIT"
EXAMPLE = "ros2 bag record --storage mcap /imu/data_raw: rosbag2_2026_11_26-10_15_02_0.mcap; also with JSON messages"
MAGIC = b"\x89MCAP0\r\n"
#: a chunk's record: its code, and where its compression's name begins, behind lengths, times and checksum
CHUNK, CHUNK_HEAD = 6, 1 + 8 + 8 + 8 + 8 + 4 + 4
#: encodings of messages that are read
ENCODINGS = ("cdr", "ros1", "json")


def is_mine(path: Path, head: bytes) -> bool:
    """By the eight bytes that an MCAP file begins with."""
    return head.startswith(MAGIC)


def topics(path: Path, columns: str | None) -> list[streams.Topic]:
    """The topics that hold an IMU."""
    no_columns(path, "an MCAP file", columns)
    found, held = _read(path, None)
    return as_topics(held, {topic.name: tuple(topic.fields.paths) for topic in found})


def read(path: Path, names: Sequence[str], columns: str | None) -> list[Stream]:
    """The streams of these topics; all that hold an IMU for no name."""
    no_columns(path, "an MCAP file", columns)
    return picked(path, _read(path, names or None)[1], names)


def _read(path: Path, names: Sequence[str] | None) -> tuple[list[Topic], list[Stream]]:
    found: dict[str, Topic] = {}
    seen: dict[str, None] = {}
    notes: list[str] = []
    walk(path, names, found, seen, notes)
    held = [stream for topic in found.values() if (stream := topic.stream(notes)) is not None]
    if not held:
        raise refuse_empty(path, "an MCAP file", names, sorted(seen), notes)
    return list(found.values()), held


def walk(path: Path, names: Sequence[str] | None, found: dict[str, Topic], seen: dict[str, None], notes: list[str]) -> None:
    """Read the messages of a file into their topics (found), with the topics that are there (seen) and notes on damage."""
    reader = library(path, "an MCAP file", "mcap.stream_reader", PACKAGE)
    damaged = DamagedChunks()
    with one_line(path, "an MCAP file"), Source(path) as source:
        channels = _Channels(path, names, found, seen, notes)
        at, ended = len(MAGIC), False
        try:
            records = reader.StreamReader(source, emit_chunks=True, record_size_limit=source.size).records
            for record in records:
                ended |= type(record).__name__ == "DataEnd"
                if isinstance(record, reader.Chunk):
                    _chunk(reader, record, channels, at, damaged)
                else:
                    channels.take(record)
                at = source.tell()
        except FormatError:
            raise
        except Exception as error:
            if ended:
                notes.append(f"the summary at the file's end is damaged (byte {at}); all messages stand before it")
            elif isinstance(error, (Cut, reader.RecordLengthLimitExceeded)):
                notes.append(f"the file is cut in the record at byte {at}")
                _cut_chunk(reader, source, at, channels)
            else:
                notes.append(f"the file is damaged at byte {at} and is read up to there ({reason(error)})")
    notes += damaged.notes


def _chunk(reader: Any, chunk: Any, channels: _Channels, at: int, damaged: DamagedChunks) -> None:
    """The records of a chunk, which is read whole or not at all."""
    try:
        if chunk.uncompressed_size > MOST_CHUNK:
            raise ValueError(f"unpacks to more than {MOST_CHUNK} bytes")
        whole = replace(chunk, compression="", data=unpacked(chunk.compression, chunk.data, chunk.uncompressed_size))
        records = reader.breakup_chunk(whole, validate_crc=True)
    except FormatError:
        raise
    except Exception as error:
        damaged.add(at, error)
        channels.take_summary()
        return
    for record in records:
        channels.take(record)


def _cut_chunk(reader: Any, source: Source, at: int, channels: _Channels) -> None:
    """The records of the chunk there, as far as the file goes: a recorder that was killed leaves its last chunk behind so."""
    source.seek(at)
    data = source.read(min(source.size - at, MOST_CHUNK))
    with contextlib.suppress(Exception):
        (named,) = struct.unpack_from("<I", data, CHUNK_HEAD - 4)
        compression = data[CHUNK_HEAD : CHUNK_HEAD + named].decode()
        if data[0] != CHUNK:
            return
        begun = data[CHUNK_HEAD + named + 8 :]
        if compression == "zstd":
            begun = library(source.path, "an MCAP file", "zstandard", "zstandard").ZstdDecompressor().decompressobj().decompress(begun)
        elif compression:
            begun = unpacked(compression, begun, MOST_CHUNK)
        for record in reader.StreamReader(io.BytesIO(begun), skip_magic=True, record_size_limit=len(begun)).records:
            channels.take(record)


def unpacked(compression: str, data: bytes, most: int) -> bytes:
    """Bytes that were packed as zstd or lz4, or not.  ValueError for another compression, and for more than ``most`` bytes."""
    if compression == "":
        return data
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
    return whole


class _Channels:
    """Schemas and channels as they come, and the topic of each channel: None where it holds no IMU or is not wanted."""

    def __init__(self, path: Path, names: Sequence[str] | None, found: dict[str, Topic], seen: dict[str, None], notes: list[str]) -> None:
        self._path, self._names, self._found, self._seen, self._notes = path, names, found, seen, notes
        self._schemas: dict[int, Any] = {}
        self._channels: dict[int, Any] = {}
        self._topics: dict[int, Topic | None] = {}
        self._messages = 0

    def take(self, record: Any) -> None:
        """One record: a schema, a channel, a message; others are passed over."""
        kind = type(record).__name__
        if kind == "Message":
            self._messages += 1
            number = record.channel_id
            if number not in self._topics:
                self._topics[number] = self._topic(number, record.data)
            if (topic := self._topics[number]) is not None:
                topic.add(record.log_time, record.data)
        elif kind == "Statistics" and record.message_count > self._messages:
            self._notes.append(f"{self._messages} of {record.message_count} messages, which the file counts itself, were read")
        elif kind == "Schema":
            self._schemas.setdefault(record.id, record)
        elif kind == "Channel" and record.id not in self._channels:
            schema = self._schemas.get(record.schema_id)
            self._channels[record.id] = record
            self._seen[f"{record.topic} ({schema.name if schema else record.message_encoding}, {record.message_encoding})"] = None

    def take_summary(self) -> None:
        """Schemas and channels as the file's summary repeats them, where it can be read: a damaged chunk may have held them."""
        with contextlib.suppress(Exception), Source(self._path) as source:
            summary = library(self._path, "an MCAP file", "mcap.reader", PACKAGE).make_reader(source).get_summary()
            for record in (*summary.schemas.values(), *summary.channels.values()):
                self.take(record)

    def _topic(self, number: int, first: bytes) -> Topic | None:
        channel = self._channels.get(number)
        if channel is None or (self._names is not None and channel.topic not in self._names) or channel.message_encoding not in ENCODINGS:
            return None
        if channel.topic in self._found:
            return self._found[channel.topic]
        schema = self._schemas.get(channel.schema_id)
        name, text, encoding = ("", b"", "") if schema is None else (schema.name, schema.data, schema.encoding)
        try:
            if channel.message_encoding == "json":
                paths, want = json_decoder(first)
                fields = fields_of(paths, name)
                if fields is None:
                    return None
                decode: Callable[[bytes], Sequence[float]] = want(fields.paths)
            else:
                ros1 = channel.message_encoding == "ros1"
                kind = name if "/msg/" in name else name.replace("/", "/msg/", 1)
                layout = Layout(definitions_of(self._path, kind, text.decode(), encoding == "ros2idl", ros1), kind, cdr=not ros1)
                fields, name = fields_of(layout.paths, kind), kind
                if fields is None:
                    return None
                layout.want(fields.paths)
                decode = layout
        except FormatError:
            raise
        except Exception as error:
            self._notes.append(f"the messages of {channel.topic} cannot be read ({reason(error)})")
            return None
        return self._found.setdefault(channel.topic, Topic(self._path, channel.topic, name, decode, fields))
