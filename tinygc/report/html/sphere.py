"""Directions on a sphere, as two discs in Lambert's equal-area projection: the half with z towards us, and the other."""

from __future__ import annotations

import numpy as np

from tinygc.report.html.markup import escape

#: how far one direction's neighbourhood reaches when coverage is counted
REACH_RAD = np.pi / 6
_EVEN = 4000


def coverage(directions: np.ndarray) -> float:
    """Share of the sphere that lies within 30 degrees of one of the directions (N, 3)."""
    if not len(directions):
        return 0.0
    k = np.arange(_EVEN) + 0.5
    z, turn = 1 - 2 * k / _EVEN, np.pi * (1 + np.sqrt(5)) * k
    even = np.stack([np.sqrt(1 - z**2) * np.cos(turn), np.sqrt(1 - z**2) * np.sin(turn), z], axis=1)
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
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
    """Two discs beside each other, their first at (left, top); faint (M, 3): smaller points behind; names of the two halves."""
    gap = 2 * radius + 30
    parts = []
    for number, (sign, name) in enumerate(zip((1, -1), names, strict=True)):
        cx, cy = left + radius + number * gap, top + radius
        parts.append(_disc(cx, cy, radius, name))
        if faint is not None:
            parts.append(_points(faint, sign, cx, cy, radius, f"faint k-{kind}", 1.3))
        parts.append(_points(directions, sign, cx, cy, radius, f"dot k-{kind}", 3.4, titles))
    return "".join(parts)


def _disc(cx: float, cy: float, radius: float, name: str) -> str:
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
    return rings + cross + rim + words


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
