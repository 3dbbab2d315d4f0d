"""A gyro that stops at a level far below its full scale: looked for before its scale and its stills are judged, which it spoils."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from session.checks.findings import Finding, axes_text
from session.common.units import DEG
from session.detect.clipping import LEAST_RUN, plateau
from session.detect.stills import Still
from session.log.config import Sensor
from session.log.logfile import Log

#: readings at a level, of either sign, from which it is one; a turn's own peak is a few
LEAST_AT = 20
#: times the readings' own noise that a level is from rest: an axis that is not turned has its extremes in the noise
FAR = 20.0
#: turns without a clipped reading that are enough to look at the axes and the scale
ENOUGH_CLEAN = 7


@dataclass(frozen=True, eq=False)
class Ceiling:
    """levels_dps (3,), NaN where an axis has none; at (N,) bool: rows with a reading at its level."""

    levels_dps: np.ndarray
    at: np.ndarray


def find_ceiling(gyro: np.ndarray) -> Ceiling | None:
    """Of rates (N, 3) rad/s: extremes of both signs that an axis stands at again and again, and never passes."""
    levels, at = np.full(3, np.nan), np.zeros(len(gyro), dtype=bool)
    for axis in range(3):
        values = gyro[:, axis]
        steps = np.diff(values)
        np.abs(steps, out=steps)
        noise = np.median(steps[steps > 0]) if (steps > 0).any() else 0.0
        rest = np.median(values)
        sides = [plateau(values, extreme, LEAST_RUN) for extreme in (values.max(), values.min()) if abs(extreme - rest) > FAR * noise]
        if len(sides) == 2 and min(side.sum() for side in sides) >= LEAST_AT:
            levels[axis] = np.abs(values[sides[0] | sides[1]]).mean() / DEG
            at |= sides[0] | sides[1]
    return Ceiling(levels, at) if at.any() else None


def clean_turns(ceiling: Ceiling | None, stills: list[Still]) -> tuple[int, int]:
    """Turns between neighbouring stills without a reading at the level, and all of them."""
    turns = [slice(first.stop, last.start) for first, last in pairwise(stills)]
    return sum(ceiling is None or not ceiling.at[turn].any() for turn in turns), len(turns)


def ceiling_finding(log: Log, sensor: Sensor, ceiling: Ceiling, stills: list[Still]) -> Finding:
    """The one line that stands for what the ceiling spoils."""
    found = np.isfinite(ceiling.levels_dps)
    levels = " and ".join(f"{level:.4g}" for level in np.unique(np.round(ceiling.levels_dps[found], 2)))
    clean, turns = clean_turns(ceiling, stills)
    says = (
        f"{axes_text(found)} never pass{'es' if found.sum() == 1 else ''} ±{levels} dps, of ±{sensor.gyro_fs_dps:g}: "
        f"{ceiling.at.mean():.0%} of the readings stand there, the first at {log.samples.t_s[np.argmax(ceiling.at)]:.1f} s"
    )
    if turns:
        says += f"; {turns - clean} of {turns} turns reach it"
    do = "what is beyond is lost: turn slower, or look for the limit in the sensor's settings and in what wrote the log"
    return Finding("error", log.path.name, "gyro ceiling", says, do)
