"""Values and keys as TOML, by a writer of TOML (tomlkit), so that no text can become anything but the value that it is.

What is not printable is escaped besides, which reads back the same: a terminal or an editor shows the file as its parser reads it.  Of
bytes that were no UTF-8 their escapes remain, for no TOML can hold them (``session.common.texts.unicode_text``).
"""

from __future__ import annotations

from datetime import date, datetime, time

from session.common.texts import unicode_text

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
