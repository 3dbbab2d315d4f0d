"""An effect's own estimate beside what is fitted: linear, without selection."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tinygc.effects import Effect
from tinygc.explanation.twin.layout import claim_slice
from tinygc.explanation.twin.refit import Refit

#: of an effect's plausible size: the sigma of the prior that only keeps what no channel sees finite.  At ten it pulls a number that is
#: known to a tenth of the plausible by one in ten thousand
WIDE = 10.0


def component_names(effect: Effect) -> tuple[str, ...]:
    """Of the numbers of an effect's parameter: ``value``; ``x``, ``y``, ``z``; ``xx``, ``xy``, … row by row; else their numbers."""
    shape = effect.parameter.shape
    if not shape:
        return ("value",)
    if shape == (3,):
        return tuple("xyz")
    if shape == (3, 3):
        return tuple(row + column for row in "xyz" for column in "xyz")
    return tuple(str(number) for number in range(effect.parameter.size))


def linear_estimate(r: np.ndarray, J: np.ndarray, columns: np.ndarray, plausible: float) -> tuple[np.ndarray, np.ndarray]:
    """theta (P,) and its covariance (P, P) from whitened residuals r (n,), the columns J (n, p) of what is fitted beside it, and its own
    (n, P): r + columns theta is what is left."""
    q, _ = np.linalg.qr(J / np.maximum(np.linalg.norm(J, axis=0), 1e-300))
    own = columns - q @ (q.T @ columns)
    covariance = np.linalg.inv(own.T @ own + np.eye(own.shape[1]) / (WIDE * plausible) ** 2)
    return -covariance @ (own.T @ r), covariance


def without_claim(fit: Refit, number: int) -> Refit:
    """The fit as if a claim had not been made, to first order."""
    part = claim_slice(fit.state.claims, number)
    return replace(fit, r=fit.r - fit.J[:, part] @ fit.state.claims[number].theta, J=np.delete(fit.J, part, axis=1))
