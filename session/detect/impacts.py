"""Impacts: somebody hits a stop, or sets the sensor down hard.  A movement that lasts a few milliseconds falls between two readings.

The length of the specific force does not depend on how the sensor lies, and no hand changes it by ``JUMP_G`` between two readings: what
does, is shorter than they are apart.  What the gyroscope missed of it no reading tells; only the closure of such turns does.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from session.common.runs import runs_of
from session.common.units import G
from session.log.readings import pieces
from session.log.samples import Samples

#: g, from one reading to the next; hand turns without a stop reach 0.8 at 62.5 to 100 Hz (docs/real-recordings.md)
JUMP_G = 1.0
#: s: jumps that are nearer are one impact, and its ringing
APART_S = 0.2


@dataclass(frozen=True)
class Impact:
    """row of its greatest jump, which is between this reading and the next; at_s of the log; jump_g: that jump."""

    row: int
    at_s: float
    jump_g: float


def find_impacts(samples: Samples) -> list[Impact]:
    """All of a log, in order."""
    parts = [np.abs(np.diff(np.linalg.norm(part, axis=1))) / G for _, part in pieces(samples.accel, overlap=1)]
    jump = np.concatenate(parts)
    rows = np.flatnonzero(jump >= JUMP_G)
    if not len(rows):
        return []
    near = np.zeros(len(jump), dtype=bool)
    near[rows] = True
    reach = max(1, round(APART_S / samples.period_s))
    for first, last in pairwise(rows):
        if last - first <= reach:
            near[first : last + 1] = True
    greatest = [int(start + np.argmax(jump[start:stop])) for start, stop in zip(*runs_of(near), strict=True)]
    return [Impact(row, float(samples.t_s[row]), float(jump[row])) for row in greatest]
