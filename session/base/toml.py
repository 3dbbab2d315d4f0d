"""TOML: parsed within bounds, and written so that no text changes its value."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Callable, Mapping
from datetime import date, datetime, time
from pathlib import Path
from typing import Any

from session.base.errors import FormatError
from session.base.files import MOST_TOML, read_bytes
from session.base.texts import unicode_text

# TOML, as any file of ours holds it: shallow.  What is deeper is refused before it is parsed, since the parser keeps the beginning of a
# dotted key up to each of its parts: a key of 100 000 parts takes it 40 GB.

#: a session.toml is two deep
DEEPEST = 16
_PART = r"""(?:[A-Za-z0-9_-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
#: a dotted key that is too deep; text in quotes that does not end, behind which no parser goes on; or what a dot means nothing in: text in
#: quotes, over lines or not, a word, a comment
_TOKEN = re.compile(
    rf'(?P<deep>{_PART}(?:[ \t]*\.[ \t]*{_PART}){{{DEEPEST}}})|"""(?:[^"\\]|\\.|""?(?!"))*+"{{3,5}}'
    rf"|'''(?:[^']|''?(?!'))*+'{{3,5}}|(?P<open>(?:\"\"\"|''').*)|{_PART}|(?P<odd>[\"'].*)|#[^\n]*",
    re.DOTALL,
)


def read_toml(path: Path) -> dict:
    """What a TOML file holds.  FormatError states what is wrong with it."""
    return toml_of(read_bytes(path, MOST_TOML), path)


def toml_of(data: bytes, path: Path) -> dict:
    """What the bytes of a TOML file hold, as ``read_toml``."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FormatError(f"{path}: broken TOML: {error}; save it in UTF-8") from None
    return parse_toml(text.replace("\r\n", "\n").replace("\r", "\n"), str(path))


def parse_toml(text: str, where: str) -> dict:
    """What a text holds, whose lines end with a line feed.  FormatError, with ``where``, states what is wrong with it."""
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


# Values and keys as TOML, by a writer of TOML (tomlkit), so that no text can become anything but the value that it is.
#
# What is not printable is escaped as well, which reads back the same: a terminal or an editor shows the file as its parser reads it.  Of
# bytes that were no UTF-8 their escapes remain, for no TOML can hold them (``session.base.texts.unicode_text``).

LONG = 1e6  #: beyond it digits are no help to anybody
#: what a note may hold
Note = str | float | bool | date | time
#: what is written into a session.toml
Value = str | float | bool | date | datetime | time | list


def value_text(value: Value) -> str:
    """A value, on one line."""
    from tomlkit import item  # only where something is written: a reader need not wait for it

    if isinstance(value, str):
        text = item(unicode_text(value)).as_string()
        return "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in text)
    return item(value).as_string()


def toml_line(name: str, value: Value) -> str:
    """``name = value`` and the line's end; a whole number of an instrument's setting stands without its ``.0`` (``setting``)."""
    return f"{_key(name)} = {value_text(value)}\n"


def section_text(name: str, table: Mapping[str, Any]) -> str:
    """A section and those within it; nothing of an empty one.  name: as it stands in its head."""
    inner = {key: value for key, value in table.items() if isinstance(value, Mapping)}
    lists = {key: value for key, value in table.items() if isinstance(value, list) and value and isinstance(value[0], Mapping)}
    own = "".join(toml_line(key, value) for key, value in table.items() if key not in inner | lists)
    texts = [f"\n[{name}]\n{own}" if own else "", *(section_text(f"{name}.{_key(key)}", value) for key, value in inner.items())]
    texts += [section_text(f"[{name}.{_key(key)}]", each) for key, value in lists.items() for each in value]
    return "".join(texts)


def edited(text: str, change: Callable[[Any], None]) -> str:
    """A text behind a change of its document (tomlkit's); what is not touched stays as it is written."""
    from tomlkit import dumps, parse
    from tomlkit.exceptions import TOMLKitError

    bare = text.removeprefix("\ufeff")
    try:
        document = parse(bare)
        change(document)
    except TOMLKitError as error:
        raise FormatError(f"broken TOML: {error}") from None
    return text[: len(text) - len(bare)] + dumps(document)


def add_lines(section: Any, lines: str) -> None:
    """Give a section of such a document the keys of these lines, as they are written there."""
    from tomlkit import parse

    for key, value in parse(lines).body:
        if key in section:
            section[key] = value
        else:
            section.append(key, value)


def setting(value: float) -> float:
    """500 rather than 500.0, as people write a full scale."""
    return int(value) if abs(value) < LONG and float(value).is_integer() else value


def _key(name: str) -> str:
    from tomlkit.items import SingleKey

    bare = name.isascii() and name.replace("-", "").replace("_", "").isalnum()
    return name if bare else value_text(name) if not name.isprintable() else SingleKey(unicode_text(name)).as_string()
