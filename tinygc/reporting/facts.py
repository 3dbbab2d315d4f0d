"""Facts, stated once: what a result has as text, tables and pictures, which a terminal, a page and a notebook render alike.

A result's facts are lines and tables in their order, the answer first.  A line is text, or rich's ``Text`` with a style; a ``Table`` has
cells of text.  A number goes with its sigma and is rounded to the sigma's two digits (``session/base/texts.py:measured``).  ``screen``
renders them for a terminal, ``html`` for a page, where minus signs and thousands are set as in print; a picture shows on the page alone.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import TYPE_CHECKING, Any, Protocol

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table as RichTable

from session import VERSION
from session.base.texts import NONE, measured, print_minus, printable, significant
from tinygc.inference.decide import Fact
from tinygc.reporting.terminal import Group, Text

if TYPE_CHECKING:
    from tinygc.reporting.html import markup

#: what a page shows of a terminal's style; others are plain there
KINDS = {"dim": "soft", "yellow": "warning"}
#: four digits or more of a whole number's part
THOUSANDS = re.compile(r"(?<![\d.\w])\d{4,}(?!\w)")


#: columns that a sentence is left in a table that is too wide
SENTENCE = 12


@dataclass(frozen=True, eq=False)
class Table:
    """A table: title; header; rows of cells as ``words`` takes them; caption; left: columns of words, by their places; styles of rows by
    their numbers, of which a page marks the bold ones; minor: columns that a telephone has no room for; kind: class of the page."""

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[Any]]
    caption: str = ""
    left: Collection[int] = (0,)
    styles: Mapping[int, str] = field(default_factory=dict)
    minor: Collection[int] = ()
    kind: str = ""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """For a terminal: a row is a line; where it is too narrow, the minor columns are left out, the last one first.  Only columns of
        sentences wrap."""
        rows = [[cell if isinstance(cell, Text) else Text(printable(words(cell))) for cell in row] for row in self.rows]
        cells = [[name, *(row[place].plain for row in rows if place < len(row))] for place, name in enumerate(self.header)]
        widths = [max(map(cell_len, each)) for each in cells]
        shown = list(range(len(self.header)))
        for place in sorted(self.minor, reverse=True):
            if sum(widths[each] + 1 for each in shown) - 1 > options.max_width:
                shown.remove(place)
        table = RichTable(box=None, padding=(0, 1, 0, 0), pad_edge=False, show_header=any(self.header))
        room = 0
        for place in shown:
            wraps = place in self.left and any(" " in cell for cell in cells[place][1:])
            least = min(widths[place], SENTENCE) if wraps else widths[place]
            table.add_column(self.header[place], justify="left" if place in self.left else "right", no_wrap=not wraps, min_width=least)
            room += least + 1
        table.width = room if room > options.max_width else None
        for number, row in enumerate(rows):
            table.add_row(*(row[place] for place in shown if place < len(row)), style=self.styles.get(number, ""))
        if self.title:
            yield Text(self.title, "bold")
        yield table
        if self.caption:
            yield Text(self.caption, "dim")

    def __html__(self) -> str:
        """For a page."""
        from tinygc.reporting.html import markup  # late: a terminal needs none

        rows = [[typeset(words(cell), place not in self.left) for place, cell in enumerate(row)] for row in self.rows]
        remarks = ". ".join(filter(None, (self.title, self.caption)))
        marked = [number for number, style in self.styles.items() if "bold" in style]
        return markup.table([typeset(cell) for cell in self.header], rows, typeset(remarks), self.kind, marked, self.minor)


def errors_table(
    title: str, facts: Sequence[Fact], notes: Sequence[str] = (), meanings: Mapping[str, str] | None = None, expanded: bool = False
) -> Table:
    """Errors of a sensor by axis: value ± one sigma, and what one missing effect may add; meanings of the terms: for a page; expanded: with
    the expanded uncertainty, in brackets what a missing effect has in it, and k."""
    rows: dict[str, tuple[list[str], set[str]]] = {}
    first: dict[str, str] = {}  # row of a word
    most: dict[str, float] = {}  # by unit
    for q in facts:
        axis, of = (q.component[-1], f" of {q.component[0]}") if " " in q.component else (q.component, "")  # x to y: of x, in column y
        meaning = "" if not meanings or q.word not in meanings else f"\n{'; '.join(filter(None, (meanings[q.word], q.note)))}"
        label = f"{q.word}{of}, {q.unit}"
        cells, factors = rows.setdefault(label + meaning * (first.setdefault(q.word, label) == label), ([], set()))
        cells += [""] * ("xyz".find(axis) - len(cells))
        text = q.stated if expanded or not q.observed else measured(q.value, q.sigma)
        if q.observed and isfinite(q.moved):
            text += f" ({significant(2 * q.moved, 2)})" * expanded
            most[q.unit] = max(q.moved, most.get(q.unit, 0.0))
        if q.observed and isfinite(q.expanded):
            factors.add(f"{q.factor:.2f}")
        cells.append(text if len(axis) == 1 else f"{axis} {text}")
    found = [[label, *cells, "", ""][:4] for label, (cells, _) in rows.items()]
    kind = "" if meanings is None else "parameters"
    if expanded:
        found = [[*row, "–".join(sorted({min(k), max(k)})) if k else ""] for row, (_, k) in zip(found, rows.values(), strict=True)]
        return Table(title, ("", "x", "y", "z", "k"), found, " ".join(notes), kind=kind)
    sizes = ", ".join(f"{significant(size, 2)} {unit}" for unit, size in most.items())
    added = [f"A missing effect may add up to {' and '.join(sizes.rsplit(', ', 1))}."] * bool(sizes)
    return Table(title, ("", "x", "y", "z"), found, " ".join([*added, *notes]), kind=kind)


class Drawn(Protocol):
    """What a page draws: a panel of ``tinygc.reporting.drawing``, with its caption as text."""

    caption: str

    def svg(self, width: float) -> str:
        """Draw it so wide."""


Part = str | Text | Table | Drawn
#: of a page: its id, its title, and its facts or HTML
Chapter = tuple[str, str, Iterable[Part] | str]


def screen(parts: Iterable[Part]) -> Group:
    """Facts for a terminal."""
    return Group(*(part for part in parts if not hasattr(part, "svg")))


def html(parts: Iterable[Part]) -> str:
    """Facts for a page."""
    return "".join(_html_of(part) for part in parts if part)


def _html_of(part: Part) -> str:
    from tinygc.reporting.html import markup  # late: a terminal needs none

    if isinstance(part, Table):
        return part.__html__()
    if not isinstance(part, str | Text):
        return markup.figure(part, typeset(part.caption))
    whole = part if isinstance(part, Text) else Text(part)
    ends = sorted({0, len(whole), *(end for span in whole.spans for end in (span.start, span.end))})
    remarks = "\u00a0" * (len(whole) - len(whole.plain.lstrip(" ")))  # a line that is set in, as a matrix' rows below its name
    for piece in whole.divide(ends[1:-1]):
        bold = any("bold" in str(style) for style in (piece.style, *(span.style for span in piece.spans)))
        text = typeset(piece.plain if remarks.strip() else piece.plain.lstrip(" "))
        remarks += f"<strong>{text}</strong>" if bold and text.strip() else text
    return markup.paragraph(remarks, KINDS.get(str(whole.style), ""))


def typeset(text: str, number: bool = False) -> str:
    """Text as HTML, its further lines small; with true minus signs, and thin spaces between the thousands of a number."""
    from tinygc.reporting.html import markup  # late: a terminal needs none

    remarks = print_minus(text)
    if number:
        remarks = THOUSANDS.sub(lambda found: f"{int(found[0]):,}".replace(",", "\u202f"), remarks)
    first, *more = ("\u202f".join(map(markup.escape, line.split("\u202f"))) for line in remarks.split("\n"))
    return first + "".join(f"<br><small>{line}</small>" for line in more)


def words(cell: Any) -> str:
    """A cell as text: a number with three digits, one and its sigma as ``measured``, a dash for what is not known."""
    if cell is None:
        return NONE
    if isinstance(cell, tuple):
        return NONE if cell[0] is None or not isfinite(cell[0]) else measured(*cell)
    return significant(cell) if isinstance(cell, float) else str(cell)


def page(kicker: str, heading: str, chapters: Iterable[Chapter], foot: str) -> str:
    """A document of chapters; foot: sentences below them."""
    from tinygc.reporting.html import markup  # late: a terminal needs none

    made = [markup.Section(name, title, remarks if isinstance(remarks, str) else html(remarks)) for name, title, remarks in chapters]
    head = f'<header><p class="kicker">{markup.escape(kicker)}</p><h1>{markup.escape(heading)}</h1></header>'
    return document(f"{kicker}: {heading}", head, made, f"<footer>{markup.escape(foot)} TinyGC {markup.escape(VERSION)}.</footer>")


def document(title: str, head: str, sections: Sequence[markup.Section], foot: str, running: tuple[str, str] = ("", "")) -> str:
    """HTML document of sections with a list of contents; head and foot are HTML, title is text; running: text at the top of each sheet of
    paper, left and right."""
    from tinygc.reporting.drawing import style_sheet
    from tinygc.reporting.html import markup  # late: a terminal needs none

    places = {"top-left": running[0], "top-right": running[1], "bottom-left": title}
    return markup.render("page.html", title=title, head=head, sections=sections, foot=foot, running=places, sheet=style_sheet()) + "\n"
