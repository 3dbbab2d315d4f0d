"""Rates that stand at a level below what the register can hold: the sensor clips early."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.robust import sigma_of_steps
from session.common.runs import runs_of
from session.detect.clipping import run_bar
from session.log.samples import Samples
from tinygc.explanation.mends.lost_samples import lsb

#: a plateau ends in corners: as far beyond its ends as it is long, a smooth peak has fallen by 9 times what it stays within (2 steps)
CORNER = 3 * 9 * 2
#: share of full scale, below which no ceiling is looked for: 25 dps of 500, slower than a turn
LEAST_CEILING = 0.05


@dataclass(frozen=True, eq=False)
class ReachedCeiling:
    """A level that a rate does not leave: rad/s, and the mask (N,) of the samples at it."""

    level: float
    mask: np.ndarray


def find_ceiling(samples: Samples, full_scale_rps: float) -> ReachedCeiling | None:
    """A rate below the register's end that an axis reaches again and again, and never passes."""
    found = []
    for axis in range(3):
        readings = samples.gyro[:, axis]
        step = lsb(readings)
        for sign in (1, -1):
            values = sign * readings
            top = values.max()
            if top > LEAST_CEILING * full_scale_rps:
                at = values >= top - step
                bar = run_bar(float(sigma_of_steps(readings)), 2 * step)
                start, stop = _longest_run(at)
                if stop - start >= bar:
                    found.append((top, at, _has_corners(values, start, stop, step)))
    if not any(corners for _, _, corners in found):
        return None
    level = float(np.median([top for top, _, _ in found]))
    return ReachedCeiling(level, np.any([at for _, at, _ in found], axis=0))


def _longest_run(mask: np.ndarray) -> tuple[int, int]:
    """Start and stop of it."""
    starts, stops = runs_of(mask)
    longest = int(np.argmax(stops - starts))
    return int(starts[longest]), int(stops[longest])


def _has_corners(values: np.ndarray, start: int, stop: int, lsb: float) -> bool:
    beyond = values[[max(start - (stop - start), 0), min(stop + (stop - start), len(values)) - 1]]
    return bool(values[start] - beyond.max() > CORNER * lsb)
