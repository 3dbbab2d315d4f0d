"""A rate that is clipped before the registers: noise, misalignment and a filter lie on its plateaus, so that no register value repeats.

A hand's strokes have peaks of every height, each round; clipped ones are flat, end in corners, and are all of one height, which no
stroke passes.  A motor makes such strokes, too: only segments that do not close tell (``mending``).
"""

from __future__ import annotations

import numpy as np

from session.common.robust import sigma_of_steps
from session.common.runs import runs_of
from session.log.readings import pieces
from session.log.samples import Samples
from tinygc.explanation.mends.ceilings import ReachedCeiling

#: a plateau stays within this share of its level (the linear errors that came after it: a data sheet's 1 % and a little), or so many times
#: the readings' noise (once in 10^9)
FLAT, NOISES = 0.012, 6.0
#: as far beyond its ends as it is long, a round peak has fallen by 9 times what it stays within; a plateau's stroke by more than this
CORNER = 18.0
#: strokes of one height, within this share (twice those linear errors), and the least a plateau lasts
#: (not critical: benchmarks/thresholds.py)
FEWEST, SAME, SHORTEST_S = 3, 0.02, 0.05
#: what is clipped is a turn: share of full scale, 25 dps of 500
LEAST = 0.05
#: shares: of a plateau's readings that are flat; of the plateaus that are of one height (not critical: benchmarks/thresholds.py)
WHOLE, ALIKE = 0.9, 0.6


def find_plateaus(samples: Samples, full_scale_rps: float) -> ReachedCeiling | None:
    """The level of rates that were clipped before they were misaligned, filtered or made noisy; the same for all axes."""
    levels, masks, peak = [], [], 0.0
    for axis in range(3):
        readings = samples.gyro[:, axis]
        noise, peak = float(sigma_of_steps(readings)), max(peak, readings.max(), -readings.min())
        for sign in (1.0, -1.0):
            found = _plateaus(sign * readings, noise, LEAST * full_scale_rps, SHORTEST_S / samples.period_s)
            levels += [level for level, _, _ in found]
            masks += [(level, start, stop) for level, start, stop in found]
    if len(levels) < FEWEST:
        return None
    level = float(np.median(levels))
    alike = [(start, stop) for each, start, stop in masks if abs(each - level) < SAME * level]
    passed = peak > (1 + 2 * SAME) * level
    if len(alike) < max(FEWEST, ALIKE * len(levels)) or passed:
        return None
    mask = np.zeros(len(samples), dtype=bool)
    for start, stop in alike:
        mask[start:stop] = True
    for start, part in pieces(samples.gyro):
        mask[start : start + len(part)] |= (np.abs(part) > (1 - SAME) * level).any(axis=1)
    return ReachedCeiling(level, mask)


def _plateaus(values: np.ndarray, noise: float, least: float, shortest: float) -> list[tuple[float, int, int]]:
    """(level, start, stop) of the flat top of each stroke that has one."""
    found = []
    high = values > max(least, 0.5 * values.max())
    for begin, end in zip(*(edges.tolist() for edges in runs_of(high)), strict=True):
        stroke = values[begin:end]
        top = float(np.quantile(stroke, 0.9, method="lower"))  # one of its readings
        within = max(FLAT * top, NOISES * noise)
        flat = np.flatnonzero(np.abs(stroke - top) <= within)
        start, stop = begin + int(flat[0]), begin + int(flat[-1]) + 1
        length = stop - start
        if length < shortest or len(flat) < WHOLE * length:
            continue
        beyond = values[[max(start - length, 0), min(stop + length, len(values)) - 1]]
        if top - beyond.max() > CORNER * within:
            found.append((top, start, stop))
    return found
