"""Where the temperature goes up, and where it comes down: half cycles, by which a model of it is examined."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import median_filter

#: of the whole range: a turn of the temperature that is smaller ends no sweep
TURN_SHARE = 0.25
#: degC: a log whose temperature moves by less has no sweep
LEAST_C = 2.0
#: blocks whose median is compared
SMOOTH = 9


@dataclass(frozen=True)
class Sweep:
    """Blocks start <= i < stop of one log; direction +1 (up) or -1 (down)."""

    log: int
    start: int
    stop: int
    direction: int


def sweeps_of(temp_c: np.ndarray, log: int = 0) -> list[Sweep]:
    """The half cycles of one log's temperatures (B,) degC, in the order of time; none where they hardly move."""
    if len(temp_c) < 2 or not np.isfinite(temp_c).all():
        return []
    smooth = median_filter(temp_c, size=min(SMOOTH, len(temp_c)), mode="nearest")
    extent = float(np.ptp(smooth))
    if extent < LEAST_C:
        return []
    turns = _turning_points(smooth, TURN_SHARE * extent)
    edges = [0, *turns[1:-1], len(temp_c)]
    directions = np.sign(np.diff(smooth[turns])).astype(int)
    return [Sweep(log, start, stop, int(d)) for start, stop, d in zip(edges[:-1], edges[1:], directions, strict=True)]


def _turning_points(values: np.ndarray, least: float) -> list[int]:
    """Indices of the first extreme, of each that turns by at least so much, and of the last."""
    low = high = direction = 0
    points: list[int] = []
    for i, value in enumerate(values.tolist()):
        high = i if direction >= 0 and value > values[high] else high
        low = i if direction <= 0 and value < values[low] else low
        if direction <= 0 and value - values[low] >= least:
            points.append(low)
            direction, high = 1, i
        elif direction >= 0 and values[high] - value >= least:
            points.append(high)
            direction, low = -1, i
    points.append(high if direction > 0 else low)
    return points if len(points) > 1 else [0, len(values) - 1]
