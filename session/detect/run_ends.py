"""The two ends of a closure run: a still, a long turn, a still in the same attitude.  Judged here while it is recorded, and by ``fit``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.common.units import DEG
from session.detect.segments import why_broken
from session.detect.stills import Still
from session.log.config import Sensor
from session.log.samples import Samples

#: a table is set back by hand to a dial: closer than this is "the same attitude"
RETURN_RAD = 0.5 * DEG


@dataclass(frozen=True, eq=False)
class RunEnds:
    """Stills at the beginning and the end; away_rad: between gravity in one and the other; broken: why it cannot be integrated."""

    first: Still
    last: Still
    away_rad: float
    broken: str | None

    @property
    def returned(self) -> bool:
        """Whether it ends in the attitude that it began in, as far as gravity sees it."""
        return self.away_rad <= RETURN_RAD


def run_ends(samples: Samples, stills: list[Still], sensor: Sensor, put_in: np.ndarray | None = None) -> RunEnds | None:
    """Of a log's samples and stills; None where there are not two stills.  Stills between the two are passed over.

    put_in (N,) bool: samples that are no readings.
    """
    good = [still for still in stills if still.problem is None]
    if len(good) < 2:
        return None
    first, last = good[0], good[-1]
    away = np.arctan2(np.linalg.norm(np.cross(first.accel_mean, last.accel_mean)), first.accel_mean @ last.accel_mean)
    return RunEnds(first, last, float(away), why_broken(samples, slice(first.stop, last.start + 1), sensor, put_in))
