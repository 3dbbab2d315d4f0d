"""What is added to a ``session.toml`` that is there: notes, and turns that do not count.  Whatever else stands in it stays as it is.

The text is added to, never written anew, so a person's comments and order stay.  The file is replaced whole or not at all.
"""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path

from session.common.errors import FormatError, StorageError
from session.common.texts import unicode_text
from session.files.reading import MOST_TOML, read_text
from session.files.toml import parse_toml
from session.log.config import LeftOut, Note
from session.log.toml_text import line, value_text

HEADER = re.compile(r"^[ \t]*\[[ \t]*notes[ \t]*\][ \t]*(#.*)?$", re.MULTILINE)
NEXT_HEADER = re.compile(r"^[ \t]*\[", re.MULTILINE)


def notes_text(notes: Mapping[str, Note]) -> str:
    """Lines of ``[notes]``."""
    return "".join(line(name, value) for name, value in notes.items())


def exclude_text(rows: tuple[LeftOut, ...]) -> str:
    """``[[exclude]]`` of each turn."""
    return "".join(f"\n[[exclude]]\n{line('log', row.log)}{line('at_s', row.at_s)}" for row in rows)


def add_notes(path: Path, notes: Mapping[str, Note]) -> str:
    """Add to ``[notes]``, and give the file's text, which its folder may not outlive.  What is there already in the same words is left;
    FormatError where it says something else."""
    text, table = _read(path)
    notes = {unicode_text(name): unicode_text(value) if isinstance(value, str) else value for name, value in notes.items()}
    there = table.get("notes", {})
    there = there if isinstance(there, dict) else {}
    for name, value in notes.items():
        if name in there and there[name] != value:
            raise FormatError(f"{path}: notes.{name} is {value_text(there[name])} already; correct it there, or give another name")
    if not (fresh := {name: value for name, value in notes.items() if name not in there}):
        return text
    lines = notes_text(fresh)
    header = HEADER.search(text)
    tried = []
    if header is not None:
        after = NEXT_HEADER.search(text, header.end())
        end = len(text) if after is None else after.start()
        kept = text[:end].rstrip()  # blank lines before the next section stay before it
        tried.append(kept + "\n" + lines + (text[len(kept) :].removeprefix("\r").removeprefix("\n") if after else ""))
        tried.append(_ended(text[: header.end()]) + lines + text[header.end() :].removeprefix("\r").removeprefix("\n"))
    tried.append(_ended(text) + f"\n[notes]\n{lines}")
    return _replace(path, tried, table | {"notes": there | fresh})


def add_board(path: Path, board: Mapping[str, str | float], remarks: Mapping[str, str]) -> str:
    """Add ``[board]``, where there is none yet, and give the file's text.  remarks: comments, each before the key that it is of."""
    text, table = _read(path)
    if "board" in table:
        return text
    lines = "".join((f"# {remarks[name]}\n" if name in remarks else "") + line(name, value) for name, value in board.items())
    return _replace(path, [_ended(text) + f"\n[board]\n{lines}"], table | {"board": dict(board)})


def add_exclude(path: Path, row: LeftOut) -> str:
    """Add a turn that does not count, and give the file's text."""
    text, table = _read(path)
    more = {"log": unicode_text(row.log), "at_s": row.at_s}
    return _replace(path, [_ended(text) + exclude_text((row,))], table | {"exclude": [*table.get("exclude", []), more]})


def _ended(text: str) -> str:
    return text if not text or text.endswith("\n") else text + "\n"


def _read(path: Path) -> tuple[str, dict]:
    text = read_text(path, MOST_TOML, mark=True)  # line ends, and a byte order mark, stay what they are
    return text, _parsed(text, str(path))


def _parsed(text: str, where: str) -> dict:
    return parse_toml(text.removeprefix("\ufeff").replace("\r\n", "\n"), where)


def _replace(path: Path, tried: list[str], wanted: dict) -> str:
    """The first text that says what is wanted becomes the file, in one step: no reader sees half of it."""
    for text in tried:
        try:
            right = _parsed(text, str(path)) == wanted
        except FormatError:
            right = False
        if right:
            break
    else:
        raise FormatError(f"{path}: its form leaves no place to add to; put what you want to note below [notes] by hand")
    fresh = path.with_name(f".{path.name}.new")
    try:
        with fresh.open("w", encoding="utf-8", newline="") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(fresh, path)
    except OSError as error:
        fresh.unlink(missing_ok=True)
        raise StorageError(f"{path}: {error.strerror or error}; what was to be added is not in it") from None
    return text
