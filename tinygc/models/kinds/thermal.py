"""A calibration over temperature as JSON."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from session.files.shapes import Array, Keys, require
from tinygc.models.shapes import CELSIUS, FACTOR, RATE, SECONDS, invertible
from tinygc.models.thermal import ThermalModel

EQUATION = (
    "omega = E(T) @ (m - zero(T_e)), E(T) = sum_n E[n] (T - reference_c)^n, zero_i = sum_n zero_rps[n][i] (T_e,i - reference_c)^n, "
    "T and T_e held within range_c; a y' = T - y, T_e = y + r (T - y), lag = a (1 - r), r = 0 for a lag, 20 for a lead"
)

#: coefficients of a polynomial; beyond, no fit of readings goes
MOST_TERMS = 20


def _terms(values: np.ndarray) -> str:
    if len(values) > MOST_TERMS:
        return f"has {len(values)} coefficients, expected {MOST_TERMS} at most"
    return invertible(values[0]) if values.ndim == 3 else ""


def _range(values: np.ndarray) -> str:
    return "" if values[0] <= values[1] else "goes down, expected coldest and warmest"


_THERMAL = Keys(
    {
        "thermal": Keys(
            {
                "E": Array((None, 3, 3), FACTOR, _terms),
                "zero_rps": Array((None, 3), RATE, _terms),
                "lag_s": Array((3,), SECONDS),
                "reference_c": CELSIUS,
                "range_c": Array((2,), CELSIUS, _range),
            }
        )
    }
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
    require(table, _THERMAL, where)
    part = table["thermal"]
    E, zero, lag = (np.asarray(part[name], dtype=float) for name in ("E", "zero_rps", "lag_s"))
    low, high = map(float, part["range_c"])
    return ThermalModel(E, zero, lag, float(part["reference_c"]), (low, high))
