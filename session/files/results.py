"""Results as files: JSON read with one line for all that can be wrong with it, written whole or not at all."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from session.common.errors import FormatError
from session.common.texts import escaped_json, unicode_text
from session.files.reading import MOST_JSON, read_bytes
from session.files.recorded import refuse_recorded
from session.files.writing import naming

#: an integer of more digits is read as a float, infinite where it must be: no reader of numbers then meets one that no float can hold
LONGEST_INTEGER = 18


def read_json(path: Path) -> Any:
    """What a JSON file holds.  FormatError says what is wrong with the file."""
    try:
        return read_json_text(read_bytes(path, MOST_JSON).decode(), str(path))
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: broken JSON: {error}") from None


def read_json_text(text: str, where: str) -> Any:
    """What a text of JSON holds.  FormatError, which begins with ``where``, says what is wrong with it."""
    try:
        return json.loads(text, parse_int=_integer, object_pairs_hook=_table)
    except ValueError as error:
        raise FormatError(f"{where}: broken JSON: {error}") from None
    except RecursionError:
        raise FormatError(f"{where}: broken JSON: lists or tables nested too deeply") from None


def _table(pairs: list[tuple[str, Any]]) -> dict:
    """A table, each of whose keys stands once: of two, nobody knows which is meant."""
    table = dict(pairs)
    if len(table) < len(pairs):
        seen: set[str] = set()
        twice = next(name for name, _ in pairs if name in seen or seen.add(name))  # type: ignore[func-returns-value]
        raise ValueError(f"the key {json.dumps(twice[:40], ensure_ascii=False)} stands twice in one table; keep one")
    return table


def _integer(digits: str) -> int | float:
    return int(digits) if len(digits) <= LONGEST_INTEGER else float(digits)


def write_whole(path: Path, table: dict) -> None:
    """JSON, whole or not at all: a full disk must not leave half a model."""
    write_text_whole(path, json_text(table) + "\n")


def json_text(table: Any, ascii_only: bool = False) -> str:
    """JSON, its texts as ``escaped_json`` has them; null for a number that is not finite, which JSON has no word for: what is not known is
    null (docs/formats.md)."""
    try:
        text = json.dumps(table, indent=1, ensure_ascii=False, allow_nan=False)
    except ValueError:
        text = json.dumps(_known(table), indent=1, ensure_ascii=False, allow_nan=False)
    return escaped_json(text, ascii_only)


def _known(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _known(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_known(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def write_text_whole(path: Path, text: str) -> None:
    """Text in UTF-8, whole or not at all; of a name that was no UTF-8 its escapes."""
    with whole(path) as partial:
        partial.write_text(unicode_text(text), encoding="utf-8")


@contextlib.contextmanager
def whole(path: Path) -> Iterator[Path]:
    """Where to write what becomes ``path`` once the block ends well: a file beside it; a device or a pipe itself, which is no file to
    put another in the place of.  A full disk is a StorageError that names ``path``, and so is a recording's own file in its place."""
    refuse_recorded(path)
    if is_stream(path):
        with naming(path):
            yield path
        return
    partial = path.with_name(f".{path.name}.partial")
    try:
        with naming(path, partial):
            yield partial
            partial.replace(path)
    finally:
        with contextlib.suppress(OSError):
            partial.unlink(missing_ok=True)


def is_stream(path: Path) -> bool:
    """Whether it is there and is a device, a pipe or a socket."""
    return path.exists() and not path.is_file() and not path.is_dir()
