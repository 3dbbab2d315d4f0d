"""Pieces of the page: everything that may come from a file goes through ``escape``."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape as _escape

from session.common.texts import printable

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
