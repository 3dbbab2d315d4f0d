"""The numbers of a model over temperature in one vector: E's terms, the zero's, the lags."""

from __future__ import annotations

import numpy as np

from tinygc.temperature.axis_fit import AxisFit
from tinygc.temperature.rest_fit import RestFit


def parameter_names(E_order: int, zero_order: int) -> tuple[str, ...]:
    """Of E's terms row by row, then the zero's, then the lags."""
    E = [f"E{n}_{i}{j}" for n in range(E_order + 1) for i in "xyz" for j in "xyz"]
    return (*E, *(f"zero{n}_{i}" for n in range(zero_order + 1) for i in "xyz"), *(f"lag_{i}" for i in "xyz"))


def zero_terms(fits: tuple[AxisFit, ...]) -> np.ndarray:
    """(Q + 1, 3) per degC^n, zeros beyond an axis' own order."""
    terms = np.zeros((max(fit.order for fit in fits) + 1, 3))
    for axis, fit in enumerate(fits):
        terms[: fit.order + 1, axis] = fit.terms
    return terms


def zero_covariance(fits: tuple[AxisFit, ...], order: int) -> np.ndarray:
    """(3 (order + 1) + 3, …): of ``zero_terms`` order by order, then of the lags; axes know nothing of one another."""
    size = 3 * (order + 1) + 3
    whole = np.zeros((size, size))
    for axis, fit in enumerate(fits):
        rows = [3 * n + axis for n in range(fit.order + 1)] + [size - 3 + axis]
        whole[np.ix_(rows, rows)] = fit.covariance
    return whole


def usable_range(rests: RestFit) -> tuple[float, float]:
    """Temperatures that the model is made for; where none was logged, the chip's own 25 degC."""
    low, high = rests.range_c
    return (low, high) if np.isfinite(low) else (25.0, 25.0)
