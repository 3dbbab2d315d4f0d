"""A calibration over temperature: E(T) and the zero b(T) as polynomials, the element's temperature by a lag of each axis.

    omega = E(T) (m - b(T_e)),     E(T) = sum_n E_n (T - T0)^n,     b_i(T_e) = sum_n b_in (T_e,i - T0)^n

m is the measured rate, T the sensor's reading, T_e,i axis i's element (``element_temperature.py``).  Beyond the temperatures that were
measured the last ones hold: a polynomial knows nothing out there.  B(T) = -E(T) b(T) is the linear model's B.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.polynomial.polynomial import polyval

from session.common.errors import CalibrationError
from session.log.samples import Samples
from tinygc.models.element_temperature import ElementTemperature
from tinygc.models.linear import LinearModel
from tinygc.models.model import BaseModel


@dataclass(frozen=True, eq=False)
class ThermalModel(BaseModel):
    """E_terms (R + 1, 3, 3) per degC^n; zero_terms (Q + 1, 3) rad/s per degC^n; lag_s (3,); reference_c: T0; range_c."""

    kind: ClassVar[str] = "thermal"
    pointwise: ClassVar[bool] = False
    rates_only: ClassVar[bool] = False

    E_terms: np.ndarray
    zero_terms: np.ndarray
    lag_s: np.ndarray
    reference_c: float
    range_c: tuple[float, float]

    @property
    def parameters(self) -> int:
        """All coefficients, and the lags that there are."""
        return self.E_terms.size + self.zero_terms.size + int(np.count_nonzero(self.lag_s))

    @property
    def conditions(self) -> tuple[str, ...]:
        """Temperature."""
        return ("temperature",)

    def within(self, temp_c: np.ndarray) -> np.ndarray:
        """(N,) degC, held at the ends of the range."""
        return np.clip(temp_c, *self.range_c)

    def E(self, temp_c: np.ndarray) -> np.ndarray:
        """(N, 3, 3) at readings (N,) degC."""
        return np.moveaxis(polyval(self.within(np.asarray(temp_c, dtype=float)) - self.reference_c, self.E_terms), -1, 0)

    def zero(self, element_c: np.ndarray) -> np.ndarray:
        """(N, 3) rad/s that the sensor reads at rest, its elements being at (N, 3) degC."""
        return polyval(self.within(element_c) - self.reference_c, self.zero_terms[:, None, :], tensor=False)

    def at(self, temp_c: float) -> LinearModel:
        """The linear model of one temperature that stands."""
        E, zero = self.E(np.array([temp_c]))[0], self.zero(np.full((1, 3), temp_c))[0]
        return LinearModel(E, -E @ zero)

    def elements(self, step_s: float) -> list[ElementTemperature]:
        """A filter for each axis' element."""
        return [ElementTemperature(float(tau), step_s) for tau in self.lag_s]

    def follower(self, step_s: float) -> ThermalStream:
        """A log by itself, piece by piece; step_s between two samples."""
        return ThermalStream(self, step_s)

    def calibrate(self, samples: Samples, began_s: float = 0.0, live: bool = False) -> np.ndarray:
        """True rates (N, 3) rad/s of one log.  CalibrationError where it has no temperature.  What has been is all that is looked at."""
        if samples.temp_c is None or not np.isfinite(samples.temp_c).all():
            raise CalibrationError("the log has no temperature, which this model follows; give temp, or another model")
        return self.follower(samples.period_s if len(samples) > 1 else 1.0)(samples.gyro, samples.temp_c)

    def with_bias_moved(self, change: np.ndarray) -> ThermalModel:
        """The calibrated rate greater by ``change`` (3,) rad/s at the reference temperature; elsewhere by as much times E(T) over E(T0)."""
        terms = self.zero_terms.copy()
        terms[0] -= np.linalg.solve(self.E_terms[0], change)
        return replace(self, zero_terms=terms)


class ThermalStream:
    """One log through the model, piece by piece: it remembers the elements' temperatures."""

    def __init__(self, model: ThermalModel, step_s: float):
        self._model = model
        self._elements = model.elements(step_s)

    def __call__(self, rate: np.ndarray, temp_c: np.ndarray) -> np.ndarray:
        """Calibrated rates (N, 3) rad/s of the next samples: rate (N, 3) rad/s, temp_c (N,) degC."""
        element = np.column_stack([follow(temp_c) for follow in self._elements])
        rate = rate - self._model.zero(element)
        if len(self._model.E_terms) == 1:
            return rate @ self._model.E_terms[0].T
        return np.einsum("nij,nj->ni", self._model.E(temp_c), rate)
