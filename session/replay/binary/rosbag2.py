"""ROS 2 bags: SQLite files (``.db3``) or MCAP files, one or several, in a folder with ``metadata.yaml``.

SQLite's own module of Python reads the rows in the order in which they were written, without the index, up to the first damaged page;
rosbags parses the definitions of the messages.
"""

from __future__ import annotations

import re
import sqlite3
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from session.base.budget import PACKED, RECORD, current, stored
from session.base.errors import FormatError
from session.base.files import MOST_TOML, open_file, read_text, require_file
from session.replay.binary import mcap_file
from session.replay.binary.ros import Bag, Topic, layout_of
from session.replay.binary.source import Messages, Stream, library, one_line, reason

PACKAGE = "rosbags"
MAGIC = b"SQLite format 3\0"
METADATA = "metadata.yaml"
#: how a table's SQL begins, and what no column of one is called: it would be another order of rows
PLAIN = re.compile(r"CREATE\s+TABLE\b", re.IGNORECASE)
ROWID = ("rowid", "oid", "_rowid_")
#: bytes of a row that holds nothing, and of the place that its page keeps of it
LEAST_ROW = 6
#: of SQLite's machine, between two looks at the budget: some 10 ms
STEPS = 1 << 20
#: what a message that is packed by itself begins with
ZSTD = b"\x28\xb5\x2f\xfd"


def is_mine(path: Path, head: bytes) -> bool:
    """A folder with ``metadata.yaml``, or a SQLite file."""
    return (path / METADATA).is_file() if path.is_dir() else head.startswith(MAGIC)


def _read(path: Path, names: Sequence[str]) -> list[Stream]:
    """The streams of these topics, over all files of the bag; of all that hold an IMU for no name.  FormatError where none does."""
    bag = Bag(path, names)
    for bag.path in _files(path):
        earlier, bag.notes = bag.notes, []
        (mcap_file.walk if bag.path.suffix == ".mcap" else _walk)(bag)
        bag.notes = earlier + [f"{bag.path.name}: {note}" if path.is_dir() else note for note in bag.notes]
    return bag.streams(path, "a ROS 2 bag")


def _files(path: Path) -> list[Path]:
    """The files of a bag in their order.  FormatError for a folder whose files are not there, or are packed as a whole."""
    if not path.is_dir():
        return [path]
    text = read_text(path / METADATA, MOST_TOML)
    # A list of plain names.  What else stands in the file is not needed, and a damaged one still names its files.
    block = re.search(r"relative_file_paths:\s*+((?:- .*+\s*+)++)", text)
    named = [name.strip().strip("'\"") for name in re.findall(r"- (.*)", block[1])] if block else []
    files = [path / name for name in dict.fromkeys(Path(name).name for name in named)] or sorted(
        [*path.glob("*.db3"), *path.glob("*.mcap")]
    )
    if packed := [file for file in files if file.suffix in (".zstd", ".zst")]:
        raise FormatError(f"{packed[0]}: a file of a ROS 2 bag that is packed as a whole; unpack it (zstd -d) and give the unpacked file")
    if not files:
        raise FormatError(f"{path}: a ROS 2 bag whose folder holds no .db3 and no .mcap file; copy it again")
    for file in files:
        require_file(file)
    return files


def _walk(bag: Bag) -> None:
    """Read the messages of one SQLite file into their topics."""
    path = bag.path
    library(path, "a ROS 2 bag", "rosbags.typesys", PACKAGE)
    require_file(path)
    with one_line(path, "a ROS 2 bag"):
        database = sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
        rows = 0
        # Note a file that is shorter than the pages which its head counts
        with open_file(path) as file:
            head = file.read(32)
        page, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
        whole, size = pages * (65_536 if page == 1 else page), path.stat().st_size
        if size < whole:
            bag.notes.append(f"the file is cut: it has {size} of {whole} bytes")
        try:
            database.execute("PRAGMA trusted_schema = OFF")
            database.execute("PRAGMA writable_schema = ON")  # nothing is written: without it SQLite does not open a file that is cut
            # Rows are bytes of the file, and their work is bounded: a page may be among its own pages
            budget = current()
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, budget.piece)
            database.set_progress_handler(lambda: budget.spends(STEPS), STEPS)
            tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            if not {"topics", "messages"} <= tables:
                raise FormatError(f"{path}: a SQLite file without the tables topics and messages of a ROS 2 bag; is it the right file?")
            # The wanted topics by their numbers
            texts = dict(_definitions(path, database)) if "message_definitions" in tables else {}
            wanted: dict[int, Topic] = {}
            for number, name, kind, form in list(_rows(path, database, "topics", "id, name, type, serialization_format")):
                current().take(path, RECORD + len(f"{name}{kind}"))
                bag.seen.add(f"{name} ({kind})")
                encoding, text = texts.get(kind, ("", ""))
                layout = partial(layout_of, path, kind, text, encoding == "ros2idl")
                if form == "cdr" and (topic := bag.topic(name, kind, layout, partial(_unpacked, path))) is not None:
                    wanted[number] = topic
            for number, stamp, data in _rows(path, database, "messages", "topic_id, timestamp, data"):
                if not isinstance(stamp, int) or not isinstance(data, bytes):
                    raise ValueError("a row that is none")  # of a page that is cut, or of zeros
                rows += 1
                if number in wanted:
                    wanted[number].add(stamp, data)
        except (sqlite3.Error, TypeError, ValueError, OverflowError) as error:
            current().unpack(path, 0)  # where that has ended it
            bag.notes.append(f"the bag is damaged and is read up to its message {rows} ({reason(error)})")
        finally:
            database.close()


def _definitions(path: Path, database: sqlite3.Connection) -> Iterator[tuple[str, tuple[str, str]]]:
    columns = "topic_type, encoding, encoded_message_definition"
    for kind, encoding, text in _rows(path, database, "message_definitions", columns):
        current().take(path, 3 * len(text))
        yield kind, (encoding, text)


def _rows(path: Path, database: sqlite3.Connection, table: str, columns: str) -> Iterator[tuple[Any, ...]]:
    """The rows of a table in the order in which they were written.  FormatError for what is no plain table of plain columns, whose rows
    a program in the file makes, and beyond the budget."""
    (made,) = database.execute("SELECT sql FROM sqlite_master WHERE name = ? AND type = 'table'", (table,)).fetchone()
    described = database.execute(f"PRAGMA table_xinfo({table})").fetchall()
    if not PLAIN.match(str(made)) or any(hidden or name.lower() in ROWID for _, name, _, _, _, _, hidden in described):
        raise FormatError(f"{path}: {table} is no plain table, as a ROS 2 bag has it; is it the right file?")
    # A page that is among the pages below itself gives its rows again and again
    left = min(path.stat().st_size, PACKED * stored(path))
    for row in database.execute(f"SELECT {columns} FROM {table} ORDER BY rowid"):
        size = sum(len(value) for value in row if isinstance(value, (bytes, str)))
        left -= LEAST_ROW + size
        if left < 0:
            raise FormatError(f"{path}: {table} has more rows than the file has room for: its pages are damaged; copy it again")
        current().unpack(path, RECORD + size)
        yield row


def _unpacked(path: Path, data: bytes) -> bytes:
    """A message, which may be packed by itself."""
    if data[:4] != ZSTD:
        return data
    return mcap_file.unpacked(path, "zstd", data)


FORMAT = Messages(
    "ROS 2 bag",
    "a ROS 2 bag",
    PACKAGE,
    "logs",
    "Apache-2.0",
    "ros2 bag record /imu/data_raw: rosbag2_2026_11_26-10_15_02/, or its rosbag2_2026_11_26-10_15_02_0.db3",
    is_mine,
    _read,
)
