"""The temperature of a rest log: its sweeps, and what it was between the steps of its thermometer."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from session.base.numeric import sigma_of_steps
from session.log.thermometer import Grid

# Rising and falling half cycles of the temperature, the units of cross-validation.

#: of the whole range: a smaller reversal of the temperature ends no sweep
TURN_SHARE = 0.25
#: degC: a log whose temperature varies by less has no sweep
LEAST_C = 2.0
#: blocks of the running median
SMOOTH = 9


@dataclass(frozen=True)
class Sweep:
    """Blocks start <= i < stop of one log; direction +1 (up) or -1 (down)."""

    log: int
    start: int
    stop: int
    direction: int


def sweeps_of(temp_c: np.ndarray, log: int = 0) -> list[Sweep]:
    """Return the half cycles of one log's temperatures (B,) degC, in the order of time; none where they hardly vary."""
    if len(temp_c) < 2 or not np.isfinite(temp_c).all():
        return []
    from scipy.ndimage import median_filter

    smooth = median_filter(temp_c, size=min(SMOOTH, len(temp_c)), mode="nearest")
    extent = float(np.ptp(smooth))
    if extent < LEAST_C:
        return []
    turns = _turning_points(smooth, TURN_SHARE * extent)
    edges = [0, *turns[1:-1], len(temp_c)]
    directions = np.sign(np.diff(smooth[turns])).astype(int)
    return [Sweep(log, start, stop, int(d)) for start, stop, d in zip(edges[:-1], edges[1:], directions, strict=True)]


def _turning_points(values: np.ndarray, least: float) -> list[int]:
    """Return the indices of the first extreme, of each reversal by at least ``least``, and of the last."""
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


# The temperature between the steps of a thermometer, and how uncertain it is there.
#
# A reading in steps of q shows a slow temperature well in the moments in which it passes the middle between two steps, and to q else.  Read
# as it stands it is off by a saw tooth, which a fit takes for noise of the zero and for its walk.  So it is interpolated between those
# moments.  What is left is an error of the regressor, of Berkson's kind, because the temperature scatters about the reading and not the
# reading about the temperature: it bends no slope.  It adds its variance times the slope's square to the zero's.

#: of the step: a reversal by less is a reading that goes to and fro between two steps
REVERSAL = 1.5
#: rms of a uniform error, of its width
UNIFORM = 12**-0.5
#: rms of a parabola about its chord, of the change of its rate at either end times the interval: sqrt(8 / 15) / 8, halved
BENT = 0.046


#: of the step: the scatter of block means, white, from which on it carries them across the steps, so that they are right as they are
DITHERED = 0.12


class BetweenSteps(NamedTuple):
    """Interpolated block means temp_c (B,) degC, their sigmas sigma_c (B,) degC, and interval (B,): its number between two passages, within
    which errors are alike."""

    temp_c: np.ndarray
    sigma_c: np.ndarray
    interval: np.ndarray


def between_steps(t: np.ndarray, temp_c: np.ndarray, grid: Grid) -> BetweenSteps:
    """Interpolate block means (B,) degC, of readings on a grid, at times t (B,), rising, of any unit."""
    step, on = grid
    if not step or len(t) < 2 or sigma_of_steps(temp_c) > DITHERED * step:
        return BetweenSteps(temp_c, np.zeros(len(t)), np.zeros(len(t), dtype=int))
    reading = (temp_c - on) / step
    at, level = _passages(t, reading)
    interval = np.searchsorted(at, t)
    sigma = np.full(len(at) + 1, UNIFORM)
    if not len(at):
        return BetweenSteps(temp_c, step * sigma[interval], interval)
    mean = np.bincount(interval, reading) / np.bincount(interval)
    # Rate of each interval, and level of the passage that it lies next to; neither end has a rate of its own.
    rate = np.concatenate([[np.nan], np.diff(level) / np.diff(at), [np.nan]])
    edges, levels = np.concatenate([t[:1], at, t[-1:]]), np.append(level, level[-1])
    nodes, values = [*at], [*level]
    for i, (began, ended) in enumerate(pairwise(edges.tolist())):
        near = np.array([r for r in rate[max(i - 1, 0) : i + 2 : 2 if i else 1] if np.isfinite(r)])
        if rate[i] and np.isfinite(rate[i]):
            sigma[i] = min(UNIFORM, BENT * np.abs(near - rate[i]).sum() * (ended - began))
            continue
        # At either end, and where it turns, it goes on as next to it: at an end that far, in a turn half of a parabola's way, and no
        # further than the readings let it.
        is_end = i in (0, len(at))
        way = np.abs(near[near != 0]).mean() * (ended - began) if near.any() else np.inf
        reach, most = (way, 1.0) if is_end else (way / 4, 0.5)
        sigma[i] = UNIFORM * min(reach, 1.0)
        nodes.append((began if i == 0 else ended) if is_end else (began + ended) / 2)
        values.append(levels[i] + np.sign(mean[i] - levels[i]) * (reach if reach < most else 0.5))
    from scipy.interpolate import PchipInterpolator

    order = np.argsort(nodes)
    found = PchipInterpolator(np.array(nodes)[order], np.array(values)[order])(t)
    return BetweenSteps(on + step * found, step * sigma[interval], interval)


def _passages(t: np.ndarray, reading: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times (P,), rising, at which readings (B,) in steps pass the middle between two, and the middles.  On the way between two turns the
    readings rise but for noise: where one goes to and fro, the passage is where both are as frequent."""
    from scipy.optimize import isotonic_regression

    turns = _turning_points(reading, REVERSAL)
    edges = [0, *turns[1:-1], len(reading) - 1]
    at, level = [], []
    for start, stop in pairwise(edges):
        way = 1.0 if reading[stop] >= reading[start] else -1.0
        rising = isotonic_regression(way * reading[start : stop + 1]).x
        middles = np.arange(np.floor(rising[0] + 0.5), np.floor(rising[-1] + 0.5)) + 0.5
        first = start + np.searchsorted(rising, middles)
        at.append((t[first - 1] + t[first]) / 2)
        level.append(way * middles)
    times, where = np.unique(np.concatenate(at), return_inverse=True)
    levels = np.concatenate(level)
    return times, np.bincount(where, levels, len(times)) / np.bincount(where, minlength=len(times))
