"""Results as JSON: read, checked against a declared shape, written whole or not at all."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from session.io.errors import FormatError
from session.io.files import MOST_JSON, naming, read_bytes, refuse_recorded
from session.io.texts import escaped_json, unicode_text

# Results as files: JSON read with one line for all that can be wrong with it, written whole or not at all.

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


# What JSON must hold: one validator for every JSON that the tool reads.
#
# A file's shape is data: tables of keys, lists, arrays of numbers, texts.  ``require`` holds a value against it, and says in one line
# which key of which file is what, what was expected there, and what to do.  Keys that a shape does not name are ignored (docs/formats.md).

#: no number of a calibration comes near it in SI, and its square is still far from a float's end
LARGEST = 1e12
MOST_SHOWN = 40
_FIT_AGAIN = "fit again, or mend the file"


class _Wrong(Exception):
    """Which key, what is there, and what was expected."""


@dataclass(frozen=True)
class Number:
    """A finite number from low to high; ``whole``: without decimals; ``above``: low itself is too low.  true and "1" are no numbers."""

    low: float = -LARGEST
    high: float = LARGEST
    whole: bool = False
    above: bool = False

    def check(self, value: Any, where: str) -> None:
        """Raises what ``require`` puts into words."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise _Wrong(f"{where} is {shown(value)}, expected {self.says}")
        if not math.isfinite(value):
            raise _Wrong(f"{where} is {shown(value)}, which is not finite; expected {self.says}")
        if not self.low <= value <= self.high or (self.above and value == self.low) or (self.whole and value != value // 1):
            raise _Wrong(f"{where} is {shown(value)}, expected {self.says}")

    @property
    def says(self) -> str:
        """In words, with its range."""
        kind = "a whole number" if self.whole else "a number"
        if self.low == -self.high:
            return f"{kind} within {self.high:g}"
        if self.high >= LARGEST:
            return f"{kind} above {self.low:g}" if self.above else f"{kind} of at least {self.low:g}"
        return f"{kind} from {self.low:g} to {self.high:g}"


@dataclass(frozen=True)
class Array:
    """Finite numbers in lists; shape: how many at each depth, None for any number but 0; ``sound`` says what is wrong with all of them
    together, or nothing."""

    shape: tuple[int | None, ...]
    entry: Number = field(default_factory=Number)
    sound: Callable[[np.ndarray], str] | None = None

    def check(self, value: Any, where: str) -> None:
        """Raises what ``require`` puts into words."""
        counts = _counts(value)
        if any(count != (wanted or count) or not count for count, wanted in zip(counts, self.shape, strict=False)):
            raise _Wrong(f"{where} has shape {' x '.join(map(str, counts[: len(self.shape)]))}, expected {self.says}")
        self._walk(value, where, self.shape)
        try:
            array = np.array(value, dtype=float)
        except ValueError:
            raise _Wrong(f"{where} has rows of different lengths, expected {self.says}") from None
        if self.sound is not None and (wrong := self.sound(array)):
            raise _Wrong(f"{where} {wrong}")

    def _walk(self, value: Any, where: str, shape: tuple[int | None, ...]) -> None:
        if not shape:
            return self.entry.check(value, where)
        if not isinstance(value, list):
            raise _Wrong(f"{where} is {shown(value)}, expected {self.says}")
        if shape[0] is not None and len(value) != shape[0]:
            raise _Wrong(f"{where} has {len(value)} entries, expected {self.says}")
        for i, inner in enumerate(value):
            self._walk(inner, f"{where}[{i}]", shape[1:])

    @property
    def says(self) -> str:
        """``3 x 3 numbers``."""
        kind = self.entry.says.replace(" number", " numbers", 1).removeprefix("a ") if self.entry.whole else "numbers"
        return " x ".join("n" if count is None else str(count) for count in self.shape) + f" {kind}"


@dataclass(frozen=True)
class Text:
    """Text; one of some words where these are given."""

    one_of: tuple[str, ...] = ()

    def check(self, value: Any, where: str) -> None:
        """Raises what ``require`` puts into words."""
        if not isinstance(value, str) or (self.one_of and value not in self.one_of):
            expected = f"one of {', '.join(self.one_of)}" if self.one_of else "text"
            raise _Wrong(f"{where} is {shown(value)}, expected {expected}")


@dataclass(frozen=True)
class Flag:
    """True or false."""

    def check(self, value: Any, where: str) -> None:
        """Raises what ``require`` puts into words."""
        if not isinstance(value, bool):
            raise _Wrong(f"{where} is {shown(value)}, expected true or false")


@dataclass(frozen=True)
class ListOf:
    """A list, every entry of one shape."""

    entry: Shape

    def check(self, value: Any, where: str) -> None:
        """Raises what ``require`` puts into words."""
        if not isinstance(value, list):
            raise _Wrong(f"{where} is {shown(value)}, expected a list")
        for i, inner in enumerate(value):
            self.entry.check(inner, f"{where}[{i}]")


@dataclass(frozen=True)
class MapOf:
    """A table with any keys, every value of one shape."""

    entry: Shape

    def check(self, value: Any, where: str) -> None:
        """Raises what ``require`` puts into words."""
        if not isinstance(value, dict):
            raise _Wrong(f"{where} is {shown(value)}, expected a table")
        for key, inner in value.items():
            self.entry.check(inner, _inside(where, key))


@dataclass(frozen=True)
class Maybe:
    """Of a shape, or null: what is not known."""

    entry: Shape

    def check(self, value: Any, where: str) -> None:
        """Raises what ``require`` puts into words."""
        if value is not None:
            self.entry.check(value, where)


@dataclass(frozen=True)
class Keys:
    """A table: keys that must be there, and keys that may be."""

    must: Mapping[str, Shape] = field(default_factory=dict)
    may: Mapping[str, Shape] = field(default_factory=dict)

    def check(self, value: Any, where: str) -> None:
        """Raises what ``require`` puts into words."""
        if not isinstance(value, dict):
            raise _Wrong(f"{where or 'it'} is {shown(value)}, expected a table")
        for key, shape in self.must.items():
            if key not in value:
                raise _Wrong(f"{_inside(where, key)} is missing, expected {says_of(shape)}")
            shape.check(value[key], _inside(where, key))
        for key, shape in self.may.items():
            if key in value:
                shape.check(value[key], _inside(where, key))


Shape = Number | Array | Text | Flag | ListOf | MapOf | Maybe | Keys


def require(value: Any, shape: Shape, where: str, do: str = _FIT_AGAIN) -> None:
    """Hold what a file has against its shape; where: its name (and the key that ``value`` stands under, behind a colon).

    Raises FormatError: which key of which file, what stands there, what was expected, and what to do.
    """
    try:
        shape.check(value, "")
    except _Wrong as wrong:
        raise FormatError(f"{where}: {wrong}; {do}") from None


def read_required(path: Path, shape: Shape, do: str = _FIT_AGAIN) -> dict:
    """What a JSON file holds, held against its shape.  Raises FormatError as ``require``, and for what is no JSON."""
    try:
        table = read_json(path)
    except FormatError as error:
        raise FormatError(f"{error}; {do}") from None
    require(table, shape, str(path), do)
    return table


def says_of(shape: Shape) -> str:
    """What is expected of a shape, in words."""
    if isinstance(shape, Number | Array):
        return shape.says
    if isinstance(shape, Maybe):
        return f"{says_of(shape.entry)} or null"
    if isinstance(shape, Text):
        return f"one of {', '.join(shape.one_of)}" if shape.one_of else "text"
    return "true or false" if isinstance(shape, Flag) else "a list" if isinstance(shape, ListOf) else "a table"


def shown(value: Any) -> str:
    """A value of JSON as a complaint shows it: as the file has it, and not longer than a word."""
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, dict):
        return "a table"
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= MOST_SHOWN else text[: MOST_SHOWN - 1] + "…"


def _inside(where: str, key: str) -> str:
    key = key if len(key) <= MOST_SHOWN else key[: MOST_SHOWN - 1] + "…"
    return f"{where}.{key}" if where else key


def _counts(value: Any) -> list[int]:
    """Lengths at each depth, as far as the first entries go."""
    counts = []
    while isinstance(value, list):
        counts.append(len(value))
        value = value[0] if value else None
    return counts
