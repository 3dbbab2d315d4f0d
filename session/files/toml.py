"""TOML, as any file of ours holds it: shallow.  What is deeper is refused before it is parsed, since the parser keeps the beginning of a
dotted key up to each of its parts: a key of 100 000 parts takes it 40 GB."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

from session.common.errors import FormatError
from session.files.reading import MOST_TOML, read_bytes

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
