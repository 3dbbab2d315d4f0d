"""What the linear model does not have, measured all the same: g-sensitivity and scale-factor asymmetry, each with its uncertainty.

A report states them whether or not they are there.  Each is refitted exactly, together with the linear model, the Earth's unknown
part and whatever effects have been named before, on the closure, the stills' rates and gravity's length.
"""

from __future__ import annotations

import numpy as np

from session.common.units import DEG, EARTH_RATE_RPS
from tinygc.effects import catalogue
from tinygc.explanation.twin.refit import Refit, refit
from tinygc.explanation.twin.state import State
from tinygc.explanation.twin.twin import Twin
from tinygc.explanation.twin.whitening import Whitener
from tinygc.models.field_parameters import COVERAGE_FACTOR, Quantity

G_SENSITIVITY, ASYMMETRY = "gyro.g_sensitivity", "gyro.scale_asymmetry"
PPM = 1e-6
#: a sigma above this share of what is plausible at all is the prior's, not the session's
OBSERVED_SHARE = 0.3


def beyond_linear(twin: Twin, whiten: Whitener, start: State | None = None) -> list[Quantity]:
    """Nine g-sensitivities (dps/g: what each axis adds to the true rate per g along each axis) and three asymmetries (ppm: scale
    factor for positive less that for negative rates, over their mean); ``start`` has the effects that are in the model."""
    start = twin.start() if start is None else start
    named = [claim.effect for claim in start.claims]
    known = {effect.id for effect in named}
    # Together: what one of them leaves in the residuals must not widen or bend the other.
    tried = [catalogue()[name] for name in (G_SENSITIVITY, ASYMMETRY) if name not in known]
    fit = refit(twin, whiten, [*named, *tried], start) if tried else refit(twin, whiten, named, start)
    widen = _widen(fit)
    latitude_known = twin.problem.earth.source != "none"
    quantities = []
    for number, claim in enumerate(fit.state.claims):
        covariance = fit.theta_covariance(number) * widen
        if claim.effect.id == G_SENSITIVITY:
            quantities += _g_sensitivity(claim.theta, covariance, claim.effect.parameter.plausible, latitude_known)
        if claim.effect.id == ASYMMETRY:
            quantities += _asymmetry(claim.theta, covariance, claim.effect.parameter.plausible)
    return sorted(quantities, key=lambda quantity: quantity.word != "g-sensitivity")


def _widen(fit: Refit) -> float:
    """Factor on the covariance that the residuals ask for."""
    return max(1.0, fit.chi_square / max(len(fit.r) - fit.J.shape[1], 1))


def _g_sensitivity(theta: np.ndarray, covariance: np.ndarray, plausible: float, latitude_known: bool) -> list[Quantity]:
    note = ""
    if not latitude_known:
        # All axes alike following gravity is a rotation about the vertical: the Earth's own, where its latitude is not known.
        alike = np.eye(3).ravel()
        covariance = covariance + np.outer(alike, alike) * EARTH_RATE_RPS**2 / 3
        note = "the diagonal's mean may be the Earth's vertical rate: no latitude is given"
    sigma = np.sqrt(np.diag(covariance))
    return [
        Quantity(
            "g-sensitivity",
            f"{axis} per g on {along}",
            "dps/g",
            float(theta[i] / DEG),
            float(COVERAGE_FACTOR * sigma[i] / DEG),
            bool(sigma[i] < OBSERVED_SHARE * plausible),
            note=note if axis == along else "",
        )
        for i, (axis, along) in enumerate((axis, along) for axis in "xyz" for along in "xyz")
    ]


def _asymmetry(half: np.ndarray, covariance: np.ndarray, plausible: float) -> list[Quantity]:
    sigma = np.sqrt(np.diag(covariance))
    return [
        Quantity(
            "scale factor asymmetry",
            axis,
            "ppm",
            float(2 * half[i] / PPM),
            float(COVERAGE_FACTOR * 2 * sigma[i] / PPM),
            bool(sigma[i] < OBSERVED_SHARE * plausible),
        )
        for i, axis in enumerate("xyz")
    ]
