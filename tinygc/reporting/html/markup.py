"""Pieces of the page: escaped markup, and numbers as a person reads them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape as _escape
from math import floor, isfinite, log10

import numpy as np

from session.io.texts import printable
from session.io.units import DEG

# Numbers as a person reads them: as many digits as are known, a true minus sign, thin spaces between thousands.

NONE = "–"


def fixed(value: float, decimals: int) -> str:
    """With so many decimals."""
    if not isfinite(value):
        return NONE
    text = f"{value:,.{max(decimals, 0)}f}".replace(",", "\u202f").replace("-", "−")
    return text.removeprefix("−") if not any(digit in "123456789" for digit in text) else text


def significant(value: float, digits: int = 3) -> str:
    """With so many significant digits, never as a power of ten."""
    if not isfinite(value) or value == 0:
        return "0" if value == 0 else NONE
    return fixed(value, digits - 1 - floor(log10(abs(value)) + 1e-12))


def decimals_for(expanded: float) -> int:
    """Decimals that give an uncertainty two significant digits."""
    return 0 if not isfinite(expanded) or expanded <= 0 else max(0, 1 - floor(log10(expanded) + 1e-12))


def aligned_decimals(floor_deg: float) -> int:
    """Decimals for a column of closures in degrees: a digit beyond the floor's second."""
    return decimals_for(floor_deg) + 1


def degrees(angle_rad: float) -> str:
    """An angle in degrees, with its sign ``°``."""
    return f"{significant(angle_rad / DEG)}°"


def tilt_rms(angles: np.ndarray) -> float:
    """rad: root mean square tilt of error angles (S, 2 or 3)."""
    return float(np.sqrt(np.mean(np.sum(angles[:, :2] ** 2, axis=1))))


def probability(p: float) -> str:
    """``p = 0.31``, or a bound."""
    if not isfinite(p):
        return f"p {NONE}"
    if p < 1e-99:
        return "p < 10⁻⁹⁹"
    if p >= 1e-3:
        return f"p = {significant(p, 2)}"
    return f"p = {power_of_ten(p)}"


def power_of_ten(value: float) -> str:
    """``3 × 10⁻⁷``."""
    exponent = floor(log10(value))
    superscript = str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
    return f"{value / 10**exponent:.0f} × 10{superscript}"


# Pieces of the page: everything that may come from a file goes through ``escape``.

#: a picture is drawn twice, for a wide page and for a telephone, and the style sheet shows one: its letters keep their size
WIDE, NARROW = 860, 340


@dataclass(frozen=True)
class Section:
    """One part of the page: the id of its heading, its title (short, for the list of contents), and its HTML."""

    id: str
    title: str
    html: str


def escape(text: object) -> str:
    """Text as HTML: no markup, and no control characters, gets through."""
    return _escape(printable(str(text)), quote=True)


def paragraph(html: str, kind: str = "") -> str:
    """HTML as a paragraph, with a class of the style sheet."""
    return f"<p{_kind(kind)}>{html}</p>"


def code(text: str) -> str:
    """A block of code, escaped; its own line ends stay."""
    shown = "\n".join(map(printable, text.split("\n")))
    return f'<pre tabindex="0"><code>{_escape(shown)}</code></pre>'


def key(kind: str, text: str, shape: str = "dot") -> str:
    """One entry of a picture's key; text is HTML; shape: dot, ring, line, dash, block."""
    return f'<span class="key k-{kind}"><i class="{shape}"></i>{text}</span>'


def figure(draw: Callable[[int], str], caption: str = "", keys: Sequence[str] = (), kind: str = "") -> str:
    """A picture; draw(width) returns its SVG; caption and keys are HTML."""
    head = f'<div class="keys">{"".join(keys)}</div>' if keys else ""
    foot = f"<figcaption>{caption}</figcaption>" if caption else ""
    return f'<figure{_kind(kind)}>{head}<div class="wide">{draw(WIDE)}</div><div class="narrow">{draw(NARROW)}</div>{foot}</figure>'


def table(
    header: Sequence[str],
    rows: Iterable[Sequence[str]],
    caption: str = "",
    kind: str = "",
    marked: Iterable[int] = (),
    minor: Iterable[int] = (),
) -> str:
    """A table of HTML cells, the first of each row its heading; marked: rows that stand out; minor: columns that a telephone leaves out."""
    marked, minor = set(marked), set(minor)
    head = "".join(f'<th scope="col"{_kind("minor" if i in minor else "")}>{cell}</th>' for i, cell in enumerate(header))
    body = "".join(
        f'<tr{_kind("marked" if number in marked else "")}><th scope="row">{row[0]}</th>'
        + "".join(f"<td{_kind('minor' if i in minor else '')}>{cell}</td>" for i, cell in enumerate(row[1:], start=1))
        + "</tr>"
        for number, row in enumerate(rows)
    )
    # Beside the table, not in it: a caption would be as wide as what is scrolled.
    above = f'<p class="caption">{caption}</p>' if caption else ""
    whole = f"<table{_kind(kind)}><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
    return f'{above}<div class="scroll" tabindex="0" role="region" aria-label="table">{whole}</div>'


def facts(pairs: Iterable[tuple[str, str]]) -> str:
    """A list of names and values, both HTML."""
    return '<dl class="facts">' + "".join(f"<div><dt>{name}</dt><dd>{value}</dd></div>" for name, value in pairs) + "</dl>"


def _kind(kind: str) -> str:
    return f' class="{kind}"' if kind else ""
