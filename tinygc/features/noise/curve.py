"""Noise terms of an Allan curve that somebody else computed.

A curve holds less than its log: what is known is each deviation, not how two of them vary together.  One deviation of each octave is taken,
since overlapping estimates an octave apart are nearly independent, with the degrees of freedom of the least informative noise, a random
walk of the rate (NIST SP 1065, table 5).  So the sigmas of N are somewhat too large.
"""

from __future__ import annotations

import numpy as np

from session.base.errors import DataError
from tinygc.features.noise.choice import Search
from tinygc.features.noise.estimate import described, goodness
from tinygc.features.noise.likelihood import FILTER, Stacked
from tinygc.features.noise.scales import Group
from tinygc.noise.figures import AxisNoise, fits_data, unit_allan_variance

#: octaves that a curve needs, and those that are kept where the finest are left out
LEAST_OCTAVES, KEPT_OCTAVES = 4, 6
#: degrees of freedom of a deviation that is used
LEAST_FREEDOM = 2.0


class CurveSearch(Search):
    """The same search, with one Allan variance for each group: sizes of groups are indices of averaging times."""

    def __init__(self, tau_s: np.ndarray, variance: np.ndarray, freedom: np.ndarray, is_behind_filter: bool):
        self.tau_s = tau_s
        groups = [
            Group(k, np.arange(2), np.eye(1), np.array([[f * v]]), float(f)) for k, (v, f) in enumerate(zip(variance, freedom, strict=True))
        ]
        super().__init__(groups, 1.0, is_behind_filter=is_behind_filter)

    def unit(self, name: str, correlation_s: float = 1.0, hz: float = 0.0) -> Stacked:
        """Return the Allan variance of a term of size 1 at each averaging time."""
        sign = -1 if name == FILTER else 1
        return [sign * unit_allan_variance("Q" if name == FILTER else name, self.tau_s, correlation_s)[:, None, None]]

    def finest_s(self) -> float:
        """Return the shortest averaging time, s."""
        return float(self.tau_s[0])

    def bounds(self) -> tuple[float, float]:
        """Correlation times that the curve shows by both their sides."""
        return float(2 * self.tau_s[0]), float(self.tau_s[-1] / 2)


def fit_curve(tau_s: np.ndarray, deviation: np.ndarray, duration_s: float) -> list[AxisNoise]:
    """Fit the terms to Allan deviations (K, A) at averaging times tau_s (K,), SI, of a log of a duration.

    Returns a record for each of the A axes.  Raises DataError for a curve of less than four octaves.
    """
    order = np.argsort(tau_s)
    tau_s, deviation = np.asarray(tau_s, dtype=float)[order], np.asarray(deviation, dtype=float)[order]
    octaves = np.arange(np.log2(tau_s[0]), np.log2(tau_s[-1]) + 1e-9)
    at = np.unique([int(np.argmin(np.abs(np.log2(tau_s) - octave))) for octave in octaves])
    points = duration_s / tau_s[at]
    freedom = np.maximum(points - 2, 0) * (1 - 3 / points + 4 / points**2)
    used = at[freedom >= LEAST_FREEDOM]
    freedom = freedom[freedom >= LEAST_FREEDOM]
    if len(used) < LEAST_OCTAVES:
        raise DataError(f"the curve has {len(used)} octaves of averaging times that mean something, expected {LEAST_OCTAVES} or more")
    return [_axis(tau_s[used], column**2, freedom) for column in deviation[used].T]


def _axis(tau_s: np.ndarray, variance: np.ndarray, freedom: np.ndarray) -> AxisNoise:
    """Fit one axis; the finest averaging times, which the sensor's filter shapes, are left out while the model does not describe them."""
    for start in range(max(len(tau_s) - KEPT_OCTAVES, 0) + 1):
        search = CurveSearch(tau_s[start:], variance[start:], freedom[start:], start > 0)
        chosen = search.best()
        p_value, excess = goodness(search, chosen)
        if fits_data(p_value, excess):
            break
    return described(search, chosen, p_value, excess, float(tau_s[start]) if start else 0.0, 0.0)
