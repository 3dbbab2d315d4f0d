"""Parameters as FORMATS names them, in people's units, with their standard deviations."""

from __future__ import annotations

import numpy as np

from tinygc.effects.applied import Claim
from tinygc.effects.effect import Effect
from tinygc.effects.entries.earth_rotation import latitude_deg
from tinygc.explain.twin.twin import State


def readable(claim: Claim, covariance: np.ndarray) -> tuple[np.ndarray, dict, dict]:
    """theta (P,) SI, its JSON parameters, and their std."""
    theta, effect = claim.theta, claim.effect
    if effect.id == "earth.rotation":
        return theta, *_latitude(theta, covariance)
    if effect.id == "timing.axis_skew":
        covariance = _from_the_first(theta, covariance)
    parameter = effect.parameter
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0) + (effect.known_to * theta) ** 2)
    values, spread = ((x / parameter.si).reshape(parameter.shape).tolist() for x in (theta, sigma))
    return theta, {parameter.name: values, **effect.shape}, {parameter.name: spread}


def theta_of(effect: Effect, parameters: dict, state: State) -> np.ndarray:
    """theta (P,) SI of an effect with such JSON parameters: the state's own where it holds the effect, which is exact for all."""
    held = next((claim.theta for claim in state.claims if claim.effect.id == effect.id), None)
    return np.ravel(parameters[effect.parameter.name]) * effect.parameter.si if held is None else held


def _from_the_first(theta: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Covariance of the delays counted from the earliest axis."""
    change = np.eye(3) - np.eye(3)[int(np.argmin(theta))]
    return change @ covariance @ change.T


def _latitude(rate_t: np.ndarray, covariance: np.ndarray) -> tuple[dict, dict]:
    """Latitude from the direction of the Earth's rate, and its std from the covariance (to first order)."""
    small = 1e-3 * np.linalg.norm(rate_t)
    slope = np.array([(latitude_deg(rate_t + small * e) - latitude_deg(rate_t - small * e)) / (2 * small) for e in np.eye(3)])
    return {"latitude_deg": latitude_deg(rate_t)}, {"latitude_deg": float(np.sqrt(slope @ covariance @ slope))}
