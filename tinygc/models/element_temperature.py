"""The element's temperature from what the temperature sensor reads: they are not the same while either is on its way.

    y' = (T - y) / a,     T_e = y + r (T - y),     lag tau = a (1 - r)

r = 0: the element follows the reading, tau = a later (the temperature sensor sits nearer to the heat).  r = 20: it runs ahead of the
reading by 19 a = -tau.  A lead is not known exactly from readings that have noise; r = 20 lets that be twenty times as large, and is
late by a nineteenth of tau.  T is taken to be straight between two readings, so that steps of a second and of a millisecond agree.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

#: r of a lead
LEAD = 20.0


def time_and_share(tau_s: float) -> tuple[float, float]:
    """(a, r) of a lag tau, s; a is 0 where there is none."""
    return (tau_s, 0.0) if tau_s >= 0 else (-tau_s / (LEAD - 1), LEAD)


def weights(a_s: float, step_s: float) -> tuple[float, float, float]:
    """(c, new, old): y_k = c y_(k-1) + new T_k + old T_(k-1), exact where T is straight between two readings."""
    c = float(np.exp(-step_s / a_s))
    mean = float(-np.expm1(-step_s / a_s)) * a_s / step_s
    return c, 1 - mean, mean - c


class ElementTemperature:
    """One axis' filter: it remembers, so that a log may come in pieces.  Before the first reading all stood at its value."""

    def __init__(self, tau_s: float, step_s: float):
        self._a, self._r = time_and_share(tau_s)
        self._weights = weights(self._a, step_s) if self._a > 0 else None
        self._last: tuple[float, float] | None = None  # reading, y

    def __call__(self, reading_c: np.ndarray) -> np.ndarray:
        """(N,) degC of the element from the next readings (N,) degC."""
        if self._weights is None or not len(reading_c):
            return reading_c
        c, new, old = self._weights
        before, y_before = (float(reading_c[0]),) * 2 if self._last is None else self._last
        # About the first reading: the filter's rounding is then that of the change.
        x = reading_c - before
        state = np.array([c * (y_before - before)])
        y = before + lfilter([new, old], [1.0, -c], x, zi=state)[0]
        self._last = float(reading_c[-1]), float(y[-1])
        return y + self._r * (reading_c - y)


def element_temperature(reading_c: np.ndarray, tau_s: float, step_s: float) -> np.ndarray:
    """(N,) degC of the element, of evenly spaced readings (N,) degC."""
    return ElementTemperature(tau_s, step_s)(reading_c)
