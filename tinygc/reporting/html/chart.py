"""Charts as inline SVG: lines and points, directions on a sphere, a triad of axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, floor, log10

import numpy as np
from numpy.typing import ArrayLike

from session.base.rotation import unit_vectors
from session.base.texts import fixed
from tinygc.reporting.html.markup import escape

# Charts as inline SVG, small and without scripts; the page's style sheet sets colours by class (``k-…``) and the font size.
#
# Coordinates are pixels of the drawing.  One drawing is made for each page width, so that text keeps its size.

#: points of a line per pixel of its width
POINTS_PER_PIXEL = 2


@dataclass(frozen=True)
class Axis:
    """Axis from lo to hi, linear or log; label; ticks with their texts, or None for automatic round ones."""

    lo: float
    hi: float
    label: str = ""
    log: bool = False
    ticks: Sequence[tuple[float, str]] | None = None

    def place(self, value: ArrayLike) -> np.ndarray:
        """Position along the axis: 0 at lo, 1 at hi, extrapolated beyond them."""
        if not self.log:
            return (np.asarray(value, float) - self.lo) / (self.hi - self.lo)
        safe = np.maximum(np.asarray(value, float), 1e-300)
        return np.log10(safe / self.lo) / log10(self.hi / self.lo)

    def marks(self, room_px: float) -> list[tuple[float, str]]:
        """Ticks with their texts, as many as fit."""
        if self.ticks is not None:
            return list(self.ticks)
        return _log_marks(self, room_px) if self.log else _round_marks(self.lo, self.hi, max(2, int(room_px / 62)))


def log_axis(values: ArrayLike, label: str = "", margin: float = 1.4) -> Axis:
    """A log axis around positive values, whose ends are 1, 2 or 5 times a power of ten."""
    numbers = np.asarray(values, float)
    numbers = numbers[np.isfinite(numbers) & (numbers > 0)]
    lo, hi = (numbers.min() / margin, numbers.max() * margin) if len(numbers) else (0.1, 10.0)
    return Axis(_round_down(lo), 1 / _round_down(1 / hi), label, log=True)


def linear_axis(values: ArrayLike, label: str = "", zero: bool = False) -> Axis:
    """A linear axis around values."""
    numbers = np.asarray(values, float)
    numbers = numbers[np.isfinite(numbers)]
    lo, hi = (float(numbers.min()), float(numbers.max())) if len(numbers) else (0.0, 1.0)
    if zero:
        lo, hi = min(lo, 0.0), max(hi, 0.0)
    room = 0.06 * (hi - lo) or max(abs(hi), 1e-12) * 0.1
    return Axis(lo if zero and lo == 0 else lo - room, hi if zero and hi == 0 else hi + room, label)


class Chart:
    """Chart with two axes; its content is clipped to the frame."""

    def __init__(self, width: int, height: int, x: Axis, y: Axis, about: str, left: int = 58, right: int = 14):
        self.width, self.height, self.x, self.y, self._about = width, height, x, y, about
        self.left, self.top = left, 12 + (16 if y.label else 0)
        self.inner_width, self.inner_height = width - left - right, height - self.top - (42 if x.label else 26)
        self._parts: list[str] = []
        self._frame()

    def at(self, x: ArrayLike, y: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Pixel coordinates of data, clipped slightly outside the frame."""
        across, up = np.clip(self.x.place(x), -0.01, 1.01), np.clip(self.y.place(y), -0.01, 1.01)
        return self.left + across * self.inner_width, self.top + (1 - up) * self.inner_height

    def line(self, x: ArrayLike, y: ArrayLike, kind: str, style: str = "line") -> Chart:
        """Draw a line with gaps where y is not finite; style: line, thin, dash."""
        x, y = _thinned(np.asarray(x, float), np.asarray(y, float), self.inner_width * POINTS_PER_PIXEL)
        px, py = self.at(x, np.where(np.isfinite(y), y, self.y.lo))
        path, pen = [], "M"
        for a, b, fine in zip(px, py, np.isfinite(y), strict=True):
            if fine:
                path.append(f"{pen}{_px(a)} {_px(b)}")
            pen = "L" if fine else "M"
        if path:
            self._parts.append(f'<path class="{style} k-{kind}" d="{"".join(path)}"/>')
        return self

    def area(self, x: ArrayLike, lo: ArrayLike, hi: ArrayLike, kind: str) -> Chart:
        """Fill the area between two lines."""
        px, top = self.at(x, hi)
        _, bottom = self.at(x, lo)
        points = [*zip(px, top, strict=True), *zip(px[::-1], bottom[::-1], strict=True)]
        self._parts.append(f'<path class="area k-{kind}" d="M{"L".join(f"{_px(a)} {_px(b)}" for a, b in points)}Z"/>')
        return self

    def dots(
        self, x: ArrayLike, y: ArrayLike, kind: str, titles: Sequence[str] | None = None, ring: bool = False, radius: float = 3.2
    ) -> Chart:
        """Draw points; titles, one per point, are shown on hover."""
        px, py = self.at(x, y)
        style = "ring" if ring else "dot"
        marks = []
        for i, (a, b) in enumerate(zip(np.atleast_1d(px), np.atleast_1d(py), strict=True)):
            if np.isfinite(a) and np.isfinite(b):
                title = f"<title>{escape(titles[i])}</title>" if titles is not None else ""
                marks.append(f'<circle cx="{_px(a)}" cy="{_px(b)}" r="{radius:g}">{title}</circle>')
        self._parts.append(f'<g class="{style} k-{kind}">{"".join(marks)}</g>')
        return self

    def bars(self, x: ArrayLike, lo: ArrayLike, hi: ArrayLike, kind: str) -> Chart:
        """Draw uncertainties as vertical bars from lo to hi at each x."""
        px, top = self.at(x, hi)
        _, bottom = self.at(x, lo)
        path = "".join(f"M{_px(a)} {_px(b)}V{_px(c)}" for a, b, c in zip(px, bottom, top, strict=True))
        self._parts.append(f'<path class="line k-{kind}" d="{path}"/>')
        return self

    def across(self, y: float, kind: str, text: str = "", style: str = "dash") -> Chart:
        """Draw a horizontal line, with its name above its right end."""
        _, (level,) = self.at([self.x.lo], [y])
        self._parts.append(f'<path class="{style} k-{kind}" d="M{self.left} {_px(level)}h{_px(self.inner_width)}"/>')
        if text:
            self.text(self.left + self.inner_width - 4, level - 5, text, "end", kind)
        return self

    def span(self, x0: float, x1: float, kind: str, title: str = "", y0: float = 0.0, y1: float = 1.0) -> Chart:
        """Draw a block between two times; y0 to y1 are fractions of the frame's height, from below."""
        (a, b), _ = self.at([x0, x1], [self.y.lo] * 2)
        top, height = self.top + (1 - y1) * self.inner_height, (y1 - y0) * self.inner_height
        inside = f"<title>{escape(title)}</title>" if title else ""
        self._parts.append(
            f'<rect class="block k-{kind}" x="{_px(a)}" y="{_px(top)}" width="{_px(max(b - a, 1))}" height="{_px(height)}">{inside}</rect>'
        )
        return self

    def upright(self, x: float, kind: str) -> Chart:
        """Draw a vertical line."""
        (a,), _ = self.at([x], [self.y.lo])
        self._parts.append(f'<path class="dash k-{kind}" d="M{_px(a)} {self.top}v{_px(self.inner_height)}"/>')
        return self

    def text(self, px: float, py: float, text: str, anchor: str = "start", kind: str = "") -> Chart:
        """Write text at a pixel."""
        colour = f" k-{kind}" if kind else ""
        self._parts.append(f'<text class="word{colour}" x="{_px(px)}" y="{_px(py)}" text-anchor="{anchor}">{escape(text)}</text>')
        return self

    def svg(self) -> str:
        """The drawing as SVG."""
        return drawing(self.width, self.height, self._about, "".join(self._parts))

    def _frame(self) -> None:
        bottom, right = self.top + self.inner_height, self.left + self.inner_width
        last = -1e9
        for value, text in self.x.marks(self.inner_width):
            (a,), _ = self.at([value], [self.y.lo])
            if a - last < 7 * len(text) + 8:
                continue
            last = a
            self._parts.append(f'<path class="grid" d="M{_px(a)} {self.top}V{_px(bottom)}"/>')
            self._parts.append(f'<text class="tick" x="{_px(a)}" y="{_px(bottom + 16)}" text-anchor="middle">{_tick(text)}</text>')
        for value, text in self.y.marks(self.inner_height * 1.4):
            _, (b,) = self.at([self.x.lo], [value])
            self._parts.append(f'<path class="grid" d="M{self.left} {_px(b)}H{_px(right)}"/>')
            self._parts.append(f'<text class="tick" x="{self.left - 8}" y="{_px(b + 4)}" text-anchor="end">{_tick(text)}</text>')
        self._parts.append(f'<path class="axis" d="M{self.left} {_px(bottom)}H{_px(right)}"/>')
        if self.x.label:
            middle = self.left + self.inner_width / 2
            self._parts.append(
                f'<text class="label" x="{_px(middle)}" y="{self.height - 6}" text-anchor="middle">{escape(self.x.label)}</text>'
            )
        if self.y.label:
            self._parts.append(f'<text class="label" x="2" y="12">{escape(self.y.label)}</text>')


def drawing(width: float, height: float, about: str, inside: str) -> str:
    """An SVG element with its description."""
    return (
        f'<svg viewBox="0 0 {width:g} {height:g}" width="{width:g}" height="{height:g}" role="img" aria-label="{escape(about)}">'
        f"<title>{escape(about)}</title>{inside}</svg>"
    )


def _tick(text: str) -> str:
    """Escape a label; the thin space between thousands is kept."""
    return "\u202f".join(map(escape, text.split("\u202f")))


def _px(value: float) -> str:
    return f"{value:.1f}".removesuffix(".0")


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


def _round_down(value: float) -> float:
    power = 10.0 ** floor(log10(value) + 1e-12)
    return max(step for step in (1, 2, 5) if step * power <= value * (1 + 1e-9)) * power


def _round_marks(lo: float, hi: float, most: int) -> list[tuple[float, str]]:
    power = 10.0 ** floor(log10((hi - lo) / most / 2))
    steps = (m * power for m in (1, 2, 5, 10, 20, 50, 100))
    step = next(step for step in steps if floor(hi / step + 1e-9) - ceil(lo / step - 1e-9) <= most)
    decimals = max(0, -floor(log10(step) + 1e-9))
    return [(k * step, fixed(k * step, decimals)) for k in range(ceil(lo / step - 1e-9), floor(hi / step + 1e-9) + 1)]


def _log_marks(axis: Axis, room_px: float) -> list[tuple[float, str]]:
    lowest, highest = floor(log10(axis.lo) + 1e-9), ceil(log10(axis.hi) - 1e-9)
    decades = log10(axis.hi / axis.lo)
    steps = (1, 2, 5) if decades * 3 < room_px / 34 else (1,)
    skip = max(1, ceil(decades * 30 / room_px)) if steps == (1,) else 1
    values = [step * 10.0**power for power in range(lowest, highest + 1, skip) for step in steps]
    return [(v, _short(v)) for v in values if axis.lo * (1 - 1e-9) <= v <= axis.hi * (1 + 1e-9)]


def _short(value: float) -> str:
    return fixed(value, max(0, -floor(log10(value) + 1e-9)))


# Directions on a sphere, as two discs in Lambert's equal-area projection: the half with z towards the viewer, and the other.

#: angular radius around a direction that counts as covered
REACH_RAD = np.pi / 6
_EVEN = 4000


def coverage(directions: np.ndarray) -> float:
    """Share of the sphere that lies within 30 degrees of one of the directions (N, 3)."""
    if not len(directions):
        return 0.0
    k = np.arange(_EVEN) + 0.5
    z, turn = 1 - 2 * k / _EVEN, np.pi * (1 + np.sqrt(5)) * k
    even = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)
    unit = unit_vectors(directions)
    return float(np.mean((even @ unit.T).max(axis=1) >= np.cos(REACH_RAD)))


def hemispheres(
    left: float,
    top: float,
    radius: float,
    directions: np.ndarray,
    kind: str,
    titles: list[str],
    names: tuple[str, str],
    faint: np.ndarray | None = None,
) -> str:
    """Draw two discs side by side, the first at (left, top); faint (M, 3): smaller points behind; names of the two halves."""
    gap = 2 * radius + 30
    parts = []
    for number, (sign, name) in enumerate(zip((1, -1), names, strict=True)):
        cx, cy = left + radius + number * gap, top + radius
        rings = "".join(
            f'<circle cx="{cx:.1f}" cy="{cy:.1f}" r="{radius * np.sqrt(2) * np.sin(angle / 2):.1f}" class="grid"/>'
            for angle in np.radians((30, 60))
        )
        cross = f'<path class="grid" d="M{cx - radius:.1f} {cy:.1f}h{2 * radius:.1f}M{cx:.1f} {cy - radius:.1f}v{2 * radius:.1f}"/>'
        rim = f'<circle cx="{cx:.1f}" cy="{cy:.1f}" r="{radius:.1f}" class="axis"/>'
        words = (
            f'<text x="{cx + radius + 4:.1f}" y="{cy + 4:.1f}">x</text><text x="{cx:.1f}" y="{cy - radius - 5:.1f}" '
            'text-anchor="middle">y</text>'
            f'<text x="{cx:.1f}" y="{cy + radius + 17:.1f}" text-anchor="middle">{escape(name)}</text>'
        )
        parts.append(rings + cross + rim + words)
        if faint is not None:
            parts.append(_points(faint, sign, cx, cy, radius, f"faint k-{kind}", 1.3))
        parts.append(_points(directions, sign, cx, cy, radius, f"dot k-{kind}", 3.4, titles))
    return "".join(parts)


def _points(
    directions: np.ndarray, sign: int, cx: float, cy: float, radius: float, style: str, size: float, titles: list[str] | None = None
) -> str:
    marks = []
    for i, (x, y, z) in enumerate(directions / np.maximum(np.linalg.norm(directions, axis=1, keepdims=True), 1e-300)):
        if sign * z < 0 or not np.isfinite(z):
            continue
        stretch = radius / np.sqrt(1 + abs(z))
        title = f"<title>{escape(titles[i])}</title>" if titles else ""
        marks.append(f'<circle cx="{cx + stretch * x:.1f}" cy="{cy - stretch * y:.1f}" r="{size:g}">{title}</circle>')
    return f'<g class="{style}">{"".join(marks)}</g>'


# The sensor's axes and the reference axes, with errors enlarged until they are visible.

#: the largest error is drawn at about this angle
SHOWN_RAD = 0.22
#: drawing directions across and up for a viewer to the right, in front and above; body axes are forward-right-down, so z points down
_ACROSS, _UP = np.array([-0.62, 0.78, 0.0]), np.array([-0.36, -0.30, -0.88])


def enlargement(M: np.ndarray) -> float:
    """Round factor by which errors are enlarged."""
    u = unit_vectors(M)
    largest = max(float(np.abs(u - np.eye(3)).max()), float(np.abs(np.linalg.norm(M, axis=1) - 1).max()), 1e-6)
    wanted = SHOWN_RAD / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in (1, 2, 5) if step * power <= wanted * (1 + 1e-9)))


def triad(M: np.ndarray, side: int) -> str:
    """Draw the response rows of M (3, 3) as arrows, and the reference axes behind them."""
    factor = enlargement(M)
    shown = np.eye(3) + factor * (M - np.eye(3))
    height = round(side * 0.78)
    origin, size = np.array([side * 0.46, side * 0.07]), side * 0.58
    parts = []
    for axis, row, reference in zip("xyz", shown, np.eye(3), strict=True):
        tip, base = (origin + size * np.array([v @ _ACROSS, -(v @ _UP)]) for v in (row, reference))
        parts.append(f'<path class="dash k-quiet" d="M{_at(origin)}L{_at(base)}"/>')
        parts.append(f'<path class="line k-{axis}" style="stroke-width:2.4" d="M{_at(origin)}L{_at(tip)}"/>{_head(origin, tip, axis)}')
        end = tip + 14 * (tip - origin) / np.linalg.norm(tip - origin)
        parts.append(
            f'<text class="word k-{axis}" style="font-weight:640" x="{end[0]:.1f}" y="{end[1] + 4:.1f}" text-anchor="middle">{axis}</text>'
        )
    return drawing(side, height, f"Input axes and scale factors of the sensor, errors enlarged {factor:g} times", "".join(parts))


def _at(point: np.ndarray) -> str:
    return f"{point[0]:.1f} {point[1]:.1f}"


def _head(origin: np.ndarray, tip: np.ndarray, axis: str) -> str:
    along = (tip - origin) / np.linalg.norm(tip - origin)
    aside = np.array([-along[1], along[0]])
    back = tip - 9 * along
    return f'<path class="solid k-{axis}" d="M{_at(tip + 2 * along)}L{_at(back + 4 * aside)}L{_at(back - 4 * aside)}Z"/>'
