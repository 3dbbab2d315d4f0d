"""Whether a law's numbers are known well enough for the rate that it states."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tinygc.effects import Movement
from tinygc.features.discovery.equivalence import added, as_effect
from tinygc.features.discovery.form import LawForm
from tinygc.features.discovery.search_state import beside_calibration
from tinygc.features.discovery.selection import Constants

# A law may be the right one and its numbers too wide for use: a threshold between two gains, a sum of nine coefficients.
#
# Numbers are drawn from their joint covariance; the rate of each draw is compared with the stated one over the recording, beyond a
# calibration and in the part that is observed.  Source: the posterior predictive check, with the normal approximation of the fit.

#: draws, for a share of a twentieth that is known to 3 %
DRAWS = 64
#: share of the variance of the stated rate that a draw may lack, and share of draws that may lack more
LACKING, MOST_LACKING = 0.05, 0.05


def share_lacking(
    form: LawForm,
    theta: np.ndarray,
    covariance: np.ndarray,
    constants: tuple[np.ndarray, np.ndarray] | None,
    observed: np.ndarray,
    movements: Sequence[Movement],
    seed: int = 0,
) -> float:
    """Share of draws whose rate lacks more than ``LACKING`` of the stated one's variance.

    theta (P,) with covariance (P, P) at fixed constants; constants: the covariance (K, K) of their logarithms, and along (P, K): by how
    much theta falls with each; observed (P, P): the projection onto the observed part of theta.
    """
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(covariance + 1e-12 * np.trace(covariance) * np.eye(len(theta)))
    drawn = theta + rng.standard_normal((DRAWS, len(theta))) @ root.T
    logs = np.zeros((DRAWS, 0))
    if constants is not None:
        spread, along = constants
        logs = rng.multivariate_normal(np.zeros(len(spread)), spread, DRAWS, method="eigh")
        drawn = drawn - logs @ along.T
    stated = beside_calibration(added(as_effect(form), observed @ theta, movements), movements)
    size, lacks = float(np.sum(stated**2)), []
    columns = [beside_calibration(added(as_effect(form), one, movements), movements).ravel() for one in observed] if not logs.size else []
    normal = np.array(columns) @ np.array(columns).T if columns else np.zeros((0, 0))
    for one, log in zip(drawn, logs, strict=True):
        if columns:
            lacks.append(float((one - theta) @ normal @ (one - theta)))
            continue
        other = form.with_constants(np.array(form.constants) * np.exp(log))
        rate = beside_calibration(added(as_effect(other), observed @ one, movements), movements)
        lacks.append(float(np.sum((rate - stated) ** 2)))
    return float(np.mean(np.array(lacks) > LACKING * size))


def of_constants(constants: Constants | None, part: slice) -> tuple[np.ndarray, np.ndarray] | None:
    """What ``share_lacking`` takes of a law whose coefficients are this part of a fit's parameters."""
    return None if constants is None else (constants.covariance, constants.along[part])
