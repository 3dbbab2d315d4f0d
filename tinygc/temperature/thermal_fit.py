"""What a fit over temperature gives: the model, how well each number is known, and what it was made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tinygc.models.linear import MATRIX
from tinygc.models.thermal import ThermalModel
from tinygc.temperature.rest_fit import RestFit
from tinygc.temperature.sessions_fit import SessionsFit
from tinygc.temperature.thermal_terms import parameter_names, usable_range, zero_covariance, zero_terms


@dataclass(frozen=True, eq=False)
class ThermalFit:
    """model with covariance (n, n) of the numbers that ``names`` calls, SI; remaining_rps (3,): rms of what a sweep that was left out
    differs from the model, NaN without rest logs; rests, sessions: what it was made of, either may be None; sha256 of the files by name;
    name of the session, or of the first one."""

    name: str
    model: ThermalModel
    covariance: np.ndarray
    names: tuple[str, ...]
    remaining_rps: np.ndarray
    rests: RestFit | None
    sessions: SessionsFit | None
    sha256: dict[str, str]

    @property
    def values(self) -> np.ndarray:
        """(n,) as ``names`` calls them."""
        return np.concatenate([self.model.E_terms.ravel(), self.model.zero_terms.ravel(), self.model.lag_s])

    def sigma_at(self, temp_c: float) -> tuple[np.ndarray, np.ndarray]:
        """One sigma of E (3, 3) and of the zero (3,) rad/s at a temperature that stands, by the covariance alone."""
        away = float(self.model.within(np.array([temp_c]))[0]) - self.model.reference_c
        n_E = self.model.E_terms.size
        powers = away ** np.arange(len(self.model.E_terms)), away ** np.arange(len(self.model.zero_terms))
        slopes = np.kron(powers[0], np.eye(9)), np.kron(powers[1], np.eye(3))
        parts = self.covariance[:n_E, :n_E], self.covariance[n_E:-3, n_E:-3]
        E, zero = (np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", S, C, S), 0)) for S, C in zip(slopes, parts, strict=True))
        return E.reshape(3, 3), zero

    @property
    def sigma(self) -> np.ndarray:
        """(n,) of each number."""
        return np.sqrt(np.diag(self.covariance))


def of_rests_alone(name: str, rests: RestFit, sha256: dict[str, str]) -> ThermalFit:
    """E is the identity: nothing was turned."""
    terms = zero_terms(rests.gyro)
    model = ThermalModel(np.eye(3)[None], terms, np.array([f.tau_s for f in rests.gyro]), rests.knots.reference_c, usable_range(rests))
    order = len(terms) - 1
    covariance = np.zeros((9 + 3 * (order + 1) + 3,) * 2)
    covariance[MATRIX.stop :, MATRIX.stop :] = zero_covariance(rests.gyro, order)
    held_out = np.array([fit.held_out for fit in rests.gyro])
    return ThermalFit(name, model, covariance, parameter_names(0, order), held_out, rests, None, sha256)


def joined(name: str, sessions: SessionsFit, rests: RestFit | None, sha256: dict[str, str]) -> ThermalFit:
    """Of sessions, with rest logs or without."""
    names = parameter_names(len(sessions.model.E_terms) - 1, len(sessions.model.zero_terms) - 1)
    held_out = np.full(3, np.nan) if rests is None else np.array([fit.held_out for fit in rests.gyro])
    return ThermalFit(name, sessions.model, sessions.covariance, names, held_out, rests, sessions, sha256)
