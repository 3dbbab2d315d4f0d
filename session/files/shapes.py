"""What JSON must hold: one validator for every JSON that the tool reads.

A file's shape is data: tables of keys, lists, arrays of numbers, texts.  ``require`` holds a value against it, and says in one line
which key of which file is what, what was expected there, and what to do.  Keys that a shape does not name are ignored (docs/formats.md).
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from session.common.errors import FormatError
from session.files.results import read_json

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
