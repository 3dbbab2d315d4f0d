"""Drawing: panels declared in the units of their data, laid out once in pixels, and written as SVG.

A panel has two axes and marks: lines, points with their sigmas and names, areas, words.  A picture is a grid of panels.  Where limits,
ticks, margins and legends stand follows from the data and from the width.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import ceil, floor, log10
from pathlib import Path
from textwrap import wrap
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from session.base.errors import CalibrationError
from session.base.results import write_text_whole
from session.base.texts import fixed, print_minus
from tinygc.reporting.html.markup import escape

# Colours and styles, of which the style sheet of pages and of SVG files is made.

#: name -> colour in light and in dark; what carries words has a contrast of at least 4.5 with the page
COLOURS = {
    "page": ("#ffffff", "#14171b"),
    "ink": ("#1c2126", "#e7eaee"),
    "soft": ("#59626c", "#a3acb7"),
    "rule": ("#dfe3e8", "#31373f"),
    "grid": ("#e9ecf0", "#282e35"),
    "x": ("#b8442a", "#f08a6b"),
    "y": ("#1a7656", "#5fc9a0"),
    "z": ("#3358b8", "#8aa9f5"),
    "raw": ("#8a6d3b", "#cfae74"),
    "raw_bias_removed": ("#5b7a1f", "#a9c76a"),
    "least_squares": ("#1f5fbf", "#79adf7"),
    "pso": ("#6f4fc4", "#b39df2"),
    "tinygc": ("#0b7a75", "#5cc7c1"),
    "tinygc_denoised": ("#a83a78", "#ee92c4"),
    "physics": ("#b03a55", "#f58fa5"),
    "tinygc_physics": ("#3f6f8f", "#86b7d8"),
    "before": ("#8a6d3b", "#cfae74"),
    "after": ("#1f5fbf", "#79adf7"),
    "floor": ("#5d6670", "#98a1ac"),
    "limit": ("#a3341f", "#f2937d"),
    "good": ("#1a7656", "#5fc9a0"),
    "bad": ("#b3261e", "#ff8a80"),
    "still": ("#1a7656", "#5fc9a0"),
    "turn": ("#1f5fbf", "#79adf7"),
    "quiet": ("#7c848d", "#828b95"),
}
#: style -> px of the stroke, 0 where the shape is filled; px of dash and gap; opacity
STYLES: dict[str, tuple[float, tuple[int, ...], float]] = {
    "hair": (1.0, (), 1.0),
    "line": (1.7, (), 1.0),
    "thin": (1.0, (), 0.75),
    "dash": (1.3, (5, 4), 1.0),
    "area": (0.0, (), 0.2),
    "block": (0.0, (), 0.22),
    "solid": (0.0, (), 1.0),
    "faint": (0.0, (), 0.28),
    "dot": (0.0, (), 1.0),
    "ring": (1.6, (), 1.0),
}
#: style of a text -> its size in px, whether it is bold
TEXTS = {"tick": (12, False), "word": (12, False), "strong": (13, True), "head": (16, True)}
#: width of a letter in its size, for room; of the fonts of pages the widest
LETTER = 0.57


def style_sheet() -> str:
    """Colours, light and dark, and the styles of shapes and texts, for a page or a file of its own."""
    light, dark = ("".join(f"--{name}:{shades[n]};" for name, shades in COLOURS.items()) for n in (0, 1))
    rules = [f":root{{{light}}}", f"@media screen and (prefers-color-scheme:dark){{:root{{{dark}}}}}"]
    rules += [f".k-{name}{{--c:var(--{name})}}" for name in COLOURS]
    for name, (width, dash, opacity) in STYLES.items():
        inside = "var(--page)" if name == "ring" else "none" if width else "var(--c)"
        stroke = f";stroke:var(--c);stroke-width:{width};stroke-linejoin:round" if width else ""
        dashes = f";stroke-dasharray:{' '.join(map(str, dash))}" if dash else ""
        rules.append(f"svg .{name}{{fill:{inside}{stroke}{dashes}{f';opacity:{opacity}' if opacity < 1 else ''}}}")
    rules.append("svg text{font-family:inherit;fill:var(--c)}")
    rules += [f"svg .{name}{{font-size:{size}px{';font-weight:640' if bold else ''}}}" for name, (size, bold) in TEXTS.items()]
    rules.append("svg .word{paint-order:stroke;stroke:var(--halo,var(--page));stroke-width:3.5px;stroke-linejoin:round}")
    return "\n".join(rules)


# What is declared: axes, marks, panels.


@dataclass(eq=False)
class Axis:
    """An axis: label with its unit; lo and hi, or None for what the data need; zero: with zero; ticks: with their texts, or None for round
    ones; down: values grow downward, or to the left."""

    label: str = ""
    lo: float | None = None
    hi: float | None = None
    log: bool = False
    zero: bool = False
    ticks: Sequence[tuple[float, str]] | None = None
    down: bool = False

    def ends(self, values: np.ndarray) -> tuple[float, float]:
        """Both ends of the axis around the finite values: 6 % of room, none at zero; 1, 2 or 5 times a power of ten where it is log."""
        numbers = values[np.isfinite(values) & (values > 0 if self.log else True)]
        if self.log:
            lo, hi = (numbers.min() / 1.15, numbers.max() * 1.15) if len(numbers) else (0.1, 10.0)
            lo, hi = _round_down(lo), 1 / _round_down(1 / hi)
        else:
            lo, hi = (float(numbers.min()), float(numbers.max())) if len(numbers) else (0.0, 1.0)
            if self.zero:
                lo, hi = min(lo, 0.0), max(hi, 0.0)
            room = 0.06 * (hi - lo) or max(abs(hi), 1e-12) * 0.1
            lo, hi = (lo if self.zero and lo == 0 else lo - room), (hi if self.zero and hi == 0 else hi + room)
        return (lo if self.lo is None else self.lo), (hi if self.hi is None else self.hi)

    def place(self, values: np.ndarray, lo: float, hi: float) -> np.ndarray:
        """Position along the axis, 0 at lo and 1 at hi; an infinite value, and one that a log axis has no place for, is at its end."""
        with np.errstate(invalid="ignore", divide="ignore"):
            ahead = np.log(np.maximum(values, 0) / lo) / np.log(hi / lo) if self.log else (values - lo) / (hi - lo)
        ahead = np.where(np.isinf(ahead), (ahead > 0).astype(float), np.clip(ahead, -30, 31))
        return 1 - ahead if self.down else ahead

    def marks(self, lo: float, hi: float, room_px: float) -> list[tuple[float, str]]:
        """Ticks with their texts, as many as fit."""
        if self.ticks is not None:
            return [(value, text) for value, text in self.ticks if lo <= value <= hi]
        return _log_marks(lo, hi, room_px) if self.log else _round_marks(lo, hi, max(2, int(room_px / 62)))


def _round_down(value: float) -> float:
    power = 10.0 ** floor(log10(value) + 1e-12)
    return max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)) * power


def _round_marks(lo: float, hi: float, most: int) -> list[tuple[float, str]]:
    power = 10.0 ** floor(log10((hi - lo) / most / 2))
    steps = (m * power for m in (1, 2, 5, 10, 20, 50, 100))
    step = next(step for step in steps if floor(hi / step + 1e-9) - ceil(lo / step - 1e-9) <= most)
    decimals = max(0, -floor(log10(step) + 1e-9))
    return [(k * step, fixed(k * step, decimals)) for k in range(ceil(lo / step - 1e-9), floor(hi / step + 1e-9) + 1)]


def _log_marks(lo: float, hi: float, room_px: float) -> list[tuple[float, str]]:
    lowest, highest, decades = floor(log10(lo) + 1e-9), ceil(log10(hi) - 1e-9), log10(hi / lo)
    steps = (1, 2, 5) if decades * 3 < room_px / 34 else (1,)
    skip = max(1, ceil(decades * 30 / room_px)) if steps == (1,) else 1
    values = [step * 10.0**power for power in range(lowest, highest + 1, skip) for step in steps]
    inside = [value for value in values if lo * (1 - 1e-9) <= value <= hi * (1 + 1e-9)]
    return [(value, fixed(value, max(0, -floor(log10(value) + 1e-9)))) for value in inside]


@dataclass(frozen=True, eq=False)
class Mark:
    """Something in a panel, in units of its axes: y (n,) over x (n,), up to hi (n,) for an area, ± sigma (n,) for points.

    style, kind: of ``STYLES`` and ``COLOURS``; name: in the legend; labels: of each point, when pointed at, or the words that are written;
    radius: of points, px; is_measure: whether the limits leave room for it.
    """

    style: str
    kind: str
    x: np.ndarray
    y: np.ndarray
    hi: np.ndarray | None = None
    sigma: np.ndarray | None = None
    name: str = ""
    labels: Sequence[str] = ()
    radius: float = 0.0
    opacity: float = 1.0
    is_measure: bool = True
    anchor: str = "start"


@dataclass(eq=False)
class Panel:
    """Two axes and what is drawn in them, in its order.

    title: above it; about: in place of a title, for who cannot see it; caption: below it, on a page; legend: title of the legend;
    height: of the frame, px; widest: px;
    is_equal: one scale for both axes; is_framed: with axes.  An infinite x or y stands at the frame's edge; a NaN is a gap.
    """

    x: Axis = field(default_factory=Axis)
    y: Axis = field(default_factory=Axis)
    title: str = ""
    about: str = ""
    caption: str = ""
    legend: str = ""
    height: float = 210.0
    widest: float = 1e9
    is_equal: bool = False
    is_framed: bool = True
    marks: list[Mark] = field(default_factory=list)

    def add(self, style: str, kind: str, x: ArrayLike, y: ArrayLike, **more: Any) -> Panel:
        """Add a mark; x, y, hi and sigma are numbers or (n,)."""
        x, y = np.broadcast_arrays(np.atleast_1d(np.asarray(x, dtype=float)), np.asarray(y, dtype=float))
        for name in ("hi", "sigma"):
            if more.get(name) is not None:
                more[name] = np.broadcast_to(np.asarray(more[name], dtype=float), x.shape)
        self.marks.append(Mark(style, kind, x, y, **more))
        return self

    def line(self, x: ArrayLike, y: ArrayLike, kind: str, style: str = "line", **more: Any) -> Panel:
        """Draw a line with gaps where y is NaN; style: line, thin, dash, hair."""
        return self.add(style, kind, x, y, **more)

    def points(self, x: ArrayLike, y: ArrayLike, kind: str, ring: bool = False, radius: float = 3.2, **more: Any) -> Panel:
        """Draw points, pale where their sigma is large; labels: one text for each, shown when pointed at."""
        return self.add("ring" if ring else "dot", kind, x, y, radius=radius, **more)

    def area(self, x: ArrayLike, lo: ArrayLike, hi: ArrayLike, kind: str, style: str = "area", **more: Any) -> Panel:
        """Fill the area between two lines; style: area, block, solid."""
        return self.add(style, kind, x, lo, hi=hi, **more)

    def across(self, y: float, kind: str = "floor", style: str = "dash", **more: Any) -> Panel:
        """Draw a horizontal line."""
        return self.add(style, kind, [-np.inf, np.inf], y, **more)

    def zero(self) -> Panel:
        """Draw a thin line at zero."""
        return self.across(0.0, "quiet", "hair")

    def upright(self, x: float, kind: str = "floor", style: str = "dash", **more: Any) -> Panel:
        """Draw a vertical line."""
        return self.add(style, kind, x, [-np.inf, np.inf], **more)

    def words(self, x: float, y: float, words: str, kind: str = "soft", **more: Any) -> Panel:
        """Write words next to a place; anchor: start, middle or end."""
        return self.add("word", kind, x, y, labels=(words,), **more)

    def ends(self) -> list[tuple[float, float]]:
        """Both ends of x and of y."""
        return [axis.ends(_measures(self, n)) for n, axis in enumerate((self.x, self.y))]

    def svg(self, width: float) -> str:
        """The panel alone as an SVG element."""
        return Picture([self]).svg(width)


def to_one_scale(*panels: Panel) -> None:
    """Give panels the same ends of x and of y, which hold the data of all."""
    for axes, ends in zip(
        ((panel.x for panel in panels), (panel.y for panel in panels)), zip(*(p.ends() for p in panels), strict=True), strict=True
    ):
        lo, hi = min(lo for lo, _ in ends), max(hi for _, hi in ends)
        for axis in axes:
            axis.lo, axis.hi = lo, hi


# What is laid out: shapes in pixels.

#: left, top, right, bottom
Box = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class Shape:
    """A path of parts (n, 2), or a point of a radius at each row of the first part, or words at its first row; labels: of each point, or of
    the path; opacity (n,) of the points or parts, on top of the style's; clip: where it is cut off."""

    style: str
    kind: str
    parts: Sequence[np.ndarray]
    labels: Sequence[str] = ()
    radius: float = 0.0
    opacity: np.ndarray | None = None
    clip: Box | None = None
    anchor: str = "start"


def _words(style: str, kind: str, x: float, y: float, words: str, anchor: str = "start") -> Shape:
    return Shape(style, kind, [np.array([[x, y]])], (words,), anchor=anchor)


def _path(style: str, kind: str, *points: tuple[float, float]) -> Shape:
    return Shape(style, kind, [np.array(points)])


def _wide(text: str) -> float:
    return LETTER * TEXTS["tick"][0] * len(text)


#: px: height of a line of words, of a row of the legend; between an entry's sample and its words, and between entries
LINE, ROW, SAMPLE, APART = 18, 18, 24, 14


@dataclass(frozen=True, eq=False)
class _Head:
    """What stands above a frame: lines of the title, rows of the legend, whose entries have their place and their marks."""

    title: list[str]
    rows: list[list[tuple[float, str, list[Mark]]]]
    height: float


def _head(panel: Panel, width: float) -> _Head:
    entries: dict[str, dict[tuple[str, str], Mark]] = {}  # each sort of mark of a name once
    for mark in panel.marks:
        if mark.name:
            entries.setdefault(mark.name, {}).setdefault((mark.style, mark.kind), mark)
    rows: list[list[tuple[float, str, list[Mark]]]] = []
    at = np.inf
    for name, marks in entries.items():
        wide = SAMPLE + _wide(name) + APART
        if at + wide - APART > width:
            rows.append([])
            at = 0.0
        rows[-1].append((at, name, list(marks.values())))
        at += wide
    title = [line for part in panel.title.split("\n") for line in wrap(part, int(width / LETTER / TEXTS["strong"][0]))]
    lines = len(wrap(panel.legend, int(width / LETTER / 12)))
    return _Head(title, rows, LINE * (len(title) + lines) + ROW * len(rows) + (LINE if panel.y.label and panel.is_framed else 0) + 6)


def _draw_head(panel: Panel, head: _Head, left: float, top: float, width: float, room: float) -> Iterable[Shape]:
    y = top + 12.0
    for line in head.title:
        yield _words("strong", "ink", left, y, line)
        y += LINE
    y += room - head.height  # the rest stands at the frame
    for line in wrap(panel.legend, int(width / LETTER / 12)):
        yield _words("tick", "soft", left, y, line)
        y += LINE
    for row in head.rows:
        for at, name, marks in row:
            x = left + at
            for mark in marks:
                if mark.radius:
                    yield Shape(mark.style, mark.kind, [np.array([[x + 8, y - 4]])], radius=min(mark.radius, 4.5))
                elif mark.hi is not None:
                    yield _path(mark.style, mark.kind, (x, y - 9), (x + 16, y - 9), (x + 16, y + 1), (x, y + 1))
                else:
                    yield _path(mark.style, mark.kind, (x, y - 4), (x + 17, y - 4))
            yield _words("tick", "soft", x + SAMPLE, y, name)
        y += ROW
    if panel.y.label and panel.is_framed:
        yield _words("tick", "soft", left, y, panel.y.label)


#: share of the width that names of ticks may take next to the frame; longer ones stand inside, above their lines
WIDEST_NAMES = 0.35


def _lay(panel: Panel, left: float, top: float, width: float, head_room: float) -> tuple[list[Shape], float]:
    """The shapes of a panel whose upper left corner and width are given, with room for the head; and its bottom."""
    shapes = list(_draw_head(panel, _head(panel, width), left, top, width, head_room))
    over = top + head_room
    ends = panel.ends()
    y_marks = panel.y.marks(*ends[1], panel.height * 1.4) if panel.is_framed else []
    names_px = max([_wide(text) for _, text in y_marks], default=0.0) + 10
    is_inside = panel.y.ticks is not None and names_px > WIDEST_NAMES * width
    margin = (14.0 if is_inside else max(names_px, 26.0)) if panel.is_framed else 3.0
    frame = (left + margin, over, left + width - (14 if panel.is_framed else 3), over + panel.height)
    if panel.is_equal:
        ends = _equal(ends, frame)
    here = _Place(panel, frame, ends)
    if panel.is_framed:
        shapes += _frame(panel, here, y_marks, is_inside)
    for mark in panel.marks:
        shapes += here.shapes(mark)
    bottom = frame[3] + (20 if panel.is_framed else 4)
    if panel.x.label:
        shapes.append(_words("tick", "soft", (frame[0] + frame[2]) / 2, bottom + 14, panel.x.label, "middle"))
        bottom += 20
    return shapes, bottom


def _measures(panel: Panel, n: int) -> np.ndarray:
    """All values along one axis that its limits leave room for."""
    values = [np.zeros(0)]
    for mark in panel.marks:
        if not mark.is_measure:
            continue
        values.append((mark.x, mark.y)[n])
        if n == 1 and mark.hi is not None:
            values.append(mark.hi)
        if n == 1 and mark.sigma is not None:
            values += [mark.y - mark.sigma, mark.y + mark.sigma]
    return np.concatenate(values)


def _equal(ends: list[tuple[float, float]], frame: Box) -> list[tuple[float, float]]:
    """Ends that give both axes one scale, about the same middle."""
    sizes = (frame[2] - frame[0], frame[3] - frame[1])
    scale = max((hi - lo) / size for (lo, hi), size in zip(ends, sizes, strict=True))
    middles = [(lo + hi) / 2 for lo, hi in ends]
    return [(middle - scale * size / 2, middle + scale * size / 2) for middle, size in zip(middles, sizes, strict=True)]


def _frame(panel: Panel, here: _Place, y_marks: list[tuple[float, str]], is_inside: bool) -> Iterable[Shape]:
    """Grid, ticks and their texts, and the lower edge; a tick's text that has no room is left out."""
    left, top, right, bottom = here.frame
    last = -1e9
    for value, text in panel.x.marks(*here.ends[0], right - left):
        x = float(here.at([value], [here.ends[1][0]])[0, 0])
        wide = _wide(text) / 2
        if x - wide < last + 6 or x + wide > right + 14:
            continue
        last = x + wide
        yield _path("hair", "grid", (x, top), (x, bottom))
        yield _words("tick", "soft", x, bottom + 16, text, "middle")
    for value, text in y_marks:
        y = float(here.at([here.ends[0][0]], [value])[0, 1])
        yield _path("hair", "grid", (left, y), (right, y))
        yield _words("word", "soft", left + 2, y - 12, text) if is_inside else _words("tick", "soft", left - 8, y + 4, text, "end")
    yield _path("hair", "rule", (left, bottom), (right, bottom))


#: points of a line per pixel of its width
POINTS_PER_PIXEL = 2


@dataclass(frozen=True, eq=False)
class _Place:
    """Where the data of a panel are in its frame; ends: of both axes."""

    panel: Panel
    frame: Box
    ends: list[tuple[float, float]]

    def at(self, x: ArrayLike, y: ArrayLike) -> np.ndarray:
        """(n, 2) px; NaN stays."""
        left, top, right, bottom = self.frame
        across = self.panel.x.place(np.asarray(x, dtype=float), *self.ends[0])
        up = self.panel.y.place(np.asarray(y, dtype=float), *self.ends[1])
        return np.stack([left + across * (right - left), bottom - up * (bottom - top)], axis=-1)

    def shapes(self, mark: Mark) -> list[Shape]:
        """The shapes of one mark."""
        left, top, right, bottom = self.frame
        at = self.at(mark.x, mark.y)
        if mark.style in TEXTS:
            return [_words(mark.style, mark.kind, float(at[0, 0]), float(at[0, 1]), mark.labels[0], mark.anchor)]
        opacity = np.full(len(at), mark.opacity)
        if mark.radius:
            inside = np.all((at >= [left - 1, top - 1]) & (at <= [right + 1, bottom + 1]), axis=1)
            bars = []
            if mark.sigma is not None and len(at):
                opacity = opacity * np.clip(2 * np.min(mark.sigma) / np.maximum(mark.sigma, 1e-300), 0.2, 1)
                ends = [self.at(mark.x, mark.y + side * mark.sigma) for side in (-1, 1)]
                bars = [self._clipped("thin", mark.kind, list(np.stack(ends, axis=1)), opacity)]
            labels = [text for text, keep in zip(mark.labels, inside, strict=True) if keep] if len(mark.labels) else ()
            return [*bars, Shape(mark.style, mark.kind, [at[inside]], labels, mark.radius, opacity[inside])]
        if mark.hi is not None:
            parts = [np.concatenate([at, self.at(mark.x, mark.hi)[::-1]])]
        else:
            x, y = _thinned(mark.x, mark.y, int((right - left) * POINTS_PER_PIXEL))
            parts = _unbroken(self.at(x, y))
        return [self._clipped(mark.style, mark.kind, parts, np.full(len(parts), mark.opacity), mark.labels)] if parts else []

    def _clipped(self, style: str, kind: str, parts: list[np.ndarray], opacity: np.ndarray, labels: Sequence[str] = ()) -> Shape:
        left, top, right, bottom = self.frame
        ends = np.concatenate(parts)
        spills = np.any(ends < np.array([left, top]) - 0.5) or np.any(ends > np.array([right, bottom]) + 0.5)
        return Shape(style, kind, parts, labels, 0.0, opacity, self.frame if spills else None)


def _unbroken(points: np.ndarray) -> list[np.ndarray]:
    """The parts of a line (n, 2) between its gaps."""
    fine = np.isfinite(points).all(axis=1)
    parts = np.split(points, np.flatnonzero(np.diff(fine)) + 1)
    return [part for part in parts if len(part) > 1 and np.isfinite(part).all()]


def _thinned(x: np.ndarray, y: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Thin a long line to the lowest and the highest point of each interval, which keeps its envelope."""
    if len(x) <= most:
        return x, y
    edges = np.linspace(0, len(x), most // 2 + 1).astype(int)
    starts, each, at, fine = edges[:-1], np.diff(edges), np.arange(len(x)), np.isfinite(y)
    lowest = np.repeat(np.minimum.reduceat(np.where(fine, y, np.inf), starts), each)
    highest = np.repeat(np.maximum.reduceat(np.where(fine, y, -np.inf), starts), each)
    chosen = (fine & (y == lowest), fine & (y == highest), ~fine)
    first = np.unique([np.minimum.reduceat(np.where(which, at, len(x)), starts) for which in chosen])
    keep = first[first < len(x)]
    return x[keep], y[keep]


# A picture: a grid of panels, below its own title; and what is written of it.

#: px: width of a file of its own, and its margin; between panels across and down
FILE_WIDTH, MARGIN, ACROSS, DOWN = 1180, 14, 34, 22


@dataclass(eq=False)
class Picture:
    """Panels in a grid of so many columns, as far as each is then least px wide; title, labels: lines above them.

    A notebook shows it as SVG.
    """

    panels: Sequence[Panel]
    title: str = ""
    labels: Sequence[str] = ()
    columns: int = 2
    least: float = 330.0

    def shapes(self, width: float) -> tuple[list[Shape], float]:
        """All shapes at a width, and the height."""
        shapes, top = [], 4.0
        for style, text in (("head", self.title), *(("tick", line) for line in self.labels)):
            for line in wrap(text, int(width / LETTER / TEXTS[style][0])):
                top += TEXTS[style][0] + 3
                shapes.append(_words(style, "ink", 0, top, line))
                top += 4
        top += 14 if shapes else 0
        columns = int(np.clip((width + ACROSS) // (self.least + ACROSS), 1, min(self.columns, len(self.panels))))
        own = (width - (columns - 1) * ACROSS) / columns
        for first in range(0, len(self.panels), columns):
            row = self.panels[first : first + columns]
            head_room = max(_head(panel, own).height for panel in row)
            laid = [_lay(panel, n * (own + ACROSS), top, own, head_room) for n, panel in enumerate(row)]
            shapes += [shape for some, _ in laid for shape in some]
            top = max(bottom for _, bottom in laid) + DOWN
        return shapes, top - DOWN + 4

    def svg(self, width: float, margin: float = 0.0, sheet: str = "") -> str:
        """An SVG element for a page, whose style sheet it uses; margin, sheet: of a file of its own."""
        width = min(width, max(panel.widest for panel in self.panels)) if len(self.panels) == 1 else width
        shapes, height = self.shapes(width - 2 * margin)
        about = escape(self.title or self.panels[0].about or " ".join(self.panels[0].title.split()))
        size = f'viewBox="{-margin:g} {-margin:g} {width:g} {height + 2 * margin:g}" width="{width:g}" height="{height + 2 * margin:g}"'
        inside = f"<title>{about}</title>{sheet}{''.join(map(_svg, shapes))}"
        return f'<svg xmlns="http://www.w3.org/2000/svg" {size} role="img" aria-label="{about}">{inside}</svg>'

    def _repr_svg_(self) -> str:
        """A file of its own, which is dark where the reader's screen is."""
        letters = "svg{background:var(--page);font-family:'DejaVu Sans','Helvetica Neue',Arial,sans-serif;max-width:100%;height:auto}"
        return self.svg(FILE_WIDTH, MARGIN, f"<style>{style_sheet()}\n{letters}</style>")

    def save(self, path: Path) -> None:
        """Write an SVG file in a folder that is made where it is missing.  Raises StorageError where it cannot be written."""
        if path.is_dir() or path.suffix.lower() != ".svg":
            raise CalibrationError(f"{path}: {'that is a folder' if path.is_dir() else 'a picture is an SVG'}; give a file such as fit.svg")
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text_whole(path, self._repr_svg_() + "\n")


def saved(picture: Picture, path: Path | str | None) -> Picture:
    """The picture, and its file where a path is given."""
    if path is not None:
        picture.save(Path(path))
    return picture


# Both writers of shapes.


def _px(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")


def _d(part: np.ndarray, is_closed: bool) -> str:
    return f"M{'L'.join(f'{_px(x)} {_px(y)}' for x, y in part)}{'Z' * is_closed}"


def _ended(inside: str, element: str) -> str:
    return f">{inside}</{element}>" if inside else "/>"


def _svg(shape: Shape) -> str:
    kind = f'class="{shape.style} k-{shape.kind}"'
    titles = [f"<title>{escape(print_minus(text))}</title>" for text in shape.labels]
    if shape.style in TEXTS:
        ((x, y),) = shape.parts[0]
        anchor = "" if shape.anchor == "start" else f' text-anchor="{shape.anchor}"'
        return f'<text {kind} x="{_px(x)}" y="{_px(y)}"{anchor}>{escape(print_minus(shape.labels[0]))}</text>'
    opacities = () if shape.opacity is None else shape.opacity
    pale = [f' style="opacity:{STYLES[shape.style][2] * value:.2g}"' if value < 0.995 else "" for value in opacities]
    if shape.radius:
        places = zip(shape.parts[0], titles or [""] * len(shape.parts[0]), pale or [""] * len(shape.parts[0]), strict=True)
        marks = (f'<circle cx="{_px(x)}" cy="{_px(y)}" r="{shape.radius:g}"{own}{_ended(title, "circle")}' for (x, y), title, own in places)
        return f"<g {kind}>{''.join(marks)}</g>"
    is_closed, title = not STYLES[shape.style][0], "".join(titles)
    paths: dict[str, list[str]] = {}  # by opacity
    for part, own in zip(shape.parts, pale or [""] * len(shape.parts), strict=True):
        paths.setdefault(own, []).append(_d(part, is_closed))
    drawn = "".join(f'<path {kind}{own} d="{"".join(parts)}"{_ended(title, "path")}' for own, parts in paths.items())
    if shape.clip is None:
        return drawn
    left, top, right, bottom = shape.clip  # an inner SVG element cuts off what is beyond
    box = f"{_px(left)} {_px(top)} {_px(right - left)} {_px(bottom - top)}"
    x, y, width, height = box.split()
    return f'<svg x="{x}" y="{y}" width="{width}" height="{height}" viewBox="{box}">{drawn}</svg>'
