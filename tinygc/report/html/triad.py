"""The sensor's own axes beside the reference's, their errors enlarged until they can be seen."""

from __future__ import annotations

import numpy as np

from tinygc.report.html.chart import drawing

#: an error is drawn so large that the largest leans by about this
SHOWN_RAD = 0.22
#: directions of the drawing: across and up, of a viewer to the right, in front and above; z is forward-right-down's, so it points down
_ACROSS, _UP = np.array([-0.62, 0.78, 0.0]), np.array([-0.36, -0.30, -0.88])


def enlargement(M: np.ndarray) -> float:
    """A round factor."""
    u = M / np.linalg.norm(M, axis=1, keepdims=True)
    largest = max(float(np.abs(u - np.eye(3)).max()), float(np.abs(np.linalg.norm(M, axis=1) - 1).max()), 1e-6)
    wanted = SHOWN_RAD / largest
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(max(step * power for step in (1, 2, 5) if step * power <= wanted * (1 + 1e-9)))


def triad(M: np.ndarray, side: int) -> str:
    """The response rows of M (3, 3) as arrows, and the reference axes behind them."""
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
