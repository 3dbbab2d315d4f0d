"""Parameters as docs/formats.md names them, in people's units, with their standard deviations."""

from __future__ import annotations

import numpy as np

from tinygc.effects import AppliedEffect, Convention, Effect, Parts
from tinygc.explanation.twin.state import State


def readable(claim: AppliedEffect, covariance: np.ndarray) -> tuple[np.ndarray, dict, dict]:
    """theta (P,) SI, its JSON parameters, and their std."""
    theta, effect = claim.theta, claim.effect
    if effect.derived is not None:
        return theta, *effect.derived.values(theta, covariance)
    if isinstance(effect.gauge, Convention):
        slope = effect.gauge.slope(theta)
        covariance = slope @ covariance @ slope.T
    parameter = effect.parameter
    sigma = np.sqrt(np.maximum(np.diag(covariance), 0) + (effect.known_to * theta) ** 2)
    values, spread = ((x / parameter.si).reshape(parameter.shape).tolist() for x in (theta, sigma))
    return theta, {parameter.name: values, **effect.shape}, {parameter.name: spread}


def theta_of(effect: Effect, parameters: dict, state: State) -> np.ndarray:
    """theta (P,) SI of an effect with such JSON parameters: the state's own where it holds the effect, which is exact for all."""
    held = next((claim.theta for claim in state.claims if claim.effect.id == effect.id), None)
    if held is None and isinstance(effect.derived, Parts):
        return effect.derived.theta(parameters)
    return np.ravel(parameters[effect.parameter.name]) * effect.parameter.si if held is None else held
