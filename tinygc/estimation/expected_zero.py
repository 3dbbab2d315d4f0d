"""What a calibration says of the zero at another time: the variance of B between the session and then, cause by cause.

The calibrated rate at rest, less the Earth's, is the zero's change since the calibration.  Without a fault its variance is the sum of

    calibration    covariance of B in the fit; the drift within the session, flicker noise about its long mean, is in it
    switch-on      2 spread^2: both the session and today are one draw (``repeatability``)
    wander         within one switch-on: the walk and the slow drift since the session (K and G of the unit's noise figures); beyond
                   ``END_S`` no figure says how it goes on
    temperature    (coefficient x difference)^2, where no model over temperature has taken it off

The flicker noise of the other time is in what is measured or used then.  Soon after the session it is partly that of the session: of two
means, var(use - session) = C_use + C_session - 2 C_both (``drift_between``).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.base.units import DEG, MG
from tinygc.closure.floor import BiasInstability
from tinygc.estimation.repeatability import BiasRepeatability
from tinygc.inference.noise import wander_covariance
from tinygc.noise.figures import NoiseFigures

#: spread of B between days, one sigma, where nothing says it: that of the EuRoC days is 0.03 to 0.14 dps (paper_tables.py --only table1)
USUAL_SPREAD = BiasRepeatability(np.full(3, 0.1 * DEG), "usual of MEMS gyroscopes, not of this unit")
#: change of the zero with temperature, one sigma, rad/s per K, where no model over temperature says it: an ASM330LHH's siblings state
#: 0.005 to 0.01 dps/K as typical, older ones 0.05
USUAL_PER_K = 0.01 * DEG
#: the same of an accelerometer, of gravity's length per K, one sigma: data sheets state 0.1 to 0.3 mg/K
USUAL_ACCEL_PER_K = 0.1 * MG
#: s: a walk is not followed beyond a day: no rest log is longer
END_S = 86400.0


def expected_zero(
    calibration: np.ndarray,
    *,
    elapsed_s: float | None = None,
    switched_on_since: bool = True,
    repeatability: BiasRepeatability | None = None,
    figures: NoiseFigures | None = None,
    warmer_k: float | None = None,
    per_k: np.ndarray | None = None,
) -> tuple[dict[str, np.ndarray], tuple[str, ...]]:
    """Variance (3, 3) (rad/s)^2 of the zero's change from a session to another time, by cause; and the causes whose size is not this unit's
    own.

    calibration (3, 3): of B in the fit, (rad/s)^2.  elapsed_s: between them, None where not known; switched_on_since: whether the sensor
    was, or may have been, switched off between them.  figures: of the unit at rest.  warmer_k: by how much it is warmer than in the
    session, None where not known or already taken off; per_k (3,): rad/s per K, one sigma.
    """
    parts, assumed = {"calibration": np.asarray(calibration, dtype=float)}, []
    if switched_on_since:
        spread = repeatability or USUAL_SPREAD
        parts["switch-on"] = np.diag(2 * spread.rps**2)
        if repeatability is None:
            assumed.append("switch-on")
    elif figures is not None:
        parts["wander"] = np.diag(_walk(END_S if elapsed_s is None else min(elapsed_s, END_S), figures))
    if warmer_k is not None and warmer_k != 0:
        slope = np.full(3, USUAL_PER_K) if per_k is None else np.asarray(per_k, dtype=float)
        parts["temperature"] = np.diag((slope * warmer_k) ** 2)
        if per_k is None:
            assumed.append("temperature")
    return parts, tuple(assumed)


def wander_variance(elapsed_s: float, figures: NoiseFigures | None, instability: BiasInstability | None) -> np.ndarray:
    """(3,) (rad/s)^2: mean square of the drift of each axis between two moments of one switch-on, ``elapsed_s`` apart.

    K: K^2 t; G: 2 G^2 (1 - exp(-t / T)); B: the flicker noise of ``closure.floor``, twice its variance less its covariance.
    """
    time = min(max(elapsed_s, 0.0), END_S)
    if figures is None:
        return np.full(3, 0.0 if instability is None else _flicker(time, instability.rps))
    return _walk(time, figures) + [_flicker(time, noise.value("B")) for noise in figures.gyro.axes]


def _walk(time_s: float, figures: NoiseFigures) -> np.ndarray:
    """(3,) (rad/s)^2: K^2 t + 2 G^2 (1 - exp(-t / T))."""
    G, tau_s = figures.gyro.values("G"), np.array([noise.terms["G"].tau_s or 1.0 for noise in figures.gyro.axes])
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
