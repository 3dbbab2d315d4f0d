"""What a fit gives a row: closure, floor, which model to use, and the 21 numbers of ``tinygc.lot.unit_result`` with their covariance."""

from __future__ import annotations

import numpy as np

from session.accelerometer.parameters import NAMES as TRIAD
from session.common.units import DEG
from tinygc.fitting.figures import closure_figures, run_figures
from tinygc.fitting.result import FitResult
from tinygc.fleet.row import COUNT, SIGMAS, VALUES, Row, number, packed
from tinygc.models import linear

LEAST_SQUARES = "least_squares"
GYRO, ACCEL = slice(0, linear.PARAMETERS), slice(linear.PARAMETERS, COUNT)


def fitted(result: FitResult) -> Row:
    """Part of a row."""
    values, covariance = numbers_of(result)
    sigmas = np.sqrt(np.diag(covariance))
    runs = [run_figures(errors[LEAST_SQUARES])["rmse_deg"] for errors in result.run_errors]
    return {
        "segments": len(result.problem.used),
        "held_out_deg": number(closure_figures(result.methods[LEAST_SQUARES].held_out)["tilt_rms_deg"]),
        "floor_deg": number(result.problem.floor.tilt_rms / DEG),
        "run_rmse_deg": number(max(runs)) if runs else None,
        "use": result.use.method,
        "covariance": packed(covariance),
        **{name: number(value) for name, value in zip((*VALUES, *SIGMAS), (*values, *sigmas), strict=True)},
    }


def numbers_of(result: FitResult) -> tuple[np.ndarray, np.ndarray]:
    """(21,) and (21, 21) in the order of ``unit_result.NAMES``; NaN where the session did not tell."""
    values, covariance = np.full(COUNT, np.nan), np.full((COUNT, COUNT), np.nan)
    accelerometer, joint = result.accelerometer, result.joint_covariance
    values[GYRO], covariance[GYRO, GYRO] = result.linear.model.vector, result.covariance  # type: ignore[attr-defined]
    if joint is not None:
        # A joint covariance is of the accelerometer's correction and then of the gyroscope; the triad's numbers follow the correction.
        whole = np.eye(COUNT)
        own = COUNT - linear.PARAMETERS
        whole[:own, :own] = accelerometer.jacobian
        order = [*range(own, COUNT), *range(own)]
        values[ACCEL], covariance = accelerometer.values, (whole @ joint @ whole.T)[np.ix_(order, order)]
        covariance = (covariance + covariance.T) / 2
    untold = np.isnan(values)
    unobserved = result.linear.notes.get("unobserved", [])
    untold[GYRO] |= np.isin(linear.NAMES, unobserved)
    if joint is not None:
        untold[ACCEL] |= np.isin(TRIAD, accelerometer.unobserved)
    values[untold] = np.nan
    covariance[untold] = covariance[:, untold] = np.nan
    return values, covariance
