"""Mean, scatter and slope of the readings of a still: all at once, or part by part where it lasted for hours."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from session.common.units import NS

#: rows that are looked at at once: more than an hour at 104 Hz
AT_ONCE = 1 << 19
#: samples ``start <= i < stop`` of a still, in order, one pair where nothing interrupts it
Spans = list[tuple[int, int]]


@dataclass(frozen=True, eq=False)
class Trend:
    """mean, std (of single samples) and slope a second, each (3,)."""

    mean: np.ndarray
    std: np.ndarray
    slope: np.ndarray


def trend_of(values: np.ndarray, t_ns: np.ndarray, spans: Spans) -> Trend:
    """Of readings (N, 3) of a log at stamps (N,) ns."""
    first = t_ns[spans[0][0]]
    if _count(spans) <= AT_ONCE:
        rows = rows_of(spans)
        t, own = (t_ns[rows] - first) * NS, values[rows]
        centred = t - t.mean()
        return Trend(own.mean(axis=0), own.std(axis=0, ddof=1), centred @ own / np.sum(centred**2))
    count, t_sum, total = _count(spans), 0.0, np.zeros(3)
    for part in _parts(spans):
        t_sum, total = t_sum + float(np.sum((t_ns[part] - first) * NS)), total + np.sum(values[part], axis=0)
    middle, mean = t_sum / count, total / count
    square, leverage, along = np.zeros(3), 0.0, np.zeros(3)
    for part in _parts(spans):
        centred, off = (t_ns[part] - first) * NS - middle, values[part] - mean
        square, leverage, along = square + np.sum(off**2, axis=0), leverage + float(centred @ centred), along + centred @ off
    return Trend(mean, np.sqrt(square / (count - 1)), along / leverage)


def mean_as_a_slope_weighs(values: np.ndarray, spans: Spans) -> np.ndarray:
    """(3,) of readings (N, 3), each weighted as a fitted slope weighs a rate at its time: by ``(T/2)^2 - (t - T/2)^2``."""
    first, last = spans[0][0], spans[-1][1] - 1

    def weights(rows: np.ndarray) -> np.ndarray:
        part = (rows - first + 0.5) / (last - first + 1)
        return part * (1 - part)

    if _count(spans) <= AT_ONCE:
        return np.average(values[rows_of(spans)], axis=0, weights=weights(np.concatenate([np.arange(*span) for span in spans])))
    size, total = 0.0, np.zeros(3)
    for part in _parts(spans):
        weight = weights(np.arange(part.start, part.stop))
        size, total = size + float(weight.sum()), total + weight @ values[part]
    return total / size


def rows_of(spans: Spans) -> slice | np.ndarray:
    """A slice where nothing interrupts a still: no index has to be held."""
    return slice(*spans[0]) if len(spans) == 1 else np.concatenate([np.arange(*span) for span in spans])


def _count(spans: Spans) -> int:
    return sum(stop - start for start, stop in spans)


def _parts(spans: Spans) -> Iterator[slice]:
    return (slice(at, min(at + AT_ONCE, stop)) for start, stop in spans for at in range(start, stop, AT_ONCE))
