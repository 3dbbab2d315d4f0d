"""An accelerometer that nobody has calibrated: the stills do it as they come in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from session.accelerometer.lengths import LengthFit, attitudes_of, fit_lengths
from session.common.units import MG
from session.detect.stills import Still
from session.log.config import Accelerometer

#: of its nominal sensitivity: an accelerometer that is further off has another full scale, not another sensitivity
SCALE_RIGHT = 0.2


class OwnAccelerometer:
    """``add`` stills.  accelerometer: what they give, None while they fix nothing of it; known: whether they fix all of it; attitudes: how
    many of them lie apart."""

    def __init__(self, gravity_mps2: float) -> None:
        self._gravity_mps2 = gravity_mps2
        self.stills: list[Still] = []
        self.attitudes = 0
        self.accelerometer: Accelerometer | None = None
        self._lacks: tuple[str, ...] = ()

    def add(self, still: Still) -> None:
        """A still, its accelerometer as measured."""
        self.stills.append(still)
        self.attitudes = attitudes_of(self.force)
        fit, self.accelerometer = _fitted(self.force, self._gravity_mps2)
        self._lacks = fit.unobserved

    @property
    def known(self) -> bool:
        """Whether all of its numbers are."""
        return self.accelerometer is not None and not self._lacks

    @property
    def force(self) -> np.ndarray:
        """(S, 3) m/s^2 as measured."""
        return np.array([still.accel_mean for still in self.stills]).reshape(-1, 3)

    def correct(self, measured: np.ndarray) -> np.ndarray:
        """Specific force (..., 3) by what is known so far; as measured while nothing is."""
        return measured if self.accelerometer is None else self.accelerometer.correct(measured)

    @property
    def spread_mg(self) -> tuple[float, float | None]:
        """Standard deviation of gravity's length over the stills: as measured, and calibrated (None while nothing is known); 0 of none."""
        if not self.stills:
            return 0.0, None
        before, after = (np.linalg.norm(force, axis=1) / MG for force in (self.force, self.correct(self.force)))
        return float(np.std(before)), None if self.accelerometer is None else float(np.std(after))

    @property
    def words(self) -> str:
        """The live figure."""
        if not self.stills:
            return "no stills yet"
        before, after = self.spread_mg
        lie = f"{len(self.stills)} stills in {self.attitudes} attitudes"
        if after is None:
            return f"{lie}; gravity's spread {before:.1f} mg"
        says = f"{lie}; gravity's spread {before:.1f} mg before, {after:.2f} mg after"
        return says if self.known else f"{says} (not all of it yet)"

    @property
    def problem(self) -> str:
        """What no calibration may be, in words; empty where nothing is wrong."""
        if self.accelerometer is None:
            return ""
        scale = float(np.mean(np.diag(self.accelerometer.matrix)))
        if abs(scale - 1) <= SCALE_RIGHT:
            return ""
        return f"gravity reads {1 / scale:.2f} g in all attitudes: is the accelerometer's full scale right?"


def _fitted(force: np.ndarray, gravity_mps2: float) -> tuple[LengthFit, Accelerometer | None]:
    """The one place that asks for a calibration; None where the stills fix nothing of it."""
    scale = float(np.median(np.linalg.norm(force, axis=1))) / gravity_mps2
    scale = scale if abs(scale - 1) > SCALE_RIGHT else 1.0  # of another full scale: a robust fit does not come from so far
    found = fit_lengths(force / scale, gravity_mps2)
    if found.rung is None:
        return found, None
    given = found.accelerometer
    return found, replace(given, matrix=given.matrix / scale, bias_mps2=given.bias_mps2 * scale)
