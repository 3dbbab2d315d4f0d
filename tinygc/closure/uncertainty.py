"""Covariance of the parameters, and goodness of fit of the closure against its floor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from session.base.rotation import sample_weights
from session.base.units import EARTH_RATE_RPS
from tinygc.closure import residual
from tinygc.closure.earth import EarthRate
from tinygc.closure.floor import BiasWander, Floor
from tinygc.closure.least_squares import GaussianPrior
from tinygc.inference.choose import MISMATCH_P, chi_square_above
from tinygc.inference.solve import solve, solve_lower
from tinygc.models import linear
from tinygc.models.linear import PRIOR_SIGMA, LinearModel

# Probabilities of a few statistics: importing ``scipy.stats`` takes longer than a fit.
#
# tests/test_least_squares_physics.py compares them with it.


# Covariance of the parameters, and goodness of fit of the closure against its floor.


@dataclass(frozen=True, eq=False)
class GoodnessOfFit:
    """Chi-square of the error angles against the floor, with its degrees of freedom and its p-value."""

    chi_square: float
    freedom: int
    p_value: float

    @property
    def excess(self) -> float:
        """Factor on the floor's variance that explains the residuals; 1 if noise alone explains them."""
        return max(1.0, self.chi_square / self.freedom) if self.p_value < MISMATCH_P else 1.0


def goodness(batch: residual.Batch, floor: Floor, model: LinearModel, wander: BiasWander | None = None) -> GoodnessOfFit:
    """Goodness of fit of the closure under a linear model, whose 12 parameters are refitted with the full covariance.

    That covariance includes shared stills and, if ``wander`` is given, bias drift.
    """
    rate = model(batch.rate)
    end, sensitivity = residual.end_and_sensitivity(batch, rate)
    angles = residual.error_angles(residual.batch_residual(batch, end)).ravel()
    design = linear.columns(sensitivity, batch.rate)[:, : batch.angles].reshape(len(angles), -1)
    covariance = floor.dense()
    if wander is not None:
        bias, owner = design[:, linear.BIAS], np.repeat(np.arange(len(batch)), batch.angles)
        covariance = covariance + (bias @ bias.T) * wander.covariance[np.ix_(owner, owner)]
    known = batch.known.ravel()
    return closure_goodness(angles[known], design[known], covariance[np.ix_(known, known)])


def closure_goodness(angles: np.ndarray, design: np.ndarray, covariance: np.ndarray) -> GoodnessOfFit:
    """Goodness of fit of angles (n,) rad with their covariance (n, n); design (n, p): of the first p parameters, each within its prior."""
    columns = design * PRIOR_SIGMA[: design.shape[1]]
    white = solve_lower(np.linalg.cholesky(covariance), np.column_stack([angles, columns]))
    found = solve(white[:, 1:], white[:, 0])
    left = white[:, 0] - white[:, 1:] @ found.shortest
    chi_square, freedom = float(left @ left), max(len(angles) - found.rank, 1)
    return GoodnessOfFit(chi_square, freedom, chi_square_above(chi_square, freedom))


#: causes of parts of a covariance beyond those of the floor
BIAS_DRIFT, EARTH = "drift of the bias", "heading and the Earth's rate"


def covariance_parts(
    batch: residual.Batch,
    floor: Floor,
    model: LinearModel,
    earth: EarthRate,
    wander: BiasWander | None = None,
    prior: GaussianPrior | None = None,
) -> dict[str, np.ndarray]:
    """(12, 12) of each cause: the covariance of ``LinearModel.vector`` due to the session's noise, without errors of the prior.

    Weighted least squares with weights 1/sigma^2 neglects that neighbours share a still, that the heading is estimated or unknown, and that
    the bias drifts during the session; the sandwich H^-1 (J' W C W J) H^-1 includes all three (White 1980).  C, and so the sandwich, is a
    sum over causes: the floor's parts, the Earth's rate, the bias drift.
    wander: bias drift between the segments; without it the bias is constant.
    """
    rate = model(batch.rate)
    sensitivity = residual.sensitivity(batch, rate)
    design = linear.columns(sensitivity, batch.rate)[:, : batch.angles]
    weighed, hessian, meat, drift = _seen(design, floor)
    hessian += np.diag(1 / PRIOR_SIGMA**2) if prior is None else prior.information
    for sideways in _unseen_rates(earth):
        # The horizontal Earth rate that an uncertain heading leaves out: one more column for each direction, one sigma long.
        body = np.einsum("stji,j->sti", _turn(sensitivity, batch), sideways)
        column = np.einsum("stij,stj->si", sensitivity, body)[:, : batch.angles]
        pull = np.einsum("sdp,sd->p", weighed, column)
        meat[EARTH] = meat.get(EARTH, 0.0) + np.outer(pull, pull)
    if wander is not None:
        meat[BIAS_DRIFT] = _drifting(drift, wander.covariance)
    inverse = np.linalg.inv(hessian)
    return {cause: inverse @ part @ inverse for cause, part in meat.items()}


def _unseen_rates(earth: EarthRate) -> np.ndarray:
    """(K, 3) rad/s, table axes: one sigma of the horizontal Earth rate left out, across an estimated heading or in any direction."""
    if earth.source == "estimated":
        # The rate is the mean over the headings, exp(-sigma^2 / 2) of its length: what is left of length^2 lies across it.
        return np.cross([0.0, 0.0, 1.0], earth.rate_t)[None] * np.sqrt(np.expm1(earth.heading_sigma_rad**2))
    if earth.source == "unknown":
        left = max(EARTH_RATE_RPS**2 - float(earth.rate_t @ earth.rate_t), 0.0)  # of a known length, less the vertical part and the mean
        return np.eye(3)[:2] * np.sqrt(left / 2)
    return np.zeros((0, 3))


def covariance_from_columns(
    design: np.ndarray,
    floor: Floor,
    wander: BiasWander,
    more_prior: np.ndarray | None = None,
    information: np.ndarray | None = None,
) -> np.ndarray:
    """(P, P) covariance from the segments' columns (S, d, P) alone: the sum of ``covariance_parts`` without still rates and heading.

    Further parameters may follow the 12, with prior sigmas ``more_prior`` (P - 12,); information (P, P): of other data.
    """
    prior = np.diag(1 / np.concatenate([PRIOR_SIGMA, [] if more_prior is None else more_prior]) ** 2)
    _, hessian, parts, drift = _seen(design, floor)
    known = prior if information is None else prior + information
    inverse = np.linalg.inv(hessian + known)
    # The prior's term in the middle keeps its uncertainty for parameters that no segment observes.
    return inverse @ (sum(parts.values()) + _drifting(drift, wander.covariance) + known) @ inverse


def _seen(design: np.ndarray, floor: Floor) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray], np.ndarray]:
    """Columns (S, d, P) by their weights; J' W J; J' W C W J of each of the floor's causes; (S, P, 3) J' W of the bias of each segment, an
    error of which rotates its end along the three bias columns."""
    weighed = design * (1 / floor.sigma[..., None] ** 2)
    hessian = np.einsum("sdp,sdq->pq", weighed, design)
    meat = {cause: np.einsum("sdp,sdq->pq", weighed, part.times(weighed)) for cause, part in floor.parts.items()}
    return weighed, hessian, meat, np.einsum("sdp,sdi->spi", weighed, design[..., linear.BIAS])


def _drifting(pull: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    return np.einsum("spi,st,tqi->pq", pull, covariance, pull, optimize=True)


def _turn(sensitivity: np.ndarray, batch: residual.Batch) -> np.ndarray:
    """Rotation matrices (S, T, 3, 3) from a sensitivity, which is their product with the sample's duration."""
    duration = sample_weights(batch.dt)[..., None, None]
    return sensitivity / np.where(duration > 0, duration, 1)
