"""How a board lies that somebody has set straight: on one of its six sides, or on an edge between two of them.

A hand knows the vertical and the board's own axes where they are level or upright; it knows nothing in between.
"""

from __future__ import annotations

from itertools import product

import numpy as np

SIDES = np.array([sign * axis for axis in np.eye(3) for sign in (1.0, -1.0)])
EDGES = np.array([(a + b) / np.sqrt(2) for a, b in product(SIDES, SIDES) if np.argmax(np.abs(a)) < np.argmax(np.abs(b))])


def nearest_up(accel: np.ndarray, with_edges: bool = False) -> np.ndarray:
    """(3,) unit: what of the board points up where its accelerometer reads accel (3,), had somebody set it straight."""
    among = np.concatenate([SIDES, EDGES]) if with_edges else SIDES
    return among[int(np.argmax(among @ accel))]


def up_words(up: np.ndarray) -> str:
    """``-x``; on an edge ``x and -z``."""
    return " and ".join(f"{'-' if part < 0 else ''}{name}" for name, part in zip("xyz", up, strict=True) if abs(part) > 0.1)


def on_a_side(up: np.ndarray) -> bool:
    """Whether it lies on a side, and not on an edge."""
    return bool(np.abs(up).max() > 0.9)


def straight(up: np.ndarray) -> np.ndarray:
    """(3,) what of a board that was turned by quarters or eighths points up, without rounding errors."""
    return nearest_up(up, with_edges=True)
