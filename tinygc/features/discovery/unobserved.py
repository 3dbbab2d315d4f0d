"""The part of a law that a recording does not observe: combinations of its coefficients of which the channels say nothing."""

from __future__ import annotations

import numpy as np

from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.words import terms_of

# A law's gauge, from its own null space.
#
# Closure against gravity does not see every rate: ``ω_i += c |u| f_i``, the same c for all axes, turns the body about the vertical alone.
# The covariance of the coefficients, with the calibration free, says which of their combinations a recording leaves open.  Such a
# combination is set to zero, the least value, and neither stated nor applied.  In the eigenvectors of the covariance the estimates are
# independent, so what is observed stays the best fit.

#: sigma of a combination, over the law's own rms coefficient, from which on it is not observed: the data then reduce the variance of a
#: prior of the law's size by less than a factor of four (benchmarks/discovery_laws.py)
OPEN = 0.5
#: squared sigmas of an estimate that is kept however large its sigma is
SIGNIFICANT = 10.0
#: least weight of a coefficient that is named in words
NAMED = 0.15


def not_observed(theta: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Orthonormal directions (q, P) of coefficients theta (P,) with covariance (P, P) that are not observed; q is below P."""
    variance, directions = np.linalg.eigh(covariance)
    along = directions.T @ theta
    seen = np.ones(len(theta), dtype=bool)
    for place in np.argsort(-variance)[:-1]:  # the widest first; the narrowest stays
        others = seen.copy()
        others[place] = False
        size = float(np.sum(along[others] ** 2)) / len(theta)
        wide = variance[place] > OPEN**2 * size and along[place] ** 2 < SIGNIFICANT * variance[place]
        if not wide:
            break
        seen = others
    return directions.T[~seen]


def observed(directions: np.ndarray) -> np.ndarray:
    """Projection (P, P) onto what is observed beside these directions (q, P)."""
    return np.eye(directions.shape[1]) - directions.T @ directions


def in_words(form: LawForm, direction: np.ndarray) -> str:
    """``0.58 (x ← x) + 0.58 (y ← y)``: a combination (P,) of a law's coefficients, its largest weight positive."""
    signed = direction * np.sign(direction[np.argmax(np.abs(direction))])
    parts = [(weight, term) for weight, term in zip(signed, terms_of(form), strict=True) if abs(weight) >= NAMED]
    text = "".join(f" {'+' if weight > 0 else '−'} {abs(weight):.2f} ({term})" for weight, term in parts)
    return text.removeprefix(" + ").strip()
