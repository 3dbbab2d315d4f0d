"""Building blocks of the page: escaped markup."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from html import escape as _escape
from math import isfinite
from typing import TYPE_CHECKING, Any

from session.base.texts import command_line, degrees, fixed, print_minus, printable, probability, significant

if TYPE_CHECKING:
    from jinja2 import Environment


# Markup is in ``templates``, which escape their values.  These functions call the templates' macros for pages that features build.

#: widths of a picture's two versions, for a wide page and a telephone; the style sheet shows one, so that text keeps its size
WIDE, NARROW = 860, 340


@dataclass(frozen=True)
class Section:
    """One part of the page: the id of its heading, its title (short, for the list of contents), and its HTML."""

    id: str
    title: str
    html: str


HERE = "tinygc.reporting.html"


@cache
def _environment(package: str) -> Environment:
    """Jinja environment of a package's templates: values are escaped, control characters included."""
    from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined

    def shown(value: object) -> object:
        return value if hasattr(value, "__html__") else printable(str(value))

    loader = ChoiceLoader([PackageLoader(package), PackageLoader(HERE)])  # the macros are here
    environment = Environment(
        loader=loader, autoescape=True, finalize=shown, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals |= {"wide": WIDE, "narrow": NARROW, "command": command_line}
    environment.tests["finite"] = isfinite
    environment.filters |= {number.__name__: partial(_printed, number) for number in (fixed, significant, degrees, probability)}
    environment.filters["css"] = css_text
    environment.filters["sentence"] = lambda words: f"{words[:1].upper()}{words[1:]}."
    return environment


def _printed(number: Callable[..., str], *values: Any) -> str:
    return print_minus(number(*values))


def render(template: str, package: str = HERE, **values: object) -> str:
    """Render a file of the ``templates`` of this package, or of a feature's, with values."""
    return _environment(package).get_template(template).render(values)


def _html(value: Any) -> Any:
    """Mark text, also inside sequences, as HTML that is not escaped again."""
    from markupsafe import Markup

    if isinstance(value, str):
        return Markup(value)
    return [_html(each) for each in value] if isinstance(value, Iterable) else value


def _macro(name: str, *values: object, **more: object) -> str:
    macro = getattr(_environment(HERE).get_template("macros.html").module, name)
    return str.__str__(macro(*values, **more))


def escape(text: object) -> str:
    """Text as HTML, with markup and control characters escaped."""
    return _escape(printable(str(text)), quote=True)


def css_text(text: str) -> str:
    """Text for a string of a style sheet, where HTML's escapes do not count: every other sign is a number, with the space that ends it."""
    return _html("".join(sign if sign.isascii() and sign.isalnum() else f"\\{ord(sign):x} " for sign in printable(text)))


def paragraph(html: str, kind: str = "") -> str:
    """HTML as a paragraph, with a class of the style sheet."""
    return f'<p class="{kind}">{html}</p>' if kind else f"<p>{html}</p>"


def code(text: str) -> str:
    """A block of code, escaped, with its line breaks."""
    return _macro("code", text)


def figure(picture: Any, caption: str = "") -> str:
    """A figure of a panel or a picture (``tinygc.reporting.drawing``), for a wide page and a telephone; caption is HTML."""
    return _macro("figure", picture, **({"caller": lambda: _html(caption)} if caption else {}))


def table(
    header: Sequence[str],
    rows: Iterable[Sequence[str]],
    caption: str = "",
    kind: str = "",
    marked: Iterable[int] = (),
    minor: Iterable[int] = (),
) -> str:
    """Table of HTML cells; the first cell of each row is its heading; marked: highlighted rows; minor: columns hidden on a telephone."""
    return _macro("table", _html(header), _html(rows), _html(caption), kind, set(marked), set(minor))
