"""What a fit over temperature gives: the model, how well each number is known, and what it was made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.models.thermal import ThermalModel
from tinygc.temperature.axis_fit import AxisFit
from tinygc.temperature.joint_fit import JointFit
from tinygc.temperature.rest_fit import RestFit


@dataclass(frozen=True, eq=False)
class ThermalFit:
    """model with covariance (n, n) of the numbers that ``names`` calls, SI; remaining_rps (3,): rms of what a sweep that was left out
    differs from the model, NaN without rest logs; rests, joint: what it was made of, either may be None; sha256 of the files by name;
    name of the session, or of the first one."""

    name: str
    model: ThermalModel
    covariance: np.ndarray
    names: tuple[str, ...]
    remaining_rps: np.ndarray
    rests: RestFit | None
    joint: JointFit | None
    sha256: dict[str, str]

    @property
    def sigma(self) -> np.ndarray:
        """(n,) of each number."""
        return np.sqrt(np.diag(self.covariance))


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


def of_rests_alone(name: str, rests: RestFit, sha256: dict[str, str]) -> ThermalFit:
    """E is the identity: nothing was turned."""
    terms = zero_terms(rests.gyro)
    model = ThermalModel(np.eye(3)[None], terms, np.array([f.tau_s for f in rests.gyro]), rests.knots.reference_c, usable_range(rests))
    order = len(terms) - 1
    covariance = np.zeros((9 + 3 * (order + 1) + 3,) * 2)
    covariance[9:, 9:] = zero_covariance(rests.gyro, order)
    held_out = np.array([fit.held_out for fit in rests.gyro])
    return ThermalFit(name, model, covariance, parameter_names(0, order), held_out, rests, None, sha256)


def usable_range(rests: RestFit) -> tuple[float, float]:
    """Temperatures that the model is made for; where none was logged, the chip's own 25 degC."""
    low, high = rests.range_c
    return (low, high) if np.isfinite(low) else (25.0, 25.0)
