"""Text that leaves the tool: names, serial numbers and notes made fit for terminals, comments, JSON and commands; numbers for reading."""

from __future__ import annotations

import json
import os
import re
import shlex
import sys
from collections.abc import Sequence
from math import isfinite
from os import fspath

from session.base.units import DEG

# Texts that leave the tool.  Names of files, serial numbers, notes and what a board sends are another's words: wherever they are put they
# stay text, and on one line.  One function for each place: a terminal or a message, a comment in code, a file in UTF-8, a command to copy.
#
# Values go through the format's own writer: ``session.base.records.json_text``, ``session.base.toml``, and PyYAML in the exports.

#: bytes of a file's name that were no UTF-8 come as these, one a byte (PEP 383); the rest of the surrogates stand for nothing at all
BYTES = range(0xDC80, 0xDD00)
SURROGATE = re.compile("[\ud800-\udfff]")
#: what ends a comment or begins another in some language, and what makes a compiler join its line to the next one (also as a trigraph)
MARKS = re.compile(r"(?<=\*)/|(?<=/)\*|(?<=--)>|(?<=<)!|\?(?=\?)|\\(?=\s*$)")
#: there in a checkout, and in no installed package
CHECKOUT = os.path.join(os.path.dirname(__file__), "..", "..", "pyproject.toml")


def unicode_text(text: str) -> str:
    r"""Text that UTF-8 can hold: a byte that was none as ``\xe9``, any other surrogate as ``\ud800``."""
    return text if text.isascii() else SURROGATE.sub(lambda found: _escaped(found[0]), text)


def printable(text: str) -> str:
    r"""One line that a terminal or a page may show: line ends, control and escape characters, signs that turn the writing round, and bytes
    that were no text, as escapes such as ``\n`` and ``\x1b``."""
    return text if text.isprintable() else "".join(c if c.isprintable() else _escaped(c) for c in text)


def one_line(text: str) -> str:
    """The printable words of a text, one space apart."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in text).split())


def comment(text: str, ascii_only: bool = False) -> str:
    """One line of a comment, after any mark and in any language: it can neither end the comment nor take the next line into it.

    ascii_only: where the compiler may be an old one; what is not ASCII becomes ``?``.
    """
    line = printable(text)
    if ascii_only:
        line = line.encode("ascii", "replace").decode().replace("\\", "_")
    return MARKS.sub("_", line)


def escaped_json(text: str, ascii_only: bool = False) -> str:
    """JSON that any reader of UTF-8 takes, and a terminal shows as it is: what is not printable in the strings is escaped, and reads back
    the same; of bytes that were no text their escapes remain (``unicode_text``)."""
    if text.isascii() and "\x7f" not in text:
        return text
    shown = str.isascii if ascii_only else str.isprintable
    escaped = {c: json.dumps(_escaped(c) if SURROGATE.match(c) else c)[1:-1] for c in set(text)}
    return "".join(c if c == "\n" or (c != "\x7f" and shown(c)) else escaped[c] for c in text)


def letters_of(text: str) -> str:
    """Its small letters and digits alone: in how many ways a name may be written."""
    return re.sub(r"[^a-z0-9]", "", text.lower())


def listed(names: Sequence[str], most: int) -> str:
    """``a, b, …``: names with commas, of more than the most the first."""
    return ", ".join(names[:most]) + (", …" if len(names) > most else "")


def shell_word(path: object) -> str:
    """A path as a shell takes it from a line that is copied: in quotes where it must be, and in ``$'…'`` what no terminal shows."""
    text = fspath(path) if hasattr(path, "__fspath__") else str(path)
    if text.isprintable():
        return shlex.quote(text)
    inside = "".join(_in_shell(c) for c in text)
    return f"$'{inside}'"


def program() -> str:
    """How this installation runs the tool: ``calibrate``, or ``python`` and the path of ``calibrate.py`` as it was started."""
    started = sys.argv[0] if sys.argv else ""
    if os.path.basename(started) == "calibrate.py":
        return f"python {shell_word(started)}"
    installed = os.path.splitext(os.path.basename(started))[0] == "calibrate" or not os.path.exists(CHECKOUT)
    return "calibrate" if installed else "python calibrate.py"


def command_line(*words: object) -> str:
    """A command of the tool for a reader to run, spelled as this installation runs it; paths are quoted where a shell needs that."""
    return " ".join([program(), *map(shell_word, words)])


def given_effects(folders: Sequence[object]) -> list[object]:
    """Words of a command for the folders of effects that it is given."""
    return [word for path in folders for word in ("--effects", path)]


def install_line(extra: str, package: str) -> str:
    """What installs a package of an extra of this project, which is on no index, where the line is printed."""
    if not os.path.exists(CHECKOUT):
        return f"python -m pip install {shlex.quote(package)}"
    folder = os.path.realpath(os.path.dirname(CHECKOUT))
    folder = "." if folder == os.path.realpath(os.curdir) else folder
    return f"python -m pip install -e {shlex.quote(f'{folder}[{extra}]')}"


def _escaped(character: str) -> str:
    number = ord(character)
    return f"\\x{number - 0xDC00:02x}" if number in BYTES else repr(character)[1:-1]


def _in_shell(character: str) -> str:
    if character.isprintable():
        return f"\\{character}" if character in "\\'" else character
    return "".join(f"\\{byte:03o}" for byte in character.encode("utf-8", "surrogateescape" if ord(character) in BYTES else "replace"))


# Who gave a board's samples, as its frames, the logs' comments and session.toml call it.

STANDIN_NAME, SENSOR_NAME = "stand-in", "sensor"


# Numbers for reading: at most five significant digits, no exponent, and the minus sign of every keyboard, which pages set as in print.
# A file or a JSON document that needs all digits uses ``repr``.

NONE = "–"
#: of a number that is read
MOST_DIGITS = 5
#: below which a probability is a bound
LEAST_P = 1e-3
#: a minus sign of a number
MINUS = re.compile(r"(?<![\w.-])-(?=\d)")


def fixed(value: float, decimals: int) -> str:
    """Number with a fixed count of decimals; where that is below 0 it ends in zeros."""
    if not isfinite(value):
        return NONE
    text = f"{round(value, min(decimals, 0)) if decimals < 0 else value:.{max(decimals, 0)}f}"
    return text.removeprefix("-") if not any(digit in "123456789" for digit in text) else text


def significant(value: float, digits: int = 3) -> str:
    """Number with a given count of significant digits, and with all digits before the point up to five."""
    if not isfinite(value) or value == 0:
        return "0" if value == 0 else NONE
    return fixed(value, max(_decimals(value, digits), min(_decimals(value, MOST_DIGITS), 0)))


def measured(value: float, sigma: float | None = None) -> str:
    """``0.000951 ± 0.000012``: two digits of the sigma, the value to the same, or to five digits; without a sigma, five digits at most."""
    if sigma is None or not isfinite(sigma) or sigma <= 0 or not isfinite(value):
        text = significant(value, MOST_DIGITS)
        return text.rstrip("0").removesuffix(".") if "." in text else text
    decimals = _decimals(sigma, 2)
    most = decimals if value == 0 else min(decimals, _decimals(value, MOST_DIGITS))
    return f"{fixed(value, most)} ± {fixed(sigma, decimals)}"


def _decimals(value: float, digits: int) -> int:
    """How many decimals show so many significant digits of a value, once it is rounded."""
    return digits - 1 - int(f"{value:.{digits - 1}e}".partition("e")[2])


def degrees(angle_rad: float) -> str:
    """Angle in degrees, with the sign ``°``."""
    return f"{significant(angle_rad / DEG)}°"


def probability(p: float | None, is_bound: bool = False) -> str:
    """Text ``p = 0.31``; ``p < 0.31`` of a bound, and ``p < 0.001`` of all that is less."""
    if p is None or not isfinite(p):
        return f"p {NONE}"
    return f"p {'<' if is_bound or p < LEAST_P else '='} {significant(max(p, LEAST_P), 2 if p >= LEAST_P else 1)}"


def print_minus(text: str) -> str:
    """Text with the minus signs of print, for a page or a picture."""
    return MINUS.sub("−", text)
