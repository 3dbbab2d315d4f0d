"""TOML: parsed within bounds, looked up with typed errors, and written so that no text changes its value."""

from __future__ import annotations

import re
import tomllib
from datetime import date, datetime, time
from difflib import get_close_matches
from math import isfinite, nan
from pathlib import Path
from typing import Any

import numpy as np

from session.io.errors import FormatError
from session.io.files import MOST_TOML, read_bytes
from session.io.texts import unicode_text

# TOML, as any file of ours holds it: shallow.  What is deeper is refused before it is parsed, since the parser keeps the beginning of a
# dotted key up to each of its parts: a key of 100 000 parts takes it 40 GB.

#: a session.toml is two deep
DEEPEST = 16
_PART = r"""(?:[A-Za-z0-9_-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
#: a dotted key that is too deep; text in quotes that does not end, behind which no parser goes on; or what a dot means nothing in: text in
#: quotes, over lines or not, a word, a comment
_TOKEN = re.compile(
    rf'(?P<deep>{_PART}(?:[ \t]*\.[ \t]*{_PART}){{{DEEPEST}}})|"""(?:[^"\\]|\\.|""?(?!"))*+"{{3,5}}'
    rf"|'''(?:[^']|''?(?!'))*+'{{3,5}}|(?P<open>\"\"\"|''')|{_PART}|(?P<odd>[\"'])|#[^\n]*",
    re.DOTALL,
)


def read_toml(path: Path) -> dict:
    """What a TOML file holds.  FormatError says what is wrong with it."""
    try:
        text = read_bytes(path, MOST_TOML).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: broken TOML: {error}; save it in UTF-8") from None
    return parse_toml(text.replace("\r\n", "\n").replace("\r", "\n"), str(path))


def parse_toml(text: str, where: str) -> dict:
    """What a text holds, whose lines end with a line feed.  FormatError, with ``where``, says what is wrong with it."""
    if (deep := _too_deep(text)) is not None:
        raise FormatError(f"{where}: broken TOML: a key of more than {DEEPEST} parts in line {deep}; correct that line")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise FormatError(f"{where}: broken TOML: {error}; correct that line") from None
    except RecursionError:
        raise FormatError(f"{where}: broken TOML: lists or tables nested too deeply") from None
    except ValueError:  # Python reads no number of more than 4300 digits
        raise FormatError(f"{where}: broken TOML: a number of thousands of digits") from None


def _too_deep(text: str) -> int | None:
    """Number of the first line with a dotted key that is."""
    for token in _TOKEN.finditer(text):
        if token["deep"]:
            return text.count("\n", 0, token.start()) + 1
        if token["open"] or token["odd"]:
            break
    return None


# Typed look-ups in a parsed TOML file; every complaint names file, key, expectation and value.

LAST_MOMENT_S = 1e11  #: far beyond any clock
#: TOML's own bound of whole numbers, which Python does not hold it to
LARGEST = 2**63
#: keys that nobody knows and for which a known one is looked for: the search takes a while
MOST_NEAREST = 100
#: what a note may hold
Note = str | float | bool | date | time
#: of a rotation's rows from length 1 and a right angle: written to four digits
ROTATION_WITHIN = 1e-3


class TomlReader:
    """Typed look-ups in the parsed TOML; every complaint names file, key, expectation and value."""

    _REQUIRED = object()

    def __init__(self, path: Path, table: dict):
        self._path, self._table, self._read = path, table, ["schema"]

    def unknown(self) -> tuple[tuple[str, str | None], ...]:
        """Keys that were never looked up, each with the looked-up key nearest to it."""
        keys, known = [], set(self._read)
        for section, group in self._table.items():
            keys += [f"{section}.{key}" for key in group] if isinstance(group, dict) else [section]
        unknown = [key for key in keys if key not in known]
        return tuple((key, self._nearest(key) if number < MOST_NEAREST else None) for number, key in enumerate(unknown))

    def _nearest(self, key: str) -> str | None:
        """By the whole name, else by what stands behind the section: a key may have lost its section, or be in the wrong one."""
        bare = {known.split(".")[-1]: known for known in self._read}
        whole = get_close_matches(key.lower(), self._read, n=1, cutoff=0.75)
        last = get_close_matches(key.lower().split(".")[-1], bare, n=1, cutoff=0.75)
        return bare[last[0]] if last else whole[0] if whole else None

    def _value(self, section: str, key: str, default: Any) -> Any:
        self._read.append(f"{section}.{key}")
        group = self._table.get(section, {})
        if not isinstance(group, dict):
            raise FormatError(f"{self._path}: [{section}] must be a table, not {said(group)}")
        if key not in group and default is self._REQUIRED:
            raise FormatError(f"{self._path}: {section}.{key} is missing; add it under [{section}]")
        return group.get(key, default)

    def text(self, section: str, key: str, default: str) -> str:
        """Text."""
        value = self._value(section, key, default)
        if not isinstance(value, str):
            raise FormatError(f"{self._path}: {section}.{key} is {said(value)}, expected text in quotes")
        return value

    def flag(self, section: str, key: str) -> bool | None:
        """true or false, or None where the key is missing."""
        value = self._value(section, key, None)
        if value is not None and not isinstance(value, bool):
            raise FormatError(f"{self._path}: {section}.{key} is {said(value)}, expected true or false")
        return value

    def number(self, section: str, key: str, default: Any = _REQUIRED, *, low: float, high: float) -> Any:
        """A float between the limits; None where the key is missing and that is the default."""
        value = self._value(section, key, default)
        if value is None and default is None:
            return None
        try:
            number = float(value) if isinstance(value, (int, float)) and not isinstance(value, bool) else nan
        except OverflowError:
            number = nan
        if not isfinite(number) or not low <= number <= high:
            raise FormatError(f"{self._path}: {section}.{key} is {said(value)}, expected a number from {low:g} to {high:g}")
        return number

    def choice(self, section: str, key: str, choices: tuple[str, ...]) -> str | None:
        """One of some words, or None where the key is missing."""
        value = self._value(section, key, None)
        if value is not None and value not in choices:
            raise FormatError(f"{self._path}: {section}.{key} is {said(value)}, expected one of {', '.join(choices)}")
        return value

    def rotation(self, section: str, key: str) -> np.ndarray | None:
        """A rotation matrix (3, 3), made exactly orthogonal, or None where the key is missing."""
        if self._value(section, key, None) is None:
            return None
        matrix = self.array(section, key, (3, 3), np.eye(3), most=10.0)
        if np.abs(matrix @ matrix.T - np.eye(3)).max() > ROTATION_WITHIN or np.linalg.det(matrix) < 0:
            raise FormatError(f"{self._path}: {section}.{key} is no rotation: its rows must be of length 1, at right angles, right-handed")
        left, _, right = np.linalg.svd(matrix)
        return left @ right

    def array(self, section: str, key: str, shape: tuple[int, ...], default: np.ndarray, most: float) -> np.ndarray:
        """Numbers of a shape, none larger than ``most``."""
        value = self._value(section, key, default)
        try:
            array = np.asarray(value, dtype=float)
        except (TypeError, ValueError, OverflowError):
            array = np.empty(0)
        if array.shape != shape or not np.isfinite(array).all():
            raise FormatError(f"{self._path}: {section}.{key} is {said(value)}, expected finite numbers of shape {shape}")
        if not (np.abs(array) <= most).all():
            raise FormatError(f"{self._path}: {section}.{key} holds {np.abs(array).max():g}, expected numbers within {most:g}")
        return array

    def notes(self) -> dict[str, Note]:
        """``[notes]``: any name, with text, a number, a date or a time, or true or false."""
        group = self._table.get("notes", {})
        if not isinstance(group, dict):
            raise FormatError(f"{self._path}: [notes] must be a table, not {said(group)}")
        for name, value in group.items():
            self._read.append(f"notes.{name}")
            if not isinstance(value, (str, int, float, date, datetime, time)):
                raise FormatError(f"{self._path}: notes.{name} is {said(value)}, expected text, a number or a date")
            if isinstance(value, int) and not -LARGEST <= value < LARGEST:
                raise FormatError(f"{self._path}: notes.{name} is {said(value)}, expected no whole number of more than 64 bits")
        return dict(group)

    def exclude(self) -> list[tuple[str, float]]:
        """``[[exclude]]``: a log's name and a moment of its clock each."""
        self._read.append("exclude")
        rows = self._table.get("exclude", [])
        expected = '[[exclude]] expects log = "log0001.csv" and at_s = seconds of its clock'
        if not isinstance(rows, list):
            raise FormatError(f"{self._path}: exclude is {said(rows)}; {expected}")
        found = []
        for row in rows:
            at_s = row.get("at_s") if isinstance(row, dict) else None
            number = isinstance(at_s, (int, float)) and not isinstance(at_s, bool)
            if at_s is None or not number or not abs(at_s) < LAST_MOMENT_S or not isinstance(row.get("log"), str):
                raise FormatError(f"{self._path}: exclude holds {said(row)}; {expected}")
            found.append((row["log"], float(at_s)))
        return found


def said(value: object) -> str:
    """A value as a complaint quotes it, never longer than a line."""
    try:
        text = repr(value)
    except ValueError:  # Python writes out no number of more than 4300 digits
        return "a number of thousands of digits"
    return text if len(text) <= 80 else f"{text[:79]}…"


# Values and keys as TOML, by a writer of TOML (tomlkit), so that no text can become anything but the value that it is.
#
# What is not printable is escaped besides, which reads back the same: a terminal or an editor shows the file as its parser reads it.  Of
# bytes that were no UTF-8 their escapes remain, for no TOML can hold them (``session.io.texts.unicode_text``).

LONG = 1e6  #: beyond it digits are no help to anybody
#: what is written into a session.toml
Value = str | float | bool | date | datetime | time | list


def value_text(value: Value) -> str:
    """A value, on one line."""
    from tomlkit import item  # only where something is written: a reader need not wait for it

    if isinstance(value, str):
        text = item(unicode_text(value)).as_string()
        return "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in text)
    return item(value).as_string()


def line(name: str, value: Value) -> str:
    """``name = value`` and the line's end; a whole number of an instrument's setting stands without its ``.0`` (``setting``)."""
    return f"{_key(name)} = {value_text(value)}\n"


def setting(value: float) -> float:
    """500 rather than 500.0, as people write a full scale."""
    return int(value) if abs(value) < LONG and float(value).is_integer() else value


def _key(name: str) -> str:
    from tomlkit.items import SingleKey

    bare = name.isascii() and name.replace("-", "").replace("_", "").isalnum()
    return name if bare else value_text(name) if not name.isprintable() else SingleKey(unicode_text(name)).as_string()
