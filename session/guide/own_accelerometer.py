"""An accelerometer that nobody has calibrated: the stills do it as they come in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.accelerometer.from_stills import PARAMETERS, attitudes_of, fit_length
from session.common.errors import SegmentError
from session.common.units import MG
from session.detect.stills import Still
from session.log.config import Accelerometer

#: of its nominal sensitivity: an accelerometer that is further off has another full scale, not another sensitivity
SCALE_RIGHT = 0.2


class OwnAccelerometer:
    """``add`` stills.  accelerometer: what they give, None while they do not fix it; attitudes: how many of them lie apart."""

    def __init__(self, gravity_mps2: float) -> None:
        self._gravity_mps2 = gravity_mps2
        self.stills: list[Still] = []
        self.attitudes = 0
        self.accelerometer: Accelerometer | None = None

    def add(self, still: Still) -> None:
        """A still, its accelerometer as measured."""
        self.stills.append(still)
        self.attitudes = attitudes_of(self.force)
        self.accelerometer = _fitted(self.force, self._gravity_mps2)

    @property
    def force(self) -> np.ndarray:
        """(S, 3) m/s^2 as measured."""
        return np.array([still.accel_mean for still in self.stills]).reshape(-1, 3)

    def correct(self, measured: np.ndarray) -> np.ndarray:
        """Specific force (..., 3) by what is known so far; as measured while nothing is."""
        return measured if self.accelerometer is None else self.accelerometer.correct(measured)

    @property
    def spread_mg(self) -> tuple[float, float | None]:
        """Standard deviation of gravity's length over the stills: as measured, and calibrated (None while nothing is known)."""
        before, after = (np.linalg.norm(force, axis=1) / MG for force in (self.force, self.correct(self.force)))
        return float(np.std(before)), None if self.accelerometer is None else float(np.std(after))

    @property
    def words(self) -> str:
        """The live figure."""
        before, after = self.spread_mg
        lie = f"{len(self.stills)} stills in {self.attitudes} attitudes"
        if after is None:
            return f"{lie} (of {PARAMETERS} at least); gravity's spread {before:.1f} mg"
        return f"{lie}; gravity's spread {before:.1f} mg before, {after:.2f} mg after"

    @property
    def problem(self) -> str:
        """What no calibration may be, in words; empty where nothing is wrong."""
        if self.accelerometer is None:
            return ""
        scale = float(np.mean(np.diag(self.accelerometer.matrix)))
        if abs(scale - 1) <= SCALE_RIGHT:
            return ""
        return f"gravity reads {1 / scale:.2f} g in all attitudes: is the accelerometer's full scale right?"


def _fitted(force: np.ndarray, gravity_mps2: float) -> Accelerometer | None:
    """The one place that asks for a calibration; None where the stills do not fix one."""
    scale = float(np.median(np.linalg.norm(force, axis=1))) / gravity_mps2
    scale = scale if abs(scale - 1) > SCALE_RIGHT else 1.0  # of another full scale: a robust fit does not come from so far
    try:
        found = fit_length(force / scale, gravity_mps2)
    except SegmentError:
        return None
    return replace(found, matrix=found.matrix / scale, bias_mps2=found.bias_mps2 * scale)
