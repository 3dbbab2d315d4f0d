"""How far the numbers of a unit are others in another session, and how far its zero drifts within one.

A fit's covariance is that of its session.  A number that is another one after the next switch-on is off by the difference of two draws from
the spread between sessions: its variance in any other session is the fit's and 2 spread^2.  Within one switch-on the zero drifts: the walk
and the slow drift since the session (K and G of the unit's noise figures); and flicker noise, of which two means have a part in common,
var(use - session) = C_use + C_session - 2 C_both (``drift_between``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from session.base.records import in_unit
from session.base.units import DEG, MG
from session.detect.accelerometer import BIASES, PARAMETERS, SCALES
from tinygc.closure.floor import BiasInstability, wander_covariance
from tinygc.estimation.between_sessions import ONE_SIGMA
from tinygc.models import linear
from tinygc.noise.figures import NoiseFigures

#: the 21 numbers of a unit, in the order of a joint covariance: the accelerometer's nine, then the gyroscope's twelve
COUNT = PARAMETERS + linear.PARAMETERS
ACCELEROMETER, GYROSCOPE, ZERO = slice(0, PARAMETERS), slice(PARAMETERS, COUNT), slice(COUNT - 3, COUNT)
#: change of the zero with temperature, one sigma, rad/s per K, where no model over temperature states it: an ASM330LHH's siblings state
#: 0.005 to 0.01 dps/K as typical, older ones 0.05
USUAL_PER_K = 0.01 * DEG
#: the same of an accelerometer, of gravity's length per K, one sigma: data sheets state 0.1 to 0.3 mg/K
USUAL_ACCEL_PER_K = 0.1 * MG
#: s: a walk is not followed beyond a day: no rest log is longer
END_S = 86400.0


@dataclass(frozen=True, eq=False)
class Spread:
    """Spread of n numbers of a unit between its sessions.

    scatter (n,) SI: one sigma of each as it was estimated, NaN where nothing shows it; freedom (n,): its degrees of freedom, infinite where
    it is known; sources (n,), in words; usual (n,) bool: whether it is that of such sensors, not this unit's own; note: what else the
    sessions show.
    """

    scatter: np.ndarray
    freedom: np.ndarray
    sources: np.ndarray
    usual: np.ndarray
    note: str = ""

    @classmethod
    def of(cls, which: Any, scatter: Any, source: str, freedom: Any = np.inf, usual: bool = False) -> Spread:
        """That of ``which`` of the 21 numbers; nothing of the others."""
        found = cls(np.full(COUNT, np.nan), np.full(COUNT, np.inf), np.full(COUNT, "", dtype=object), np.zeros(COUNT, dtype=bool))
        for column, value in zip(found.columns, (scatter, freedom, source, usual), strict=True):
            column[which] = value
        return found

    @property
    def columns(self) -> tuple[np.ndarray, ...]:
        """What it states of each number, (n,) each."""
        return self.scatter, self.freedom, self.sources, self.usual

    def at(self, which: slice | np.ndarray) -> Spread:
        """That of some of its numbers."""
        scatter, freedom, sources, usual = (column[which] for column in self.columns)
        return Spread(scatter, freedom, sources, usual, self.note)

    def or_else(self, other: Spread) -> Spread:
        """The same, and the other, of the numbers that it does not have."""
        known = np.isfinite(self.scatter)
        scatter, freedom, sources, usual = (np.where(known, own, more) for own, more in zip(self.columns, other.columns, strict=True))
        return Spread(scatter, freedom, sources, usual, self.note or other.note)

    @property
    def source(self) -> str:
        """Where the first of its numbers is from."""
        return str(self.sources[0])

    @property
    def is_usual(self) -> bool:
        """Whether nothing is known of this unit."""
        return bool(self.usual.all())

    @cached_property
    def sigma(self) -> np.ndarray:
        """(n,) SI: the scatter, widened as Student's t is, so that 68 % of the next sessions lie within it."""
        if np.isinf(self.freedom).all():
            return self.scatter
        from scipy.special import stdtrit  # late: most sessions have no history

        return self.scatter * np.where(np.isfinite(self.freedom), stdtrit(self.freedom, (1 + ONE_SIGMA) / 2), 1.0)

    @property
    def two_draws(self) -> np.ndarray:
        """(n, n): covariance of the difference of two sessions by it."""
        return np.diag(2 * self.sigma**2)

    def any_session(self, variance: np.ndarray) -> np.ndarray:
        """(n,) SI: one sigma of each number in any other session; variance (n,): in the fit."""
        return np.sqrt(variance + 2 * self.sigma**2)

    def to_json(self, variance: np.ndarray) -> dict | None:
        """``bias_any_session`` of ``tinygc-fit/2``; variance (3,): of B in the fit.  None where nothing is known of this unit."""
        if self.is_usual:
            return None
        sizes = in_unit(DEG, spread_dps=self.sigma, sigma_dps=self.any_session(variance))
        return sizes | {"degrees_of_freedom": self.freedom, "source": self.source}


#: where it is unknown.  Of B: that of the EuRoC days is 0.03 to 0.14 dps (paper_tables.py --only table1).  Of the accelerometer: the
#: zeros of eight MPU-9150 over six days (measured.md), and 10 to 40 mg over the life in data sheets; of its scale those days
#: show none beyond the fits', and data sheets state 0.005 to 0.02 % per K
USUAL = Spread.of(ZERO, 0.1 * DEG, "usual of MEMS gyroscopes, not of this unit", usual=True).or_else(
    Spread.of(ACCELEROMETER, 0.0, "usual of MEMS accelerometers, not of this unit", usual=True)
)
USUAL.scatter[SCALES], USUAL.scatter[BIASES] = 150e-6, 2 * MG / np.sqrt(2)


def wander_variance(elapsed_s: float, figures: NoiseFigures | None, instability: BiasInstability | None) -> np.ndarray:
    """(3,) (rad/s)^2: mean square of the drift of each axis between two moments of one switch-on, ``elapsed_s`` apart.

    K: K^2 t; G: 2 G^2 (1 - exp(-t / T)); B: the flicker noise of ``closure.floor``, twice its variance less its covariance.
    """
    time = min(max(elapsed_s, 0.0), END_S)
    if figures is None:
        return np.full(3, 0.0 if instability is None else _flicker(time, instability.rps))
    return walk_variance(time, figures) + [_flicker(time, noise.value("B")) for noise in figures.gyro.axes]


def walk_variance(time_s: float, figures: NoiseFigures) -> np.ndarray:
    """(3,) (rad/s)^2: K^2 t + 2 G^2 (1 - exp(-t / T)); of a time beyond ``END_S``, until there."""
    G, tau_s = figures.gyro.values("G"), np.array([noise.terms["G"].tau_s or 1.0 for noise in figures.gyro.axes])
    time_s = min(time_s, END_S)
    return figures.gyro.values("K") ** 2 * time_s - 2 * G**2 * np.expm1(-time_s / tau_s)


def _flicker(time_s: float, rps: float) -> float:
    none = np.zeros(1)
    return drift_between(none, none, time_s, 0.0, rps).change


@dataclass(frozen=True)
class DriftBetween:
    """Variances, (rad/s)^2, of one axis' drift: of its mean in a session, of its mean in a later use, and their covariance."""

    session: float
    use: float
    both: float

    @property
    def change(self) -> float:
        """Variance of the mean in the use less that in the session."""
        return self.session + self.use - 2 * self.both

    @property
    def correlation(self) -> float:
        """Of the two means; 0 where nothing drifts."""
        return self.both / float(np.sqrt(self.session * self.use)) if self.session * self.use > 0 else 0.0


def drift_between(middle_s: np.ndarray, span_s: np.ndarray, use_s: float, use_span_s: float, rps: float) -> DriftBetween:
    """Flicker noise of a bias instability, rad/s, in a session and in a use of the same switch-on.

    middle_s, span_s (S,): the session's pieces, their middles and durations, s; use_s, use_span_s: of the use, on the same clock.
    """
    wander = wander_covariance(np.r_[use_s, middle_s], np.r_[use_span_s, span_s], instability_rps=rps)
    return DriftBetween(float(wander[1:, 1:].mean()), float(wander[0, 0]), float(wander[0, 1:].mean()))
