"""Results as JSON: read, checked against a declared shape, written whole or not at all."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from io import BufferedWriter
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

from session.base.errors import FormatError
from session.base.files import MOST_JSON, read_bytes, replaced
from session.base.names import refuse_recorded
from session.base.texts import unicode_text

if TYPE_CHECKING:
    import numpy as np

# Results as files: JSON read with one line for all that can be wrong with it, written whole or not at all.

#: an integer of more digits is read as a float, infinite where it must be: no reader of numbers then meets one that no float can hold
LONGEST_INTEGER = 18


def read_json(path: Path) -> Any:
    """What a JSON file holds.  FormatError states what is wrong with the file."""
    try:
        return read_json_text(read_bytes(path, MOST_JSON).decode(), str(path))
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: broken JSON: {error}") from None


def read_json_text(text: str, where: str) -> Any:
    """What a text of JSON holds.  FormatError, which begins with ``where``, states what is wrong with it."""
    try:
        return json.loads(text, parse_int=_integer, object_pairs_hook=_table)
    except ValueError as error:
        raise FormatError(f"{where}: broken JSON: {error}") from None
    except RecursionError:
        raise FormatError(f"{where}: broken JSON: lists or tables nested too deeply") from None


def _table(pairs: list[tuple[str, Any]]) -> dict:
    """A table in which each key occurs once; ValueError for a repeated key."""
    table = dict(pairs)
    if len(table) < len(pairs):
        seen: set[str] = set()
        twice = next(name for name, _ in pairs if name in seen or seen.add(name))  # type: ignore[func-returns-value]
        raise ValueError(f"the key {json.dumps(twice[:40], ensure_ascii=False)} stands twice in one table; keep one")
    return table


def _integer(digits: str) -> int | float:
    return int(digits) if len(digits) <= LONGEST_INTEGER else float(digits)


def write_text_whole(path: Path, text: str) -> None:
    """Text in UTF-8, whole or not at all; of a name that was no UTF-8 its escapes."""
    with whole(path) as file:
        file.write(unicode_text(text).encode())


@contextlib.contextmanager
def whole(path: Path) -> Iterator[BufferedWriter]:
    """As ``replaced``, of a result: StorageError for a recording's own file, too."""
    refuse_recorded(path)
    with replaced(path) as file:
        yield file


# What a file must hold, JSON or TOML: a shape is data, and ``require`` compares what was parsed with it.
#
# The complaint is one line: which key of which file, what stands there, what was expected, and what to do.  Keys that a shape does not
# name are ignored (docs/formats.md); ``unknown_keys`` lists them where they are to be reported.

#: no number of a calibration comes near it in SI, and its square is still far from a float's end
LARGEST = 1e12
MOST_SHOWN = 40
#: unknown keys for which the nearest known one is searched: the search takes a while
MOST_NEAREST = 100
_FIT_AGAIN = "fit again, or correct the file"


class Mismatch(Exception):
    """Which key, what is there, and what was expected."""


class Shape:
    """What a value must be; ``expected`` is it in words."""

    expected = "a table"

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch, which names ``where`` the value stands."""
        raise NotImplementedError

    def made(self, value: Any) -> Any:
        """What a record holds of a value that was checked."""
        return value

    def refuse(self, value: Any, where: str) -> NoReturn:
        """Raises Mismatch for a value that is something else."""
        raise Mismatch(f"{where or 'it'} is {shown(value)}, expected {self.expected}")


@dataclass(frozen=True)
class Number(Shape):
    """A finite number from low to high; ``whole``: without decimals; ``above``: low itself is too low.  true and "1" are no numbers."""

    low: float = -LARGEST
    high: float = LARGEST
    whole: bool = False
    above: bool = False

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        if isinstance(value, bool) or not isinstance(value, int | float):
            self.refuse(value, where)
        if isinstance(value, float) and not math.isfinite(value):
            raise Mismatch(f"{where} is {shown(value)}, which is not finite; expected {self.expected}")
        if not self.low <= value <= self.high or (self.above and value == self.low) or (self.whole and value != value // 1):
            self.refuse(value, where)

    def made(self, value: Any) -> Any:
        """A float, or a whole number."""
        return int(value) if self.whole else float(value)

    @property
    def expected(self) -> str:  # type: ignore[override]
        """``a whole number from 1 to 9``."""
        kind = "a whole number" if self.whole else "a number"
        if self.low == -self.high:
            return f"{kind} within {self.high:g}"
        if self.high >= LARGEST:
            return f"{kind} above {self.low:g}" if self.above else f"{kind} of at least {self.low:g}"
        return f"{kind} from {self.low:g} to {self.high:g}"


@dataclass(frozen=True)
class Array(Shape):
    """Finite numbers in lists; shape: how many at each depth, None for any number but 0; ``sound`` returns what is wrong with the whole
    array, or nothing; ``fitted``: what a record holds of it."""

    shape: tuple[int | None, ...]
    entry: Number = field(default_factory=Number)
    sound: Callable[[np.ndarray], str] | None = None
    fitted: Callable[[np.ndarray], Any] | None = None

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        import numpy as np  # only where arrays are read

        counts = _counts(value)
        if any(count != (wanted or count) or not count for count, wanted in zip(counts, self.shape, strict=False)):
            raise Mismatch(f"{where} has shape {' x '.join(map(str, counts[: len(self.shape)]))}, expected {self.expected}")
        self._check_entries(value, where, self.shape)
        try:
            array = np.array(value, dtype=float)
        except ValueError:
            raise Mismatch(f"{where} has rows of different lengths, expected {self.expected}") from None
        if self.sound is not None and (wrong := self.sound(array)):
            raise Mismatch(f"{where} {wrong}")

    def made(self, value: Any) -> Any:
        """An array of floats."""
        import numpy as np

        array = np.array(value, dtype=float)
        return array if self.fitted is None else self.fitted(array)

    def _check_entries(self, value: Any, where: str, shape: tuple[int | None, ...]) -> None:
        if not shape:
            return self.entry.check(value, where)
        if not isinstance(value, list):
            self.refuse(value, where)
        if shape[0] is not None and len(value) != shape[0]:
            raise Mismatch(f"{where} has {len(value)} entries, expected {self.expected}")
        for i, inner in enumerate(value):
            self._check_entries(inner, f"{where}[{i}]", shape[1:])

    @property
    def expected(self) -> str:  # type: ignore[override]
        """``3 x 3 numbers``."""
        kind = self.entry.expected.replace(" number", " numbers", 1).removeprefix("a ") if self.entry.whole else "numbers"
        return " x ".join("n" if count is None else str(count) for count in self.shape) + f" {kind}"


@dataclass(frozen=True)
class Text(Shape):
    """Text; one of some words where these are given."""

    one_of: tuple[str, ...] = ()

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        if not isinstance(value, str) or (self.one_of and value not in self.one_of):
            self.refuse(value, where)

    @property
    def expected(self) -> str:  # type: ignore[override]
        """``one of a, b``."""
        return f"one of {', '.join(self.one_of)}" if self.one_of else "text"


class Flag(Shape):
    """True or false."""

    expected = "true or false"

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        if not isinstance(value, bool):
            self.refuse(value, where)


@dataclass(frozen=True)
class ListOf(Shape):
    """A list, every entry of one shape."""

    entry: Shape
    expected = "a list"

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        if not isinstance(value, list):
            self.refuse(value, where)
        for i, inner in enumerate(value):
            self.entry.check(inner, f"{where}[{i}]")

    def made(self, value: Any) -> Any:
        """A tuple."""
        return tuple(map(self.entry.made, value))


class Column(ListOf):
    """A list, or rows of three, as an array; null is NaN."""

    def made(self, value: Any) -> Any:
        """(K,) or (K, 3)."""
        import numpy as np

        return np.array(value, dtype=float).reshape(len(value), *[3] * isinstance(self.entry, ListOf))


@dataclass(frozen=True)
class MapOf(Shape):
    """A table with any keys, every value of one shape."""

    entry: Shape

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        if not isinstance(value, dict):
            self.refuse(value, where)
        for key, inner in value.items():
            self.entry.check(inner, _inside(where, key))

    def made(self, value: Any) -> Any:
        """A dict."""
        return {key: self.entry.made(inner) for key, inner in value.items()}


@dataclass(frozen=True)
class Maybe(Shape):
    """Of a shape, or null: what is not known."""

    entry: Shape

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        if value is not None:
            self.entry.check(value, where)

    def made(self, value: Any) -> Any:
        """None, or what the shape makes."""
        return None if value is None else self.entry.made(value)

    @property
    def expected(self) -> str:  # type: ignore[override]
        """``a number above 0 or null``."""
        return f"{self.entry.expected} or null"


@dataclass(frozen=True)
class Keys(Shape):
    """A table: keys that must be there, and keys that may be."""

    must: Mapping[str, Shape] = field(default_factory=dict)
    may: Mapping[str, Shape] = field(default_factory=dict)

    def check(self, value: Any, where: str) -> None:
        """Raises Mismatch."""
        if not isinstance(value, dict):
            self.refuse(value, where)
        for key, shape in self.known.items():
            if key in value:
                shape.check(value[key], _inside(where, key))
            elif key in self.must:
                raise Mismatch(f"{_inside(where, key)} is missing, expected {shape.expected}")

    def made(self, value: Any) -> Any:
        """A dict of the keys that are known; of all where none is named."""
        return {key: shape.made(value[key]) for key, shape in self.known.items() if key in value} if self.known else value

    @property
    def known(self) -> dict[str, Shape]:
        """Both."""
        return {**self.must, **self.may}


def require(value: Any, shape: Shape, where: str, do: str = _FIT_AGAIN) -> None:
    """Compare what a file holds with its shape; where: its name (and the key that ``value`` stands under, behind a colon).

    Raises FormatError: which key of which file, what stands there, what was expected, and what to do.
    """
    try:
        shape.check(value, "")
    except Mismatch as mismatch:
        raise FormatError(f"{where}: {mismatch}; {do}") from None


def require_schema(value: Any, schema: str, where: str, do: str = _FIT_AGAIN) -> None:
    """As ``require``, of the schema alone: a reader reads the present number of its format, and refuses any other."""
    require(value, Keys({"schema": Text((schema,))}), where, do)


def read_required(path: Path, shape: Shape, do: str = _FIT_AGAIN) -> dict:
    """What a JSON file holds.  Raises FormatError as ``require``, and for what is no JSON."""
    try:
        table = read_json(path)
    except FormatError as error:
        raise FormatError(f"{error}; {do}") from None
    require(table, shape, str(path), do)
    return table


def unknown_keys(table: dict, shape: Keys) -> tuple[tuple[str, str | None], ...]:
    """``section.key`` of each key that a table's shape does not name, with the known key nearest to it, or None.

    Nearest by the whole name, else by what stands behind the section: a key may have lost its section, or be in the wrong one.
    """
    known = [
        name
        for section, inner in shape.known.items()
        for name in ([f"{section}.{key}" for key in inner.known] if isinstance(inner, Keys) else [section])
    ]
    there = [
        name
        for section, group in table.items()
        if not isinstance(shape.known.get(section), MapOf)
        for name in ([f"{section}.{key}" for key in group] if isinstance(group, dict) else [section])
    ]
    bare = {name.split(".")[-1]: name for name in known}

    def nearest(key: str) -> str | None:
        whole = get_close_matches(key.lower(), known, n=1, cutoff=0.75)
        last = get_close_matches(key.lower().split(".")[-1], bare, n=1, cutoff=0.75)
        return bare[last[0]] if last else whole[0] if whole else None

    unknown = [name for name in there if name not in known]
    return tuple((name, nearest(name) if number < MOST_NEAREST else None) for number, name in enumerate(unknown))


def shown(value: Any) -> str:
    """A value as a complaint quotes it: as the file has it, and not longer than a word."""
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, dict):
        return "a table"
    try:
        text = json.dumps(value, ensure_ascii=False, default=str)
    except ValueError:  # Python writes out no number of more than 4300 digits
        return "a number of thousands of digits"
    return _cut(text)


def _cut(text: str) -> str:
    return text if len(text) <= MOST_SHOWN else text[: MOST_SHOWN - 1] + "…"


def _inside(where: str, key: str) -> str:
    return f"{where}.{_cut(key)}" if where else _cut(key)


def _counts(value: Any) -> list[int]:
    """Lengths at each depth, as far as the first entries go."""
    counts = []
    while isinstance(value, list):
        counts.append(len(value))
        value = value[0] if value else None
    return counts
