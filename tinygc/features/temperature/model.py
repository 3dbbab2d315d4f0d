"""A calibration over temperature: E(T) and b(T) as polynomials, the element's temperature by a lag; and its file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.polynomial.polynomial import polyval

from session.base.errors import CalibrationError
from session.base.records import Key, record_of
from session.base.results import Array, Keys, require
from session.log.samples import Samples
from tinygc.models.linear import LinearModel
from tinygc.models.model import CELSIUS, FACTOR, RATE, SECONDS, Model, invertible

# The element's temperature from the reading of the temperature sensor: the two differ while either changes.
#
#     y' = (T - y) / a,     T_e = y + r (T - y),     lag tau = a (1 - r)
#
# r = 0: the element follows the reading, tau = a later (the temperature sensor is nearer to the heat).  r = 20: it leads the reading by
# 19 a = -tau.  A lead cannot be computed exactly from noisy readings; r = 20 amplifies the noise twentyfold, and lags by a nineteenth of
# tau.  T is assumed linear between two readings, so that steps of a second and of a millisecond agree.

#: r of a lead
LEAD = 20.0


def time_and_share(tau_s: float) -> tuple[float, float]:
    """Return (a, r) of a lag tau, s; a is 0 where there is none."""
    return (tau_s, 0.0) if tau_s >= 0 else (-tau_s / (LEAD - 1), LEAD)


def weights(a_s: float, step_s: float) -> tuple[float, float, float]:
    """(c, new, old): y_k = c y_(k-1) + new T_k + old T_(k-1), exact where T is linear between two readings."""
    c = float(np.exp(-step_s / a_s))
    mean = float(-np.expm1(-step_s / a_s)) * a_s / step_s
    return c, 1 - mean, mean - c


class _ElementTemperature:
    """Filter of one axis, with state, so that a log may be processed in pieces.  It starts in steady state at the first reading."""

    def __init__(self, tau_s: float, step_s: float):
        self._a, self._r = time_and_share(tau_s)
        self._weights = weights(self._a, step_s) if self._a > 0 else None
        self._last: tuple[float, float] | None = None  # reading, y

    def __call__(self, reading_c: np.ndarray) -> np.ndarray:
        """Return (N,) degC of the element from the next readings (N,) degC."""
        if self._weights is None or not len(reading_c):
            return reading_c
        c, new, old = self._weights
        before, y_before = (float(reading_c[0]),) * 2 if self._last is None else self._last
        # Relative to the first reading, so that rounding errors scale with the change.
        x = reading_c - before
        state = np.array([c * (y_before - before)])
        from scipy.signal import lfilter

        y = before + lfilter([new, old], [1.0, -c], x, zi=state)[0]
        self._last = float(reading_c[-1]), float(y[-1])
        return y + self._r * (reading_c - y)


def element_temperature(reading_c: np.ndarray, tau_s: float, step_s: float) -> np.ndarray:
    """(N,) degC of the element, from evenly spaced readings (N,) degC."""
    return _ElementTemperature(tau_s, step_s)(reading_c)


# A calibration over temperature: E(T) and the zero b(T) as polynomials, the element's temperature by a lag of each axis.
#
#     omega = E(T) (m - b(T_e)),     E(T) = sum_n E_n (T - T0)^n,     b_i(T_e) = sum_n b_in (T_e,i - T0)^n
#
# m is the measured rate, T the sensor's reading, T_e,i the temperature of axis i's element (``element_temperature``).  Beyond the measured
# range, temperatures are clamped to its ends, because a polynomial does not extrapolate.  B(T) = -E(T) b(T) is the linear model's B.


@dataclass(frozen=True, eq=False)
class ThermalModel(Model):
    """E_terms (R + 1, 3, 3) per degC^n; zero_terms (Q + 1, 3) rad/s per degC^n; lag_s (3,); reference_c: T0; range_c."""

    kind: ClassVar[str] = "thermal"
    pointwise: ClassVar[bool] = False
    rates_only: ClassVar[bool] = False

    E_terms: Annotated[np.ndarray, Array((None, 3, 3), FACTOR, _terms), Key("E")]
    zero_terms: Annotated[np.ndarray, Array((None, 3), RATE, _terms), Key("zero_rps")]
    lag_s: Annotated[np.ndarray, Array((3,), SECONDS)]
    reference_c: Annotated[float, CELSIUS]
    range_c: Annotated[tuple[float, float], Array((2,), CELSIUS, _rising, lambda ends: tuple(ends.tolist()))]

    @property
    def parameters(self) -> int:
        """Number of coefficients and nonzero lags."""
        return self.E_terms.size + self.zero_terms.size + int(np.count_nonzero(self.lag_s))

    @property
    def conditions(self) -> tuple[str, ...]:
        """The model's input other than the rate: temperature."""
        return ("temperature",)

    def within(self, temp_c: np.ndarray) -> np.ndarray:
        """(N,) degC, clamped to the range."""
        return np.clip(temp_c, *self.range_c)

    def E(self, temp_c: np.ndarray) -> np.ndarray:
        """(N, 3, 3) at readings (N,) degC."""
        return np.moveaxis(polyval(self.within(np.asarray(temp_c, dtype=float)) - self.reference_c, self.E_terms), -1, 0)

    def zero(self, element_c: np.ndarray) -> np.ndarray:
        """Rate (N, 3) rad/s at rest, with the elements at (N, 3) degC."""
        return polyval(self.within(element_c) - self.reference_c, self.zero_terms[:, None, :], tensor=False)

    def at(self, temp_c: float) -> LinearModel:
        """Return the linear model at one constant temperature."""
        E, zero = self.E(np.array([temp_c]))[0], self.zero(np.full((1, 3), temp_c))[0]
        return LinearModel(E, -E @ zero)

    def elements(self, step_s: float) -> list[_ElementTemperature]:
        """Return a filter for each axis' element."""
        return [_ElementTemperature(float(tau), step_s) for tau in self.lag_s]

    def stream(self, rate_hz: float | None) -> ThermalStream:
        """Return a stream for one log, piece by piece.  Raises CalibrationError for a model with a lag where the data rate is unknown."""
        if self.lag_s.any() and rate_hz is None:
            raise CalibrationError("the model follows temperature with a lag: time matters to it; load it with rate_hz=")
        return ThermalStream(self, 1 / (rate_hz or 1.0))

    def calibrate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """Return true rates (N, 3) rad/s of one log, causally.  Raises CalibrationError where it has no temperature."""
        if samples.temp_c is None or not np.isfinite(samples.temp_c).all():
            raise CalibrationError("the log has no temperature, which this model follows; give temp, or another model")
        return ThermalStream(self, samples.period_s if len(samples) > 1 else 1.0)(samples.gyro, samples.temp_c)

    def with_bias_moved(self, change: np.ndarray) -> ThermalModel:
        """Add ``change`` (3,) rad/s to the calibrated rate at the reference temperature; elsewhere it is scaled by E(T) over E(T0)."""
        terms = self.zero_terms.copy()
        terms[0] -= np.linalg.solve(self.E_terms[0], change)
        return replace(self, zero_terms=terms)


class ThermalStream:
    """One log through the model, piece by piece; it keeps the elements' temperatures."""

    def __init__(self, model: ThermalModel, step_s: float):
        self._model = model
        self._elements = model.elements(step_s)

    def __call__(self, rate: np.ndarray, temp_c: np.ndarray) -> np.ndarray:
        """Return calibrated rates (N, 3) rad/s of the next samples: rate (N, 3) rad/s, temp_c (N,) degC."""
        element = np.column_stack([follow(temp_c) for follow in self._elements])
        rate = rate - self._model.zero(element)
        if len(self._model.E_terms) == 1:
            return rate @ self._model.E_terms[0].T
        return np.einsum("nij,nj->ni", self._model.E(temp_c), rate)


# A calibration over temperature as JSON.

EQUATION = (
    "omega = E(T) @ (m - zero(T_e)), E(T) = sum_n E[n] (T - reference_c)^n, zero_i = sum_n zero_rps[n][i] (T_e,i - reference_c)^n, "
    "T and T_e held within range_c; a y' = T - y, T_e = y + r (T - y), lag = a (1 - r), r = 0 for a lag, 20 for a lead"
)

#: coefficients of a polynomial; no fit of readings needs more
MOST_TERMS = 20


def _terms(values: np.ndarray) -> str:
    if len(values) > MOST_TERMS:
        return f"has {len(values)} coefficients, expected {MOST_TERMS} at most"
    return invertible(values[0]) if values.ndim == 3 else ""


def _rising(values: np.ndarray) -> str:
    return "" if values[0] <= values[1] else "goes down, expected coldest and warmest"


def to_table(model: ThermalModel, write: Callable[..., dict]) -> dict:
    """Return equation and coefficients, SI."""
    return {"equation": EQUATION, "thermal": model}


def from_table(table: dict, where: str, read: Callable[..., Any]) -> ThermalModel:
    """Return the model.  Raises FormatError for an invalid table."""
    shape = Keys({"thermal": record_of(ThermalModel)})
    require(table, shape, where)
    found: ThermalModel = shape.made(table)["thermal"]
    return found
