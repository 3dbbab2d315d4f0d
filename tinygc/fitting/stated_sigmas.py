"""How well least squares' parameters are known, with all noise that the recording shows.

The fit is linear in its errors: theta - truth = L y, y the stacked channels' errors (closure, still rates).  So its covariance is
L C L', whatever C is (the sandwich of ``closure/uncertainty.py`` with a dense filling).
"""

from __future__ import annotations

import numpy as np

from session.common.units import EARTH_RATE_RPS
from tinygc import closure
from tinygc.closure.probability import chi_square_above
from tinygc.closure.triangular import solve_lower
from tinygc.closure.uncertainty import GoodnessOfFit
from tinygc.fitting.stated_noise import StatedNoise, joint_columns, joint_response
from tinygc.models import linear
from tinygc.models.linear import BIAS, MATRIX, PARAMETERS, PRIOR_SIGMA, LinearModel
from tinygc.problem.joint_fit import GYROSCOPE
from tinygc.problem.problem import Problem
from tinygc.problem.still_bias import bias_shares


def stated_covariance(problem: Problem, model: LinearModel, noise: StatedNoise, still_rates: bool) -> tuple[np.ndarray, np.ndarray]:
    """(12, 12) of ``LinearModel.vector``, of a model that was fitted to this problem's batch, with or without the stills' rates as data;
    and what of it comes from the accelerometer's pre-calibration, which sessions with the same one share."""
    response = _response(problem, model, noise, still_rates)
    if problem.joint is not None:
        joint = stated_joint_covariance(problem, model, noise, still_rates)
        shared = response @ joint_columns(problem, problem.joint) @ problem.joint.beforehand
        return joint[GYROSCOPE, GYROSCOPE], shared @ shared.T * (problem.joint.mode == "prior")
    covariance = noise.covariance + _earth(problem, noise)
    shared = response @ noise.accelerometer
    return response @ covariance @ response.T, shared @ shared.T


def stated_joint_covariance(problem: Problem, model: LinearModel, noise: StatedNoise, still_rates: bool) -> np.ndarray:
    """(21, 21) of the accelerometer's nine numbers (``JointFit.x``) and the gyroscope's twelve, of a problem with a joint estimation.

    An error of a channel moves both; what it moves the accelerometer by bends the references that the gyroscope is fitted to.
    """
    rows, beforehand = _joint_parts(problem, model, noise, still_rates)
    return rows @ (noise.white + noise.noise.covariance + _earth(problem, noise)) @ rows.T + beforehand @ beforehand.T


def stated_joint_shared(problem: Problem, model: LinearModel, noise: StatedNoise, still_rates: bool) -> np.ndarray:
    """(21, 21): what of it comes from an error of the calibration that is given, which sessions with the same one share."""
    assert problem.joint is not None
    _, beforehand = _joint_parts(problem, model, noise, still_rates)
    return beforehand @ beforehand.T * (problem.joint.mode == "prior")


def _joint_parts(problem: Problem, model: LinearModel, noise: StatedNoise, still_rates: bool) -> tuple[np.ndarray, np.ndarray]:
    """(21, n) and (21, 9): how the numbers follow an error of each channel, and one sigma each of what is known beforehand."""
    joint = problem.joint
    assert joint is not None
    gyroscope = _response(problem, model, noise, still_rates)
    columns, accelerometer = joint_columns(problem, joint), joint_response(problem, joint)
    through = gyroscope @ columns
    rows = np.concatenate([accelerometer, gyroscope + through @ accelerometer])
    return rows, np.concatenate([joint.beforehand, through @ joint.beforehand])


def stated_goodness(problem: Problem, model: LinearModel, noise: StatedNoise) -> tuple[GoodnessOfFit, float]:
    """Of the closure, by all noise that has a cause; and the factor, 1 or more, on the covariance that all of it falls short of.

    What each turn errs by itself is left out of the first: it stands for what nothing explains, and would explain everything.
    """
    batch = problem.batch
    end, sensitivity = closure.end_and_sensitivity(batch, model(batch.rate))
    carry = _carry(problem, noise, sensitivity)
    angles = closure.error_angles(closure.batch_residual(batch, end)).ravel()
    design = linear.columns(sensitivity, batch.rate)[:, : batch.angles].reshape(len(angles), PARAMETERS)
    if problem.rest_rps is not None:
        design = _about(design, problem.rest_rps)[:, MATRIX]
    earth = _earth(problem, noise)
    known = problem.batch.known.ravel()
    covariances = ((carry @ (given + earth) @ carry.T)[np.ix_(known, known)] for given in (noise.named, noise.covariance))
    named, whole = (_goodness(angles[known], design[known], covariance) for covariance in covariances)
    return named, whole.excess


def _goodness(angles: np.ndarray, design: np.ndarray, covariance: np.ndarray) -> GoodnessOfFit:
    columns = design * PRIOR_SIGMA[: design.shape[1]]
    white = solve_lower(np.linalg.cholesky(covariance), np.column_stack([angles, columns]))
    left = white[:, 0] - white[:, 1:] @ np.linalg.lstsq(white[:, 1:], white[:, 0], rcond=None)[0]
    chi_square, freedom = float(left @ left), max(len(angles) - design.shape[1], 1)
    return GoodnessOfFit(chi_square, freedom, chi_square_above(chi_square, freedom))


def _response(problem: Problem, model: LinearModel, noise: StatedNoise, still_rates: bool) -> np.ndarray:
    """L (12, n) 1, rad/s: how the errors of the stacked channels move the parameters."""
    batch, rest = problem.batch, problem.rest_rps
    count, q = len(batch) * batch.angles, len(problem.still_rates.rate)
    sensitivity = closure.sensitivity(batch, model(batch.rate))
    design = linear.columns(sensitivity, batch.rate)[:, : batch.angles].reshape(count, PARAMETERS)
    weight = 1 / problem.floor.sigma.ravel() ** 2
    carry = _carry(problem, noise, sensitivity)
    if rest is not None:
        design = _about(design, rest)[:, MATRIX]
        hessian = design.T @ (design * weight[:, None]) + _prior_information(problem)
        matrix = -np.linalg.solve(hessian, (design * weight[:, None]).T @ carry)
        # B = mean over the stills of (earth - E m): their own error, and E's on the mean rate.
        bias = -np.kron(np.eye(3), rest) @ matrix
        bias[:, count : count + 3 * q] -= np.tile(np.eye(3), q) / q
        return np.concatenate([matrix, bias])
    pull = (design * weight[:, None]).T @ carry
    hessian = design.T @ (design * weight[:, None]) + _prior_information(problem)
    if still_rates:
        rows = problem.still_rates.columns()
        hessian += rows.T @ rows
        pull[:, count : count + 3 * q] += (rows / problem.still_rates.sigma.ravel()[:, None]).T
    return -np.linalg.solve(hessian, pull)


def _prior_information(problem: Problem) -> np.ndarray:
    """(9, 9) of E alone where the bias is known from the stills, else (12, 12): as the fit weighs it."""
    own = slice(0, PARAMETERS) if problem.rest_rps is None else MATRIX
    if problem.prior is None:
        return np.diag(1 / PRIOR_SIGMA[own] ** 2)
    return np.linalg.inv((problem.prior.covariance / problem.prior.weight)[own, own])


def prior_share(problem: Problem, model: LinearModel, still_rates: bool) -> np.ndarray:
    """K (12, 12): how the parameters follow an error of the prior's centre.

    theta - truth = L y + K (centre - truth): beside the noise's own covariance the fit has K P K' of a prior with covariance P.
    """
    batch, rest = problem.batch, problem.rest_rps
    sensitivity = closure.sensitivity(batch, model(batch.rate))
    design = linear.columns(sensitivity, batch.rate)[:, : batch.angles].reshape(-1, PARAMETERS)
    weight = 1 / problem.floor.sigma.ravel() ** 2
    own, share = _prior_information(problem), np.zeros((PARAMETERS, PARAMETERS))
    if rest is not None:
        design = _about(design, rest)[:, MATRIX]
        share[MATRIX, MATRIX] = np.linalg.solve(design.T @ (design * weight[:, None]) + own, own)
        share[BIAS, MATRIX] = -np.kron(np.eye(3), rest) @ share[MATRIX, MATRIX]
        return share
    hessian = design.T @ (design * weight[:, None]) + own
    if still_rates:
        rows = problem.still_rates.columns()
        hessian += rows.T @ rows
    return np.linalg.solve(hessian, own)


def _about(design: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """Columns (n, 12) with E's taken about the bias at rest, which B = -E rest then follows."""
    turned = design.copy()
    turned[:, MATRIX] -= np.einsum("na,j->naj", design[:, BIAS], rest).reshape(len(design), 9)
    return turned


def _carry(problem: Problem, noise: StatedNoise, sensitivity: np.ndarray) -> np.ndarray:
    """(S d, n): the closure's errors from those of the channels; what a still's rate errs by goes into the turns around it, where its bias
    is taken from there."""
    rows = noise.closure.stop
    carry = np.zeros((rows, len(noise.white)))
    carry[:, :rows] = np.eye(rows)
    if problem.rest_rps is not None:
        batch = problem.batch
        sensitivity = sensitivity[:, :, : batch.angles]
        first, last, share = bias_shares(problem)
        before = np.einsum("st,stij->sij", 1 - share, sensitivity)
        after = np.einsum("st,stij->sij", share, sensitivity)
        for s in range(len(batch)):
            own = slice(s * batch.angles, (s + 1) * batch.angles)
            for still, part in ((first[s], before[s]), (last[s], after[s])):
                carry[own, rows + 3 * still : rows + 3 * still + 3] -= part
    return carry


def _earth(problem: Problem, noise: StatedNoise) -> np.ndarray:
    """(n, n) of a heading that is estimated, or of one that is not known, where the latitude is."""
    twin, earth = noise.twin, problem.earth
    columns = twin.earth_columns().stacked() @ twin.start().axes.T
    sigma = np.zeros(2)
    if earth.source == "estimated":
        sigma[0] = float(np.hypot(*earth.rate_t[:2])) * earth.heading_sigma_rad
    elif earth.source == "unknown":
        latitude_deg = problem.session.config.site.latitude_deg or 0.0
        sigma[:] = EARTH_RATE_RPS * np.cos(np.radians(latitude_deg)) / np.sqrt(2)
    return (columns * sigma**2) @ columns.T
