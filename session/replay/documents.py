"""JSON documents: each list of records in them, or set of lists of one length, as a table in a file of its own."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

from session.base.budget import current
from session.base.errors import FormatError
from session.base.files import read_bytes, write_new
from session.log.one_sensor import MOST_SENSORS, SENSORS
from session.replay.forms import Number, flattened
from session.replay.headings import plain

#: of the first bytes: how far from their end a document may seem broken, since they cut it
NEAR_END = 200
#: what a parsed document takes: bytes for each of the file, and for each record or list of it; measured
PARSED, RECORD = 10, 400
#: of a document: lists inside lists, and tables
DEPTH, MOST_TABLES = 6, 100


def is_document(head: bytes) -> bool:
    """Whether a file that begins with these bytes, which may end anywhere, is one JSON document, and no object a line."""
    text = head.decode("utf-8-sig", "ignore").strip()
    if not text.startswith(("{", "[")):
        return False
    lines = text.splitlines()
    if len(lines) > 1 and any(flattened(line) for line in lines[:3]):
        return False
    try:
        return isinstance(json.loads(text), dict | list)
    except json.JSONDecodeError as error:
        return error.pos >= min(len(text) - 1, max(len(text) - NEAR_END, len(text) // 2))
    except RecursionError:
        return False


def unpack_document(path: Path, folder: Path) -> None:
    """Write its tables into a folder, ``rotations.csv``.  FormatError for what is no JSON, and where it holds none."""
    data = read_bytes(path, current().most)
    current().take(path, PARSED * len(data) + RECORD * (data.count(b"{") + data.count(b"[")))
    try:
        document = json.loads(data.decode("utf-8-sig"), parse_float=Number, parse_int=Number)
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path.name}: a damaged JSON document ({str(error)[:80]}); save it again, or as a table") from None
    names: dict[str, int] = {}
    for called, rows in _tables(document, path.name.split(".")[0], DEPTH):
        name = re.sub(r"[^\w.-]+", "_", called)[:60]
        names[name] = names.get(name, 0) + 1
        text = "\n".join(",".join(row) for row in rows)
        write_new(folder / f"{name}{names[name] if names[name] > 1 else ''}.csv", f"{text}\n".encode())
        if sum(names.values()) > MOST_TABLES:
            raise FormatError(f"{path.name}: a JSON document of more than {MOST_TABLES} lists; save the sensor's as a table")
    if not names:
        raise FormatError(f"{path.name}: a JSON document without a list of readings; expected such as {{'gyro': [{{'t': …, 'x': …}}, …]}}")


def _tables(node: object, called: str, depth: int) -> Iterator[tuple[str, Iterator[list[str]]]]:
    """The tables in a document, each with its name."""
    if isinstance(node, list) and len(node) > 1 and all(isinstance(each, dict | list) for each in node):
        sensors: dict[str, list[object]] = {}
        for record in node:
            sensors.setdefault(_sensor(record), []).append(record)
        for sensor, records in sensors.items() if len(sensors) <= MOST_SENSORS else [("", node)]:
            if names := [name for name, _, _ in flattened(records[0]) if plain(name) not in SENSORS]:
                yield sensor or called, _records(records, names)
                depth = 0
    if isinstance(node, dict):
        lists = {name: each for name, each in node.items() if isinstance(each, list) and len(each) > 1 and isinstance(each[0], Number)}
        if len(lists) > 1 and len({len(each) for each in lists.values()}) == 1:
            yield called, ([str(cell) for cell in row] for row in [list(lists), *zip(*lists.values(), strict=True)])
            return
    if isinstance(node, dict) and depth:
        for name, inner in node.items():
            yield from _tables(inner, name, depth - 1)


def _sensor(record: object) -> str:
    """What a record says of whose it is."""
    items = record.items() if isinstance(record, dict) else ()
    return next((value for key, value in items if isinstance(value, str) and plain(key) in SENSORS), "")


def _records(records: list[object], names: list[str]) -> Iterator[list[str]]:
    yield names
    for record in records:
        cells = {name: value for name, value, _ in flattened(record)}
        yield [cells.get(name, "") for name in names]
