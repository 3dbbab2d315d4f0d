"""A calibration over temperature as JSON."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from session.common.errors import FormatError
from tinygc.models.thermal import ThermalModel

EQUATION = (
    "omega = E(T) @ (m - zero(T_e)), E(T) = sum_n E[n] (T - reference_c)^n, zero_i = sum_n zero_rps[n][i] (T_e,i - reference_c)^n, "
    "T and T_e held within range_c; a y' = T - y, T_e = y + r (T - y), lag = a (1 - r), r = 0 for a lag, 20 for a lead"
)


def to_table(model: ThermalModel, write: Callable[..., dict]) -> dict:
    """equation and coefficients, SI."""
    return {
        "equation": EQUATION,
        "thermal": {
            "E": model.E_terms.tolist(),
            "zero_rps": model.zero_terms.tolist(),
            "lag_s": model.lag_s.tolist(),
            "reference_c": model.reference_c,
            "range_c": list(model.range_c),
        },
    }


def from_table(table: dict, where: str, read: Callable[..., Any]) -> ThermalModel:
    """The model; FormatError says what is wrong with the table."""
    try:
        part = table["thermal"]
        E, zero, lag = (np.asarray(part[name], dtype=float) for name in ("E", "zero_rps", "lag_s"))
        reference_c, (low, high) = float(part["reference_c"]), map(float, part["range_c"])
    except (KeyError, TypeError, ValueError) as error:
        raise FormatError(f"{where}: the temperature's terms cannot be read: {error}") from None
    if E.ndim != 3 or E.shape[1:] != (3, 3) or zero.ndim != 2 or zero.shape[1] != 3 or lag.shape != (3,) or not (len(E) and len(zero)):
        raise FormatError(f"{where}: E is {E.shape}, zero_rps {zero.shape}, lag_s {lag.shape}; expected (n, 3, 3), (n, 3), (3,)")
    if not all(np.isfinite(values).all() for values in (E, zero, lag, np.array([reference_c, low, high]))) or low > high:
        raise FormatError(f"{where}: the temperature's terms hold numbers that are not finite, or range_c is not [coldest, warmest]")
    return ThermalModel(E, zero, lag, reference_c, (low, high))
