"""Text that leaves the tool: names, serial numbers and notes made fit for terminals, comments, JSON and commands; numbers for reading."""

from __future__ import annotations

import json
import os
import re
import shlex
import sys
from collections.abc import Sequence
from math import floor, isfinite, log10
from os import fspath

from session.base.units import DEG

# Texts that leave the tool.  Names of files, serial numbers, notes and what a board says are another's words: wherever they are put they
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


def _escaped(character: str) -> str:
    number = ord(character)
    return f"\\x{number - 0xDC00:02x}" if number in BYTES else repr(character)[1:-1]


def _in_shell(character: str) -> str:
    if character.isprintable():
        return f"\\{character}" if character in "\\'" else character
    return "".join(f"\\{byte:03o}" for byte in character.encode("utf-8", "surrogateescape" if ord(character) in BYTES else "replace"))


# Who gave a board's samples, as its frames, the logs' comments and session.toml call it.

STANDIN_NAME, SENSOR_NAME = "stand-in", "sensor"


# Numbers for reading: only significant digits, a true minus sign.

NONE = "–"
#: beyond which a value is written with a power of ten
MOST_DECIMALS = 12


def fixed(value: float, decimals: int) -> str:
    """Number with a fixed count of decimals."""
    if not isfinite(value):
        return NONE
    text = f"{value:.{max(decimals, 0)}f}".replace("-", "−")
    return text.removeprefix("−") if not any(digit in "123456789" for digit in text) else text


def significant(value: float, digits: int = 3) -> str:
    """Number with a given count of significant digits, never as a power of ten."""
    if not isfinite(value) or value == 0:
        return "0" if value == 0 else NONE
    return fixed(value, digits - 1 - floor(log10(abs(value)) + 1e-12))


def with_sigma(value: float, sigma: float) -> str:
    """``−4.21 ± 0.05``: both with two digits of the sigma; three digits of the value where there is no sigma."""
    if not (isfinite(sigma) and sigma > 0):
        return f"{value:.3g}".replace("-", "−")
    decimals = min(max(1 - floor(log10(sigma)), 0), 9)
    return f"{value:.{decimals}f} ± {sigma:.{decimals}f}".replace("-", "−")


def degrees(angle_rad: float) -> str:
    """Angle in degrees, with the sign ``°``."""
    return f"{significant(angle_rad / DEG)}°"


def measured(value: float, std: float | None = None) -> str:
    """``0.000951 ± 0.000012``: two digits of the std, the value to the same; five digits of a value whose std is not known."""
    if std is None or not isfinite(std) or std <= 0 or not isfinite(value):
        return f"{value:.5g}"
    decimals = 1 - int(f"{std:.1e}".split("e")[1])
    if decimals > MOST_DECIMALS:
        return f"{value:.5g} ± {std:.2g}"
    if decimals < 0:  # value and std both end in zeros
        return f"{round(value, decimals):.0f} ± {round(std, decimals):.0f}"
    return f"{round(value, decimals) + 0.0:.{decimals}f} ± {std:.{decimals}f}"  # no minus sign before nothing


def probability(p: float) -> str:
    """Text ``p = 0.31``, or a bound."""
    if not isfinite(p):
        return f"p {NONE}"
    if p < 1e-99:
        return "p < 10⁻⁹⁹"
    if p >= 1e-3:
        return f"p = {significant(p, 2)}"
    return f"p = {power_of_ten(p)}"


def power_of_ten(value: float) -> str:
    """Text such as ``3 × 10⁻⁷``."""
    exponent = floor(log10(value) + log10(1 / 0.95))  # 9.6 is 10 in one digit: 1 of the next power
    superscript = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{value / 10**exponent:.0f} × 10{superscript}"
