"""The registers themselves: samples that were lost while the stamps closed up, levels that are not left.

A hand moves smoothly, and the sensor's filter smooths it further: the third difference of the readings holds noise and little else.
A jump stands out there by its own size.  A loss jumps once, for good, in gyro and accelerometer together (a false reading jumps away
and back: ``false_readings``).  What is found can be repaired, so that the rest of the recording is still worth explaining.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.ndimage import maximum_filter1d

from session.common.robust import sigma_of
from session.common.units import NS_PER_S
from session.detect import interpolation
from session.detect.pace import pace_of
from session.log.samples import Samples
from tinygc.explanation.mends.parts import in_parts

#: third differences this many times their neighbourhood's own scatter (all six channels together) are a jump
#: (benchmarks/thresholds.py: half of it gives false names)
JUMP = 12.0
#: the two peaks of a short false reading are alike, and each has at least a third of itself, reversed, beyond it; a step's second peak is
#: half of its first, and a corner has nothing beyond: the bars are between
SPIKE, FLANK = 0.75, 0.2
#: s: where that scatter is taken (not critical: benchmarks/thresholds.py), and what a sensor's filter takes to start
NEIGHBOURHOOD_S, START_S = 0.2, 0.1
NEIGHBOURHOOD = 32  #: samples of it at least: the third differences of the longest false reading, eleven, are not half of them
ALONE = 8  #: samples on either side of a loss without another, or without a greater jump: as long as the longest false reading
#: a loss shows in the accelerometer, too: most of them by at least this (noise alone: 0.9); where a rate clips it does not
LOSS_IN_ACCEL = 3.0
#: losses and false readings are rare: more than one a second is another thing
PER_SECOND = 1.0


@dataclass(frozen=True, eq=False)
class Jumps:
    """Steps between rows[i] and rows[i] + 1; size (J, 6) of each in every channel, signed, in the neighbourhood's own scatter."""

    rows: np.ndarray
    size: np.ndarray


def find_jumps(samples: Samples) -> Jumps:
    """All steps that a smooth movement does not make, within a period's time."""
    rows, sizes = [np.zeros(0, dtype=int)], [np.zeros((0, 6))]
    for first, own, part in in_parts(samples):
        found = _jumps_of(part)
        mine = np.isin(found.rows + first, own) if len(part) < len(samples) else np.ones(len(found.rows), dtype=bool)
        rows.append(found.rows[mine] + first)
        sizes.append(found.size[mine])
    return Jumps(np.concatenate(rows), np.concatenate(sizes))


def _jumps_of(samples: Samples) -> Jumps:
    size, _ = third_differences(samples)
    total = np.sqrt(np.sum(size**2, axis=1))
    high = np.flatnonzero(total > JUMP)
    # A step between rows k and k+1 is in the third differences k-2, k-1, k as 1, -2, 1.
    peaks = [i for i in high if total[i] >= total[max(i - 2, 0) : i + 3].max()]
    steps = dict(step for i in peaks for step in _steps_at(int(i), size, total))
    missing = open_gaps(samples)
    rows = [row for row in sorted(steps) if not missing[row]]
    return Jumps(np.array(rows, dtype=int), np.array([steps[row] for row in rows]).reshape(-1, 6))


def open_gaps(samples: Samples) -> np.ndarray:
    """(N - 1,) bool: whether the stamps say that samples are missing between a row and the next: nothing is lost unseen there."""
    return pace_of(samples.t_ns).periods(samples.dt_s) > 1


def third_differences(samples: Samples) -> tuple[np.ndarray, np.ndarray]:
    """Third differences (N - 3, 6) of gyro and accelerometer in their neighbourhood's own scatter, and that scatter (N - 3, 6)."""
    third = np.diff(np.concatenate([samples.gyro, samples.accel], axis=1), 3, axis=0)
    scatter = _neighbourhood(np.abs(third), samples.period_s)
    size = third / scatter
    size[: round(START_S / samples.period_s)] = 0
    return size, scatter


def _steps_at(i: int, size: np.ndarray, total: np.ndarray) -> list[tuple[int, np.ndarray]]:
    """Row and size of each step in a peak: one, unless it looks like one false sample, 1, -3, 3, -1, or two of them, 1, -2, 0, 2, -1.

    A corner of the rate, 0, -1, 1, 0, has no flanks.
    """
    for apart, factor in ((1, 3), (2, 2)):
        for away, back in ((i, i + apart), (i - apart, i)):
            if away < 1 or back + 2 > len(size) or min(total[away], total[back]) < SPIKE * total[i]:
                continue
            flanks = max(size[away - 1] @ size[away] / total[away] ** 2, size[back + 1] @ size[back] / total[back] ** 2)
            if size[away] @ size[back] < 0 and flanks < -FLANK:
                return [(away + 1, -size[away] / factor), (back + 1, -size[back] / factor)]
    return [(i + 1, -size[i] / 2)]


def _neighbourhood(absolute: np.ndarray, period_s: float) -> np.ndarray:
    """Scatter around each row, from medians: a jump does not hide itself, and a turn's beginning is not one."""
    step = max(round(NEIGHBOURHOOD_S / period_s), NEIGHBOURHOOD)
    count = len(absolute) // step
    if count < 5:
        return np.broadcast_to(np.maximum(sigma_of(absolute), 1e-12), absolute.shape)
    coarse = sigma_of(absolute[: count * step].reshape(count, step, -1), axis=1)
    coarse = np.maximum(maximum_filter1d(coarse, 3, axis=0), np.median(coarse, axis=0))
    return np.maximum(coarse, 1e-12)[np.minimum(np.arange(len(absolute)) // step, count - 1)]


def find_losses(jumps: Jumps, duration_s: float) -> np.ndarray:
    """Rows (L,) after which samples are missing, by the registers alone: steps that stay, in gyro and accelerometer alike."""
    alone = np.array([np.sum(np.abs(jumps.rows - row) <= ALONE) == 1 for row in jumps.rows], dtype=bool)
    rows, accel = jumps.rows[alone], np.linalg.norm(jumps.size[alone, 3:], axis=1)
    if not len(rows) or np.median(accel) < LOSS_IN_ACCEL or len(rows) > PER_SECOND * duration_s:
        return rows[:0]
    return rows


def possible_losses(jumps: Jumps, duration_s: float) -> np.ndarray:
    """Rows (L,) after which samples may be missing, where closure decides (``trial``): the greatest steps around that stay."""
    if not len(jumps.rows):
        return jumps.rows
    size = np.zeros(int(jumps.rows.max()) + 1)
    size[jumps.rows] = np.linalg.norm(jumps.size, axis=1)
    rows = jumps.rows[size[jumps.rows] >= maximum_filter1d(size, 2 * ALONE + 1)[jumps.rows]]
    return rows if len(rows) <= PER_SECOND * duration_s else rows[:0]


def lsb(values: np.ndarray) -> float:
    """The smallest step between readings (N,); 0 where there is none."""
    distinct = np.unique(np.abs(np.diff(values[:20000])))
    return float(distinct[distinct > 1e-9][0]) if (distinct > 1e-9).any() else 0.0


def with_lost(samples: Samples, rows: np.ndarray, count: int, orders: np.ndarray | int) -> Samples:
    """``count`` samples put back after each of the rows, by a polynomial through their neighbours, and the later stamps moved on.

    orders: of the polynomials, one for each row or for all.
    """
    orders = np.broadcast_to(orders, rows.shape)
    period_ns = round(samples.period_s * NS_PER_S)
    names = ["gyro", "accel"] + (["temp_c"] if samples.temp_c is not None else [])
    pieces: dict[str, list] = {name: [] for name in ["t_ns", *names]}
    bounds = [0, *(rows + 1), len(samples)]
    for i, (start, stop) in enumerate(pairwise(bounds)):
        moved = i * count * period_ns
        pieces["t_ns"].append(samples.t_ns[start:stop] + moved)
        for name in names:
            pieces[name].append(getattr(samples, name)[start:stop])
        if i < len(rows):
            pieces["t_ns"].append(samples.t_ns[stop - 1] + moved + period_ns * np.arange(1, count + 1))
            for name in names:
                values = getattr(samples, name)
                bridged = interpolation.across(values.reshape(len(samples), -1), stop - 1, stop, count, int(orders[i]))
                pieces[name].append(bridged.reshape(count, *values.shape[1:]))
    joined = {name: np.concatenate(parts) for name, parts in pieces.items()}
    return Samples(joined["t_ns"], joined["gyro"], joined["accel"], joined.get("temp_c"))
